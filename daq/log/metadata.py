"""What stands as JSON in a log's metadata, which anybody may have written: read and checked in one place."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from daq.errors import LogError
from daq.quantity import Bound

_DEEPEST = 32
"""Lists in lists: far less than what Python follows, in a reader or in a printer."""
_SHOWN = 80


def read_json(text: str, what: str) -> Any:
    """What a text of a log says; raises LogError, which names it as `what`, where it is none, or too deep."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        raise LogError(f"{what} cannot be read ({reason})") from error
    level = [found]
    for _ in range(_DEEPEST):
        level = [inner for each in level for inner in _inside(each)]
    if level:
        raise LogError(f"{what} cannot be read (too deeply nested)")
    return found


def _inside(found: object) -> list[Any]:
    if isinstance(found, dict):
        return list(found.values())
    return found if isinstance(found, list) else []


def as_table(found: object, what: str) -> dict[str, Any]:
    """A table by its keys; raises LogError where it is none."""
    if not isinstance(found, dict):
        raise LogError(f"{what} cannot be read: {str(found)[:_SHOWN]}")
    return found


def number_in(table: Mapping[str, Any], key: str, bound: Bound, what: str) -> float:
    """The number of a key; raises LogError where there is none, or one that cannot be."""
    found = table.get(key)
    try:
        if isinstance(found, int | float) and bound.holds(float(found)):
            return float(found)
    except OverflowError:  # a whole number of hundreds of digits
        pass
    raise LogError(f"{what} cannot be read: {key} = {str(found)[:_SHOWN]} ({bound})")
