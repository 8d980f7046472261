"""Settings of a channel or of the encoder, changed in a bench file whose text stays as it is otherwise."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from daq.disk import write_whole
from daq.errors import RattleError
from rig.files.faults import as_written, read_text

_CHANNELS: Final = "[[daq_card.channels]]"


@dataclass(frozen=True, slots=True)
class Change:
    """`key` of a channel of the card becomes `value`; of the table [encoder], where `channel` is empty."""

    channel: str
    key: str
    value: str | bool

    def __str__(self) -> str:
        return f"{self.channel or '[encoder]'}: {self.key} = {as_written(self.value)}"


def change_bench(path: Path, changes: Sequence[Change]) -> None:
    """Write them into the file; comments and order stay.

    Raises RattleError, and leaves the file as it is, where it is written so that this cannot be done.
    """
    write_whole(path, changed(read_text(path), changes, str(path)).encode())


def changed(text: str, changes: Sequence[Change], source: str = "bench") -> str:
    """The text with the changes in it, proven to say nothing else; raises RattleError."""
    wanted = tomllib.loads(text)
    for change in changes:
        _table_of(wanted, change)[change.key] = change.value
    lines = text.splitlines(keepends=True)
    for change in changes:
        _put(lines, change)
    edited = "".join(lines)
    with suppress(tomllib.TOMLDecodeError):
        if tomllib.loads(edited) == wanted:
            return edited
    by_hand = "; ".join(map(str, changes))
    raise RattleError(f"{source} is written in a way that this program does not edit; write there: {by_hand}")


def _table_of(tables: dict[str, Any], change: Change) -> dict[str, Any]:
    with suppress(KeyError, StopIteration):
        if not change.channel:
            encoder: dict[str, Any] = tables["encoder"]
            return encoder
        channels: list[dict[str, Any]] = tables["daq_card"]["channels"]
        return next(table for table in channels if table["name"] == change.channel)
    raise RattleError(f"the bench file has no table of {change.channel or '[encoder]'}")


def _put(lines: list[str], change: Change) -> None:
    line = f"{change.key} = {as_written(change.value)}"
    for begin, end in _stretches(lines):
        here = lines[begin:end]
        name = re.compile(rf"""\s*name\s*=\s*["']{re.escape(change.channel)}["']\s*(#.*)?$""")
        head = here[0].split("#")[0].replace(" ", "").strip()
        if head != (_CHANNELS if change.channel else "[encoder]"):
            continue
        if change.channel and not any(name.match(each) for each in here):
            continue
        for at in range(begin + 1, end):
            if found := re.match(rf"(\s*){change.key}\s*=\s*({_VALUE})(\s*(?:#.*)?\r?\n?)$", lines[at]):
                lines[at] = f"{found[1]}{line}{found[3]}"
                return
        last = max(at for at in range(begin, end) if lines[at].split("#")[0].strip())
        indent = re.match(r"\s*", lines[last])
        ends = "\r\n" if lines[last].endswith("\r\n") else "\n"
        lines[last] = lines[last].rstrip("\r\n") + ends
        lines.insert(last + 1, f"{indent[0] if indent else ''}{line}{ends}")
        return


_VALUE: Final = r""""[^"\\]*"|'[^']*'|[A-Za-z0-9_.+:-]+"""


def _stretches(lines: Sequence[str]) -> Iterator[tuple[int, int]]:
    """From one header of a table to the next."""
    heads = [at for at, line in enumerate(lines) if re.match(r"\s*\[", line)]
    yield from pairwise([*heads, len(lines)])
