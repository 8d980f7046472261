"""A parameter as far as it is known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter's best value and the interval that holds it with 95 %."""

    value: float
    low: float
    high: float
