"""The axes of a sweep file: which keys of the scenario take which values, in which order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, Final, Literal

import numpy as np

from daq.quantity import Key, Quantity, Text, Whole, settings_of
from rig.files.faults import Faults, dotted
from rig.files.quantity import QuantityError, si_factor, written
from rig.files.table import Field, FieldError, field_of, read_table
from rig.rigs.kind import RigKind

Value = str | float | bool
_MOST_VALUES: Final = 1000
_DIGITS: Final = 9
_SECTIONS: Final = ("drive", "model")
_VALUES: Final = 'a list of values, or { from = "19.5 Hz", to = "21 Hz", steps = 27 }'


@dataclass(frozen=True, slots=True)
class Axis:
    """A key of the scenario (`drive.frequency`) and its values as the operator writes them, in order.

    `by_hand` says what a person does to set it; empty where the rig sets it by itself.
    `both_ways`: the values go there and back.
    """

    key: str
    values: tuple[Value, ...]
    by_hand: str
    both_ways: bool = False


@dataclass(frozen=True, slots=True)
class _RangeSection:
    """`steps` values from `from` to `to`, both among them."""

    to: Annotated[str | float, Text("a quantity")]
    steps: Annotated[int, Whole(2, _MOST_VALUES)]
    spacing: Annotated[Literal["linear", "log"], Key()] = "linear"


def read_axes(table: object, kind: RigKind, faults: Faults) -> dict[str, Axis]:
    """The axes of the table [axes] by their keys, as far as they are right."""
    if not isinstance(table, dict) or not table:
        faults.add("axes", table, f'a table [axes] with a line such as "drive.frequency" = {_VALUES}')
        return {}
    drive = {f"drive.{name}": field_of(setting) for name, setting in settings_of(kind.drive).items()}
    known = drive | {f"model.{name}": field_of(kind.model[name]) for name in kind.by_hand}
    axes: dict[str, Axis] = {}
    for key, given in _flat(table):
        full = dotted("axes", key)
        if key not in known:
            faults.unknown(full, given, key, known)
            continue
        values = _values(given, known[key], full, faults)
        if values:
            by_hand = kind.by_hand[key.partition(".")[2]] if key.startswith("model.") else ""
            axes[key] = Axis(key, values, by_hand)
    return axes


def numbers_of(axis: Axis) -> tuple[list[float], str] | None:
    """The values as numbers and their unit; None for words, and for values in several units."""
    try:
        numbers, units = zip(*map(written, axis.values), strict=True)
    except QuantityError:
        return None
    return (list(numbers), units[0]) if len(set(units)) == 1 else None


def there_and_back(axis: Axis) -> Axis:
    """The values up to the last and back to the first; the last comes once."""
    return Axis(axis.key, (*axis.values, *axis.values[-2::-1]), axis.by_hand, both_ways=True)


def _flat(table: dict[str, Any]) -> Iterator[tuple[str, object]]:
    """Keys and values; `drive.frequency = ...` without quotes is a table in a table to TOML."""
    for key, given in table.items():
        if key in _SECTIONS and isinstance(given, dict):
            for name, inner in given.items():
                yield f"{key}.{name}", inner
        else:
            yield key, given


def _values(given: object, field: Field, key: str, faults: Faults) -> tuple[Value, ...]:
    if isinstance(given, dict):
        values: Sequence[object] = _in_range(given, field, key, faults)
    elif isinstance(given, list) and 1 <= len(given) <= _MOST_VALUES:
        values = given
    else:
        faults.add(key, given, f"{_VALUES}; 1 to {_MOST_VALUES} values")
        return ()
    sound = [_read(value, field, f"{key}[{index}]", faults) for index, value in enumerate(values)]
    known = tuple(value for value in sound if value is not None)
    if len(known) < len(values):
        return ()
    if any(one == other for one, other in pairwise(known)):
        faults.add(key, given, "values of which no two neighbours are the same")
        return ()
    return known


def _read(value: object, field: Field, key: str, faults: Faults) -> Value | None:
    """The value as written, if the field takes it."""
    try:
        field.read(value)
    except FieldError as error:
        faults.add(key, value, str(error))
        return None
    return value if isinstance(value, str | bool | int | float) else None


def _in_range(given: dict[str, Any], field: Field, key: str, faults: Faults) -> list[Value]:
    if not isinstance(field.meaning, Quantity):
        faults.add(key, given, f"a list of values, each {field.allowed}")
        return []
    section = read_table(
        _RangeSection, {name: value for name, value in given.items() if name != "from"}, key, faults
    )
    if "from" not in given:
        faults.missing(f"{key}.from", "a quantity")
    if section is None or "from" not in given:
        return []
    first = _read(given["from"], field, f"{key}.from", faults)
    last = _read(section.to, field, f"{key}.to", faults)
    if first is None or last is None:
        return []
    # in the unit of `from` where `to` has the same; otherwise in SI, or in its own unit if it wants one
    (low, unit), (high, other) = written(first), written(last)
    if unit != other:
        low, high, unit = field.read(first), field.read(last), ""
        if field.meaning.two_units:
            unit = field.meaning.unit
            low, high = low / si_factor(unit), high / si_factor(unit)
    if section.spacing == "log" and low * high <= 0:
        faults.add(f"{key}.spacing", "log", "linear (a range that holds 0 has no even ratios)")
        return []
    space = np.geomspace if section.spacing == "log" else np.linspace
    numbers = [f"{number:.{_DIGITS}g}" for number in space(low, high, section.steps)]
    return [f"{number} {unit}" if unit else float(number) for number in numbers]
