"""How the clock of one device lies against the time base of the run."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit  # scipy.stats would load all of scipy into the acquisition

from daq.log.records import ClockRecord, Event

Array = NDArray[np.float64]

_TUNING = 1.345
"""Huber's constant: 95 % of least squares' efficiency where the noise is normal."""
_MAD_TO_SIGMA = 1.4826
_FIRST, _ITERATIONS = 8, 60  # rounds of least absolute deviations, and of both; it ends by itself before that
_SMALLEST = 1e-13
"""A scale in s below which points count as exactly on the line: the rounding of seconds held in floats."""
_COVERED = 0.95  # of all that is called an uncertainty here
_RESOLUTION_S = 1e-7
"""Step of the stamps: host clocks read to 100 ns or better."""
_SMALLEST_S = 1e-15


@dataclass(frozen=True, slots=True)
class Line:
    """y = levels[segment] + slope x, with `extra` coefficients of further columns.

    `covariance` has the order of `coefficients`: the levels, the slope, then the extra columns.
    """

    coefficients: Array
    covariance: Array
    segments: int
    degrees_of_freedom: int

    @property
    def levels(self) -> Array:
        """Level of each segment at x = 0, shape (segments,)."""
        return self.coefficients[: self.segments]

    @property
    def slope(self) -> float:
        """The slope that all segments share."""
        return float(self.coefficients[self.segments])


def robust_line(x: Array, y: Array, segment: NDArray[np.intp], weight: Array, *extra: Array) -> Line:
    """Huber's M-estimate of a `Line` through points of shape (n,), n above the number of coefficients.

    `segment` numbers each point's segment from 0 without holes; `weight` is inverse to each point's
    deviation. The covariance is Huber's, with his correction for few points (Robust Statistics, 1981, 7.6).
    """
    segments = int(segment[-1]) + 1
    levels = (segment[:, None] == np.arange(segments)).astype(np.float64)
    scale = np.max(np.abs(x)) or 1.0
    design = weight[:, None] * np.column_stack([levels, x / scale, *extra])
    target = weight * y
    count, unknowns = design.shape
    coefficients, sigma = _iterate(design, target)
    psi = np.clip((target - design @ coefficients) / sigma, -_TUNING, _TUNING)
    inside = max(float(np.mean(np.abs(psi) < _TUNING)), 0.1)
    correction = 1 + unknowns / count * (1 - inside) / inside
    variance = (correction * sigma / inside) ** 2 * float(psi @ psi) / (count - unknowns)
    units = np.ones(unknowns)
    units[segments] = 1 / scale
    covariance = variance * np.linalg.pinv(design.T @ design) * np.outer(units, units)
    return Line(coefficients * units, covariance, segments, count - unknowns)


def _iterate(design: Array, target: Array) -> tuple[Array, float]:
    """Coefficients and scale: from least absolute deviations, which no outlier starts wrong, to Huber's."""
    count, unknowns = design.shape
    factor = np.ones(count)
    coefficients: Array = np.zeros(unknowns)
    sigma = _SMALLEST
    for step in range(_ITERATIONS):  # least squares, weighted anew each round
        root = np.sqrt(factor)
        before = coefficients
        coefficients = np.asarray(np.linalg.lstsq(design * root[:, None], target * root, rcond=None)[0])
        distance = np.abs(target - design @ coefficients)
        spread = _MAD_TO_SIGMA * float(np.median(distance)) * np.sqrt(count / (count - unknowns))
        sigma = max(spread, _SMALLEST)
        if step < _FIRST:
            factor = sigma / np.maximum(distance, 1e-3 * sigma)  # bounded, for a point on the line
        else:
            factor = np.minimum(1.0, _TUNING * sigma / np.maximum(distance, _SMALLEST))
            if np.max(np.abs(coefficients - before)) < 1e-6 * sigma:
                break
    return coefficients, sigma


# Of the simultaneous band: lines that are drawn, and times at which each is looked at.
_DRAWS, _POINTS = 4000, 200


class Anchor(Enum):
    """Which delay the offset holds: one-way arrivals cannot tell a constant delay from an offset.

    SHORTEST: the shortest delay that occurs; for links whose quickest arrivals all take about the same time
    (a free bus, an idle host), with waiting on top. TYPICAL: the mean of the middle 80 % of
    delays; for links that jitter about a mean, where the quickest of n arrivals is the quicker the larger n.
    """

    SHORTEST = "shortest delay"
    TYPICAL = "typical delay"


@dataclass(frozen=True, slots=True)
class Step:
    """A jump of a clock between two pairs: how much more is to be added to the device's time from then on.

    `device_s` and `arrival_s` are the times of the last pair before and the first after it.
    """

    size_s: float
    device_s: tuple[float, float]
    arrival_s: tuple[float, float]

    def event(self, device: str, time_ns: int) -> Event:
        """The jump as an entry of the log; `time_ns` is that of the first arrival after it on the time
        base."""
        device_s, arrival_s = ("{:.6f} to {:.6f} s".format(*pair) for pair in (self.device_s, self.arrival_s))
        text = (
            f"clock stepped by {self.size_s:+.6f} s: its time went from {device_s}, arrivals from {arrival_s}"
        )
        return Event(time_ns, "warning", device, "clock.step", text)


@dataclass(frozen=True, slots=True)
class Segment:
    """Pairs between two steps: times of the first pair, and the `elapsed_s` of the fit at it."""

    device_s: float
    arrival_s: float
    elapsed_s: float


@dataclass(frozen=True, slots=True)
class ClockModel:
    """time base = device time + offset, the offset a line in each segment and its slope the same in all.

    It only tells: no sample is moved by it. `typical_delay_s` is how much later than the shortest delay
    half of the arrivals are. `bend_s` is how far the offset departs from a line because the rate wandered
    (0 where that does not show). `locked` is False while the latest arrivals lie elsewhere: a stall, or a
    step not yet confirmed. Every uncertainty is the half width of a 95 % interval.
    """

    anchor: Anchor
    line: Line
    segments: tuple[Segment, ...]
    steps: tuple[Step, ...]
    typical_delay_s: float
    bend_s: float
    locked: bool
    pairs: int

    @property
    def rate_ppm(self) -> float:
        """Time base against device, less one, over the run: positive where the device's clock is slow."""
        return self.line.slope * 1e6

    @property
    def rate_uncertainty_ppm(self) -> float:
        """95 % half width of `rate_ppm`."""
        at = self.line.segments
        return float(self._quantile() * np.sqrt(self.line.covariance[at, at]) * 1e6)

    def offset_s(self, device_s: ArrayLike) -> Array:
        """What to add to device times of shape (n,) to come to the time base.

        A time that a step back of the device's clock made twice is taken for the later one.
        """
        return self._terms(np.asarray(device_s, np.float64)) @ self.line.coefficients

    def time_s(self, device_s: ArrayLike) -> Array:
        """Time base at device times of shape (n,)."""
        return np.asarray(device_s) + self.offset_s(device_s)

    def device_s(self, time_s: ArrayLike) -> Array:
        """Device times at times of the time base, shape (n,): the inverse of `time_s`."""
        wanted = np.asarray(time_s, np.float64)
        at = _last_from(np.array([segment.arrival_s for segment in self.segments]), wanted)
        first = np.array([segment.device_s for segment in self.segments])[at]
        elapsed = np.array([segment.elapsed_s for segment in self.segments])[at]
        offset = self.line.levels[at] + self.line.slope * elapsed
        return np.asarray(first + (wanted - first - offset) / (1 + self.line.slope))

    def uncertainty_s(self, device_s: ArrayLike) -> Array:
        """95 % half width of `offset_s` at each of the device times, shape (n,)."""
        at = np.asarray(device_s, np.float64)
        return self._with_the_rest(self._quantile() * self._deviation(at))

    def band_s(self, device_s: ArrayLike) -> Array:
        """Half width of a band that holds the true offset at all of the device times together in 95 %."""
        at = np.asarray(device_s, np.float64)
        deviation = self._deviation(at)
        # The same band for the same fit: the seed is part of the method.
        rng = np.random.default_rng(0)
        freedom = self.line.degrees_of_freedom
        chi2 = rng.chisquare(freedom, (_DRAWS, 1)) / freedom
        root = np.linalg.svd(self.line.covariance)
        draws = rng.standard_normal((_DRAWS, len(root.S))) * np.sqrt(root.S) @ root.Vh / np.sqrt(chi2)
        some = np.linspace(0, len(at) - 1, min(len(at), _POINTS)).astype(int)
        ratio = np.abs(draws @ self._terms(at[some]).T) / deviation[some]
        return self._with_the_rest(deviation * np.quantile(np.max(ratio, axis=1), _COVERED))

    def record(self, device: str, device_s: float, time_ns: int) -> ClockRecord:
        """The clock at `device_s`, which is `time_ns` on the time base, as an entry of the log."""
        offset, uncertainty = self.offset_s([device_s]), self.uncertainty_s([device_s])
        return ClockRecord(time_ns, device, float(offset[0]), self.rate_ppm, float(uncertainty[0]))

    # A step back makes the device pass some times twice; searching from the last segment takes the later.
    def _terms(self, device_s: Array) -> Array:
        """Factors of the line's coefficients at device times, shape (n, coefficients)."""
        first = np.array([segment.device_s for segment in self.segments])
        at = _last_from(first, device_s)
        elapsed = np.array([segment.elapsed_s for segment in self.segments])[at] + device_s - first[at]
        return np.column_stack([at[:, None] == np.arange(len(first)), elapsed])

    def _deviation(self, device_s: Array) -> Array:
        terms = self._terms(device_s)
        variance = np.sum(terms @ self.line.covariance * terms, axis=1)
        return np.asarray(np.sqrt(variance) + _SMALLEST_S)

    def _with_the_rest(self, half_width_s: Array) -> Array:
        """A half width with what the line's covariance lacks: resolution of the stamps, wandering rate."""
        return np.hypot(half_width_s, _RESOLUTION_S / 2) + self.bend_s

    def _quantile(self) -> float:

        return float(stdtrit(self.line.degrees_of_freedom, (1 + _COVERED) / 2))


def _last_from(first: Array, at: Array) -> NDArray[np.intp]:
    """For each of `at` the last segment that begins no later; the first where none does."""
    begun = first <= at[:, None]
    return np.where(begun.any(axis=1), len(first) - 1 - np.argmax(begun[:, ::-1], axis=1), 0)


def polled_clock(device: str, request_s: ArrayLike, reply_s: ArrayLike, time_ns: int) -> ClockRecord:
    """How the replies of a polled device lie against the time base, as of `time_ns`.

    `request_s`, `reply_s`: times on the time base, shape (n,), n at least 1. The offset leads from a reply
    to the middle of a usual poll. The uncertainty needs no assumption on where in between the value was
    taken: it is a bound for 95 % of the polls. A device without a clock has no rate: 0.
    """
    taken = np.asarray(reply_s, np.float64) - np.asarray(request_s, np.float64)
    half = float(np.median(taken)) / 2
    return ClockRecord(time_ns, device, -half, 0.0, max(half, float(np.quantile(taken, _COVERED)) - half))
