"""The table [tolerances] of a scenario or a model: how far the healthy rigs of a lab differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from inspect import signature
from typing import Any, Final

from daq.errors import UnphysicalParameter
from daq.quantity import Quantity
from rig.files.faults import Faults, dotted
from rig.files.quantity import si_factor, si_unit
from rig.files.table import FieldError, quantity_field
from rig.rigs.kind import RigKind, tolerance_among
from sim_twin.healthy import Tolerance, factor, shift, where_possible

MOST_TIMES: Final = 50.0
"""As wide as elsewhere."""
LARGEST_SHARE: Final = 0.3
"""Of a value in which rigs elsewhere do not differ."""


def lab_tolerances(
    kind: RigKind, model: Mapping[str, Any], table: object, faults: Faults
) -> tuple[dict[str, float], tuple[Tolerance, ...]]:
    """What a lab says of its rigs of a [model]: how many times wider than elsewhere tolerances are, by name.

    And in which other keys of [model] they differ besides, in the order of their names.
    """
    if not isinstance(table, dict):
        faults.add("tolerances", table, 'a table such as contact_stiffness = "8 %"')
        return {}, ()
    widths, besides = dict[str, float](), dict[str, Tolerance]()
    try:
        known = kind.tolerances(model) if table else {}
    except UnphysicalParameter:  # which whoever makes a twin of it tells
        return {}, ()
    keys = [key for key in kind.numbers if key not in signature(kind.nominal).parameters]
    for name, given in table.items():
        usual = known.get(name) or (tolerance_among(kind, name, known.values()) if name in keys else None)
        try:
            if usual is not None and usual.name in widths:
                raise FieldError(f"once: it is {usual.name}, which stands here too")
            if usual is not None:
                widths[usual.name] = _deviation(usual, given) / usual.deviation
            elif name in keys:
                besides[name] = _besides(kind, name, model, given)
            else:
                faults.unknown(dotted("tolerances", name), given, name, [*known, *keys], "tolerance")
        except FieldError as error:
            faults.add(dotted("tolerances", name), given, f"a standard deviation, {error}")
    return widths, tuple(besides[name] for name in sorted(besides))


def _deviation(usual: Tolerance, given: object) -> float:
    unit = "" if usual.relative else usual.unit
    return float(quantity_field(Quantity(unit, 0, MOST_TIMES * usual.deviation)).read(given))


def _besides(kind: RigKind, key: str, model: Mapping[str, Any], given: object) -> Tolerance:
    """A share of what the rig has; of nothing, an angle, or what may lie to either side in the key's unit."""
    setting, value = kind.numbers[key], kind.value(key, model)
    meaning = setting.meaning
    if value is None or not isinstance(meaning, Quantity):
        raise FieldError("of a part that the rig has")
    plain = si_factor(meaning.unit) == 1
    unit, place = meaning.unit if plain else si_unit(meaning.unit), ("rig", *setting.place)
    if value > 0 and meaning.low >= 0 and meaning.unit != "deg":
        share = float(quantity_field(Quantity("", 0, LARGEST_SHARE)).read(given))
        found = factor(key, share, unit, place)
    else:
        offset = float(quantity_field(Quantity(meaning.unit, 0, meaning.high)).read(given))
        found = shift(key, offset, unit, place)
    return replace(where_possible(found), each_run=key in kind.set_up)


def in_words(tolerance: Tolerance, deviation: float, digits: int = 3) -> str:
    """A standard `deviation` of a tolerance as the table has it."""
    if tolerance.relative:
        return f"{100 * deviation:.{digits}g} %"
    return f"{deviation:.{digits}g} {tolerance.unit}".strip()
