"""Refuses parameters that no rig can have."""

from __future__ import annotations

import math
from typing import Any

from daq.errors import UnphysicalParameter
from daq.quantity import Bound, bounds_of


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

    For what hangs on other parameters. `above` leaves `low` itself out; `owner` is the part that the
    parameter belongs to.
    """
    bound = Bound(unit, low, high, above)
    if not bound.holds(value):
        raise UnphysicalParameter(owner, name, value, str(bound))


def require_bounds(owner: str, part: Any) -> None:
    """Raise UnphysicalParameter unless the fields of the dataclass `part` are within their declared bounds.

    A field that is None is not there; of a tuple each number counts.
    """
    for name, bound in bounds_of(type(part)).items():
        value = getattr(part, name)
        for number in value if isinstance(value, tuple) else (value,):
            if number is not None and not bound.holds(number):
                raise UnphysicalParameter(owner, name, number, str(bound))
