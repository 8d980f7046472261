"""A parameter as far as it is known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter's best value and the interval that holds it with 95 %."""

    value: float
    low: float
    high: float

    def widened(self, times: float, least: float, most: float) -> Estimate:
        """The interval stretched about the value, but not beyond `least` and `most`."""
        low, high = (
            self.value - times * (self.value - self.low),
            self.value + times * (self.high - self.value),
        )
        return Estimate(self.value, max(low, min(least, self.low)), min(high, max(most, self.high)))
