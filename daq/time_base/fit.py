"""Fits a clock model to pairs of a device's time and the arrival of that stamp at the host.

arrival = device (1 + rate) + offset + delay. What is assumed of the delay: it is independent from pair to
pair or nearly so, its distribution stays the same over the run but for stalls, and few of it (less than a
tenth) are spikes. Its shape is not assumed: the share of arrivals close to the quickest decides whether the
shortest delay can be known (exponential, uniform, half normal) or only a typical one (normal about a mean).
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.time_base.line import Line, robust_line
from daq.time_base.model import Anchor, ClockModel, Segment, Step
from daq.time_base.steps import find_steps

Array = NDArray[np.float64]

LEAST_PAIRS = 24
"""Fewer pairs say nothing about a rate."""

_MOST_PAIRS = 1 << 16
_BINS = 120
_PAIRS_IN_BIN = 20
_FEWEST_BINS = 8
_SHARP_SHARE = 0.04
"""Share of arrivals in the lowest tenth between edge and median from which the edge is sharp: uniform 0.05,
half normal 0.054, exponential 0.067; gamma of order 2 0.012, normal below 0.01."""
_JUMP_S = 1.0
_BEND_SIGMAS = 4.0
_LATEST = 9
_UNLOCKED = 10.0
_UNLOCKED_S = 1e-3


class ClockFit:
    """Takes pairs as they come, all of a run or one by one, and gives the same model either way.

    Holds at most 65,536 pairs: beyond, every second one is dropped for good.
    """

    def __init__(self, anchor: Anchor | None = None) -> None:
        """`anchor`: which delay the offset shall hold; None lets the pairs decide."""
        self._anchor = anchor
        self._device: list[float] = []
        self._arrival: list[float] = []
        self._seen = 0
        self._every = 1

    def add(self, device_s: ArrayLike, arrival_s: ArrayLike) -> None:
        """Add stamps of the device (its own clock, or samples over its nominal rate) and their arrivals.

        Both in s from an origin near by (floats resolve 0.1 us to 30 years), arrivals on the time base in the
        order of arrival, scalars or shape (n,). A pair that is not finite is passed over.
        """
        pairs = zip(np.ravel(device_s).tolist(), np.ravel(arrival_s).tolist(), strict=True)
        for device, arrival in pairs:
            if not isfinite(device + arrival):
                continue
            if self._seen % self._every == 0:
                self._device.append(device)
                self._arrival.append(arrival)
            self._seen += 1
            if len(self._device) > _MOST_PAIRS:
                self._device, self._arrival = self._device[::2], self._arrival[::2]
                self._every *= 2

    def model(self) -> ClockModel | None:
        """The model of all pairs so far; None from fewer than `LEAST_PAIRS`."""
        if len(self._device) < LEAST_PAIRS:
            return None
        return _model(np.array(self._device), np.array(self._arrival), self._anchor)


def fit_clock(device_s: ArrayLike, arrival_s: ArrayLike, anchor: Anchor | None = None) -> ClockModel | None:
    """The model of a whole recording's pairs; arguments and result as of `ClockFit`."""
    fit = ClockFit(anchor)
    fit.add(device_s, arrival_s)
    return fit.model()


class _Binned:
    """Pairs in bins of about equal size, none across a step."""

    def __init__(self, late: Array, elapsed_s: Array, starts: list[int]) -> None:
        ends = [*starts[1:], len(late)]
        size = max(len(late) // _BINS, min(_PAIRS_IN_BIN, len(late) // _FEWEST_BINS), 1)
        edges = [
            np.linspace(start, end, max(1, round((end - start) / size)) + 1).round().astype(int)
            for start, end in zip(starts, ends, strict=True)
        ]
        self.first = np.concatenate([each[:-1] for each in edges])
        self.counts = np.concatenate([np.diff(each) for each in edges])
        self.segment = np.repeat(np.arange(len(starts)), [len(each) - 1 for each in edges])
        self.late, self.elapsed_s, self.size = late, elapsed_s, size
        self.x = np.add.reduceat(elapsed_s, self.first) / self.counts
        self.segment_of_pair = np.repeat(self.segment, self.counts)

    def residual(self, line: Line) -> Array:
        return self.late - line.levels[self.segment_of_pair] - line.slope * self.elapsed_s

    def sorted_bins(self, values: Array) -> list[Array]:
        return [np.sort(each) for each in np.split(values, self.first[1:])]

    def line(self, anchor: Anchor, slope: float, *extra: Array) -> Line:
        """The line through the bins, once `slope` is taken out of each."""
        bins = self.sorted_bins(self.late - slope * self.elapsed_s)
        if anchor is Anchor.SHORTEST:
            y = np.array([_edge(each) for each in bins])
            weight = self.counts / self.size
        else:
            y = np.array([_middle(each) for each in bins])
            weight = np.sqrt(self.counts / self.size)
        return robust_line(self.x, y + slope * self.x, self.segment, weight, *extra)


def _edge(ordered: Array) -> float:
    """Lower end of a distribution from its sample, in order: 2 x(1) - x(2).

    Symmetric about the end, whatever the density there (Robson and Whitlock, Biometrika 51, 1964, 33).
    """
    return float(2 * ordered[0] - ordered[min(1, len(ordered) - 1)])


def _middle(ordered: Array) -> float:
    """Mean of the middle 80 % of a sample in order: deaf to spikes, and nearly as sure as the mean."""
    cut = min(max(1, len(ordered) // 10), (len(ordered) - 1) // 2)
    return float(np.mean(ordered[cut : len(ordered) - cut]))


def _model(device: Array, arrival: Array, anchor: Anchor | None) -> ClockModel:
    late = arrival - device
    # Seconds between pairs by the two clocks; one that jumped says too much, or that time ran back.
    steps, waits = np.diff(device), np.diff(arrival)
    usual = np.where(np.abs(steps - waits) < _JUMP_S, steps, np.minimum(steps, waits))
    passed = np.clip(usual, 0.0, None)
    starts = [0]
    for start in find_steps(late, np.concatenate([[0.0], np.cumsum(passed)])):
        # A segment that is shorter cannot be told from spikes.
        if start - starts[-1] >= _FEWEST_BINS and len(late) - start >= _FEWEST_BINS:
            starts.append(start)
    elapsed = _elapsed(device, passed, starts)
    binned = _Binned(late, elapsed - np.median(elapsed), starts)
    typical = _converged(binned, Anchor.TYPICAL, 0.0)
    shortest = _converged(binned, Anchor.SHORTEST, typical.slope)
    above = binned.residual(shortest)
    delay = max(float(np.median(above)), 0.0)
    if anchor is None:
        # Whether arrivals crowd at the shortest delay: the second quickest, lest one pair decides.
        quickest = float(np.partition(above, 1)[1])
        near = np.mean(above <= quickest + 0.1 * (delay - quickest))
        anchor = Anchor.SHORTEST if near >= _SHARP_SHARE else Anchor.TYPICAL
    line = shortest
    if anchor is Anchor.TYPICAL:
        # Shifted to the middle of all pairs: that of few from a skew distribution is a little off.
        coefficients = typical.coefficients.copy()
        coefficients[: typical.segments] += _middle(np.sort(binned.residual(typical)))
        line = replace(typical, coefficients=coefficients)
    latest = float(np.median(above[-_LATEST:]))
    segments = tuple(
        Segment(float(device[at]), float(arrival[at]), float(binned.elapsed_s[at])) for at in starts
    )
    return ClockModel(
        anchor=anchor,
        line=line,
        segments=segments,
        steps=tuple(
            Step(
                size_s=float(line.levels[number + 1] - line.levels[number]),
                device_s=(float(device[at - 1]), float(device[at])),
                arrival_s=(float(arrival[at - 1]), float(arrival[at])),
            )
            for number, at in enumerate(starts[1:])
        ),
        typical_delay_s=delay,
        bend_s=_bend(binned, anchor, line),
        locked=abs(latest - delay) < max(_UNLOCKED * delay, _UNLOCKED_S),
        pairs=len(device),
    )


def _elapsed(device: Array, passed: Array, starts: list[int]) -> Array:
    """Seconds of the device's clock since the first pair, its steps and the host's left out; shape (n,)."""
    elapsed = np.empty_like(device)
    begin = 0.0
    for start, end in zip(starts, [*starts[1:], len(device)], strict=True):
        if start:
            begin = elapsed[start - 1] + passed[start - 1]
        elapsed[start:end] = begin + device[start:end] - device[start]
    return elapsed


def _converged(binned: _Binned, anchor: Anchor, slope: float) -> Line:
    """The line through bins out of which its own slope was taken; each round is a thousand times nearer."""
    for _ in range(2):
        slope = binned.line(anchor, slope).slope
    return binned.line(anchor, slope)


def _bend(binned: _Binned, anchor: Anchor, line: Line) -> float:
    """Departure in s of a parabola through the bins from the line, at most; 0 if insignificant."""
    half = float(np.ptp(binned.x)) / 2
    if half == 0.0 or line.degrees_of_freedom < _FEWEST_BINS:
        return 0.0
    unit = (binned.x - np.mean(binned.x)) / half
    bent = binned.line(anchor, line.slope, unit**2)
    curvature, deviation = bent.coefficients[-1], np.sqrt(bent.covariance[-1, -1])
    return float(abs(curvature) + 2 * deviation) * 2 / 3 if abs(curvature) > _BEND_SIGMAS * deviation else 0.0
