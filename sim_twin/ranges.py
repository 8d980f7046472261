"""Refuses parameters that no rig can have."""

from __future__ import annotations

import math

from daq.errors import UnphysicalParameter


def require(
    owner: str,
    name: str,
    value: float,
    low: float,
    high: float = math.inf,
    unit: str = "",
    above: bool = False,
) -> None:
    """Raise UnphysicalParameter unless `value` lies between `low` and `high` (in `unit`).

    `above` leaves `low` itself out. `owner` is the part that the parameter belongs to.
    """
    if math.isfinite(value) and low <= value <= high and not (above and value == low):
        return
    raise UnphysicalParameter(owner, name, value, _allowed(low, high, unit, above))


def _allowed(low: float, high: float, unit: str, above: bool) -> str:
    first = f"{'above' if above else 'at least'} {low:g}"
    return f"{first} {unit}".rstrip() if math.isinf(high) else f"{first}, at most {high:g} {unit}".rstrip()
