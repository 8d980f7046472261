"""Text of a file in and out: collecting every fault of it, so that an operator mends it in one go."""

from __future__ import annotations

import datetime
import difflib
import json
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

from daq.errors import ConfigurationError, Problem

_LARGEST_BYTES = 4 << 20
_T = TypeVar("_T")

_MOST_LISTED: Final = 40
"""Keys that a message holds; a rig has more."""


class Faults:
    """The faults found so far in one file."""

    def __init__(self, source: str) -> None:
        self.source = source
        self._problems: list[Problem] = []

    def __len__(self) -> int:
        return len(self._problems)

    def add(self, key: str, value: object, allowed: str) -> None:
        """Note that `key` holds `value` (as read from the file) where only `allowed` may stand."""
        self._problems.append(Problem(key, as_written(value), allowed))

    def add_from(self, table: Mapping[str, object], name: str, key: str, allowed: str) -> None:
        """Note that `name` in the table `key` does not fit other values, with what stands there."""
        if name in table:
            self.add(dotted(key, name), table[name], allowed)
        else:
            self.missing(dotted(key, name), allowed)

    def note(self, problem: Problem) -> None:
        self._problems.append(problem)

    def missing(self, key: str, allowed: str) -> None:
        self._problems.append(Problem(key, "(missing)", allowed))

    def unknown(
        self, key: str, value: object, name: str, known: Iterable[str], kind: str = "key", more: str = ""
    ) -> None:
        """Note that nobody knows `name`, which known one it may be meant for, and what `more` may be."""
        names = list(known)
        near = meant(name, names)
        listed = ", ".join(names) if len(names) <= _MOST_LISTED else f"{len(names)}, see rattle scenario RIG"
        table = key.removesuffix(f".{dotted('', name)}")
        hint = (
            f"did you mean {near if table == key else dotted(table, near)}?"
            if near
            else f"known here: {listed}"
        )
        self.add(key, value, f"unknown {kind}; {hint}{more}")

    def error(self) -> ConfigurationError:
        return ConfigurationError(self.source, self._problems)

    def raise_if_any(self) -> None:
        if self._problems:
            raise self.error()


def meant(name: str, names: Iterable[str]) -> str:
    """Which of `names` a mistyped one may be; empty where it is like none of them."""
    return next(iter(difflib.get_close_matches(name, list(names), n=1, cutoff=0.5)), "")


class Gathered:
    """Errors of several files, so that they are told in one."""

    def __init__(self) -> None:
        self._errors: list[ConfigurationError] = []

    def of(self, work: Callable[[], _T]) -> _T | None:
        """What `work` returns; None where it raises ConfigurationError, which is kept."""
        try:
            return work()
        except ConfigurationError as error:
            self._errors.append(error)
            return None

    def error(self) -> ConfigurationError:
        """One error of all; where they are several, each problem is told with its file."""
        if len(self._errors) == 1:
            return self._errors[0]
        problems = [
            Problem(f"{error.source}: {problem.key}", problem.value, problem.allowed)
            for error in self._errors
            for problem in error.problems
        ]
        return ConfigurationError(" and ".join(error.source for error in self._errors), problems)


def raised_by(*checks: Callable[[], object]) -> tuple[Problem, ...]:
    """The problems that `checks` raise in a ConfigurationError, each once."""
    found: dict[Problem, None] = {}
    for check in checks:
        try:
            check()
        except ConfigurationError as error:
            found |= dict.fromkeys(error.problems)
    return tuple(found)


def as_written(value: object) -> str:
    """A value the way TOML writes it, cut to one readable line."""
    match value:
        case bool():
            text = str(value).lower()
        case str():
            text = json.dumps(value, ensure_ascii=False)
        case datetime.date() | datetime.time():
            text = value.isoformat()
        case dict():
            text = "{...}"
        case list():
            text = "[...]"
        case int() if abs(value) > 10**18:
            text = "(a number of more than 18 digits)"
        case _:
            text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def dotted(prefix: str, key: str) -> str:
    """The full key of `key` in the table `prefix`; one that holds a dot is quoted, as TOML has it."""
    quoted = f'"{key}"' if "." in key else key
    return f"{prefix}.{quoted}" if prefix else quoted


def read_text(path: str | Path) -> str:
    """Text of a UTF-8 file; raises ConfigurationError if it cannot be read."""
    faults = Faults(str(path))
    try:
        with Path(path).open("rb") as file:
            content = file.read(_LARGEST_BYTES + 1)
        if len(content) > _LARGEST_BYTES:
            faults.add("file", str(path), "at most 4 MiB")
            raise faults.error()
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        faults.add("file", str(path), f"UTF-8 text (byte {error.start} is not)")
        raise faults.error() from error
    except (OSError, ValueError) as error:
        if isinstance(error, ConfigurationError):
            raise
        reason = error.strerror if isinstance(error, OSError) else str(error)
        faults.add("file", str(path), f"a readable file ({reason})")
        raise faults.error() from error


def read_toml(text: str, source: str) -> dict[str, Any]:
    """Tables of a TOML text; raises ConfigurationError with line and column."""
    if len(text) > _LARGEST_BYTES:  # a text in a log may be of any length
        raise ConfigurationError(source, [Problem("TOML", f"({len(text)} characters)", "at most 4 MiB")])
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # tomllib passes on what int() says of too many digits, hence more than TOMLDecodeError
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        raise ConfigurationError(source, [Problem("TOML", "(syntax)", reason)]) from error


def toml_of(table: Mapping[str, Any]) -> str:
    """A file's table as TOML."""
    lines = [*_plain(table), *_nested("", table)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _plain(table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        if not isinstance(value, Mapping) and not _are_tables(value):
            yield f"{toml_key(key)} = {_value(value)}"


def _nested(before: str, table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        path = f"{before}{toml_key(key)}"
        if isinstance(value, Mapping):
            plain, nested = list(_plain(value)), list(_nested(f"{path}.", value))
            if plain or not nested:
                yield from ("", f"[{path}]", *plain)
            yield from nested
        elif _are_tables(value):
            for each in value:
                yield from ("", f"[[{path}]]", *_plain(each), *_nested(f"{path}.", each))


def _are_tables(value: object) -> bool:
    tables = value if isinstance(value, list | tuple) else ()
    return bool(tables) and all(isinstance(each, Mapping) for each in tables)


def toml_key(key: str) -> str:
    """A key as TOML has it."""
    return key if key.isascii() and key.replace("_", "").replace("-", "").isalnum() else _text(key)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, datetime.date):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(each) for each in value)}]"
    return _text(str(value))


def _text(text: str) -> str:
    # JSON's escapes are TOML's, but for the one control character that JSON leaves as it is
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
