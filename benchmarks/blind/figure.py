"""A figure of the check: over which cases, how it is worked out, and the bar that it is held to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from benchmarks.blind.cases import Case
from benchmarks.blind.intervals import Interval, bootstrap, wilson

Selection: TypeAlias = Callable[[Sequence[Case]], list[Case]]
OfCase: TypeAlias = Callable[[Case], float | None]
OfCases: TypeAlias = Callable[[Sequence[Case]], float]


@dataclass(frozen=True, slots=True)
class Bar:
    """What a figure has to be: at least `low`, at most `high`."""

    low: float = -math.inf
    high: float = math.inf

    def __str__(self) -> str:
        if math.isinf(self.high):
            return f">= {self.low:g}"
        return f"<= {self.high:g}" if math.isinf(self.low) else f"{self.low:g} to {self.high:g}"

    def met(self, value: float) -> bool:
        """Whether a value keeps to it."""
        return self.low <= value <= self.high


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table; without a bar it is only for information."""

    what: str
    select: Selection
    value: OfCases
    interval: Literal["wilson", "bootstrap", "none"] = "bootstrap"
    bar: Bar | None = None
    less: OfCases | None = None
    """Taken off value and interval, itself without one."""

    def measure(self, cases: Sequence[Case]) -> Measured:
        """Work it out with its interval; NaN and no interval where there is no case for it."""
        chosen = self.select(cases)
        value = self.value(chosen) if chosen else math.nan
        interval, less = self._interval(chosen, value), self._less(chosen)
        if interval is not None:
            interval = interval[0] - less, interval[1] - less
        return Measured(self.what, value - less, interval, len(chosen), self.bar)

    def value_of(self, cases: Sequence[Case]) -> float:
        """Work it out without an interval."""
        chosen = self.select(cases)
        return self.value(chosen) - self._less(chosen) if chosen else math.nan

    def _less(self, chosen: Sequence[Case]) -> float:
        return self.less(chosen) if self.less is not None and chosen else 0.0

    def _interval(self, chosen: Sequence[Case], value: float) -> Interval | None:
        if not math.isfinite(value) or self.interval == "none":
            return None
        if self.interval == "wilson":
            return wilson(value * len(chosen), len(chosen))
        return bootstrap(self.value, chosen)


@dataclass(frozen=True, slots=True)
class Measured:
    """A figure's value, its 95 % interval and the number of cases."""

    what: str
    value: float
    interval: Interval | None
    count: int
    bar: Bar | None

    @property
    def met(self) -> bool | None:
        """Whether the bar is met; None without a bar or a value."""
        return None if self.bar is None or math.isnan(self.value) else self.bar.met(self.value)


def mean_of(metric: OfCase) -> OfCases:
    """The mean of a metric over cases."""
    return lambda cases: float(np.mean(_numbers(metric, cases)))


def median_of(metric: OfCase) -> OfCases:
    """The median of a metric over cases."""

    def median(cases: Sequence[Case]) -> float:
        # Not interpolated: the error of an effect on the wrong channel is infinite.
        return float(np.quantile(_numbers(metric, cases), 0.5, method="higher"))

    return median


def largest_of(metric: OfCase) -> OfCases:
    """The largest of a metric over cases."""
    return lambda cases: max(_numbers(metric, cases))


def _numbers(metric: OfCase, cases: Sequence[Case]) -> list[float]:
    return [value for value in map(metric, cases) if value is not None]
