"""Writes tables as TOML: what scenarios and benches hold, from texts and numbers to lists of tables."""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator, Mapping
from typing import Any


def toml_of(table: Mapping[str, Any]) -> str:
    """A file's table as TOML."""
    lines = [*_plain(table), *_nested("", table)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _plain(table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        if not _is_table(value) and not _are_tables(value):
            yield f"{_key(key)} = {_value(value)}"


def _nested(before: str, table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        path = f"{before}{_key(key)}"
        if _is_table(value):
            yield from _section(path, value)
        elif _are_tables(value):
            for each in value:
                yield from ("", f"[[{path}]]", *_plain(each), *_nested(f"{path}.", each))


def _section(path: str, table: Mapping[str, Any]) -> Iterator[str]:
    plain, nested = list(_plain(table)), list(_nested(f"{path}.", table))
    if plain or not nested:
        yield from ("", f"[{path}]", *plain)
    yield from nested


def _is_table(value: object) -> bool:
    return isinstance(value, Mapping)


def _are_tables(value: object) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(map(_is_table, value))


def _key(key: str) -> str:
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
