"""Fits a clock model to pairs of a device's time and the arrival of that stamp at the host.

arrival = device (1 + rate) + offset + delay. What is assumed of the delay: it is independent from pair to
pair or nearly so, its distribution stays the same over the run but for stalls, and few of it (less than a
tenth) are spikes. Its shape is not assumed: the share of arrivals close to the quickest decides whether the
shortest delay can be known (exponential, uniform, half normal) or only a typical one (normal about a mean).
"""

from __future__ import annotations

from array import array
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import grey_opening

from daq.time_base.model import Anchor, ClockModel, Line, Segment, Step, robust_line

Array = NDArray[np.float64]

STALL_S = 5.0
"""A host that is late for no longer than this is taken to stall."""
SMALLEST_STEP_S = 1e-4
"""Least jump that is told from the drift within a window, however quiet the arrivals."""

_PAIRS = 5
"""Pairs of which the median stands for all: two spikes among them do not show."""
_BIN_S = 0.5
"""A tenth of a stall, so that leaving out stalls leaves the same of the noise at any rate of pairs."""
_WINDOW = 8
"""Medians on either side that a jump is judged by; jumps closer than this are seen as one."""
_LONG = 4 * _WINDOW
_POSSIBLE, _CERTAIN = 8.0, 16.0
"""Deviations of the differences, whose tails are longer than normal ones: from 8 a jump is possible and
must show over four times as many medians as well, from 16 it is certain."""
_STILL = 0.75
"""Share of a jump that is still there over the longer windows; chance spells of late arrivals have faded."""
_MAD_TO_SIGMA = 1.4826
LEAST_PAIRS = 24
"""Fewer pairs say nothing about a rate."""
_MOST_PAIRS = 1 << 16  # near two hours at ten pairs a second; then every second one goes
_BINS = 120  # each gives one point to the line: enough for a bend to show
_PAIRS_IN_BIN = 20  # the fewest from which two at either end can be cut off
_BINS_OF_ONE = 4  # between two steps, on average: each has a level, and they share a slope
_FEWEST_BINS = 8  # below them neither a bend nor a step is told
_SHARP_SHARE = 0.04
"""Share of arrivals in the lowest tenth between edge and median from which the edge is sharp: uniform 0.05,
half normal 0.054, exponential 0.067; gamma of order 2 0.012, normal below 0.01."""
_JUMP_S = 1.0  # clocks that differ by more between two pairs: one of them was set
_BEND_SIGMAS = 4.0  # of the curvature: by chance in one of some 16,000 fits
_LATEST = 9  # pairs whose median tells where the clock is by now
_UNLOCKED = 10.0  # typical delays, by which it may lie elsewhere
_UNLOCKED_S = 1e-3  # but at least so much, s


class ClockFit:
    """Takes pairs as they come, all of a run or one by one, and gives the same model either way.

    Holds at most 65,536 pairs, for which there is room from the start; beyond, every second one is dropped
    for good.
    """

    def __init__(self, anchor: Anchor | None = None) -> None:
        """`anchor`: which delay the offset shall hold; None lets the pairs decide."""
        self._anchor = anchor
        self._device, self._arrival = (array("d", bytes(8 * (_MOST_PAIRS + 1))) for _ in range(2))
        self._held = self._seen = 0
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
                self._device[self._held], self._arrival[self._held] = device, arrival
                self._held += 1
            self._seen += 1
            if self._held > _MOST_PAIRS:
                self._held = (_MOST_PAIRS + 2) // 2
                for each in (self._device, self._arrival):
                    each[: self._held] = each[::2]
                self._every *= 2

    def model(self) -> ClockModel | None:
        """The model of all pairs so far; None from fewer than `LEAST_PAIRS`."""
        if self._held < LEAST_PAIRS:
            return None
        held = self._held
        return _model(np.array(self._device[:held]), np.array(self._arrival[:held]), self._anchor)


def fit_clock(device_s: ArrayLike, arrival_s: ArrayLike, anchor: Anchor | None = None) -> ClockModel | None:
    """The model of a whole recording's pairs; arguments and result as of `ClockFit`."""
    fit = ClockFit(anchor)
    fit.add(device_s, arrival_s)
    return fit.model()


class _Binned:
    """Pairs in bins of about equal size, none across a step."""

    def __init__(self, late: Array, elapsed_s: Array, starts: list[int]) -> None:
        ends = [*starts[1:], len(late)]
        size = max(len(late) // _BINS, min(_PAIRS_IN_BIN, len(late) // _FEWEST_BINS))
        size = max(min(size, len(late) // (_BINS_OF_ONE * len(starts))), 1)
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
            # The lower end of a distribution from its sample: 2 x(1) - x(2), symmetric about the end,
            # whatever the density there (Robson and Whitlock, Biometrika 51, 1964, 33).
            y = np.array([2 * each[0] - each[min(1, len(each) - 1)] for each in bins])
            weight = self.counts / self.size
        else:
            y = np.array([_middle(each) for each in bins])
            weight = np.sqrt(self.counts / self.size)
        return robust_line(self.x, y + slope * self.x, self.segment, weight, *extra)


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
    typical = _converged(binned, Anchor.TYPICAL, 0.0)  # first: the slope out, the quickest show
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


def find_steps(late: Array, elapsed_s: Array) -> list[int]:
    """Indices of the first pair after each jump, in order.

    Late is arrival minus stamp. A delay only ever adds to it, and a host that stalls adds much, for a while,
    to many in a row; a clock that jumps changes it for good, either way. So what is late for less than a few
    seconds is taken for a stall, what is early or stays late for a jump.

    `late` and `elapsed_s` (seconds that passed since the first pair, not decreasing) have shape (n,). At ten
    pairs a second with 1 ms of jitter, jumps from some 1.5 ms on are found once 2 s have passed after them if
    they are early, 3 s if they are late. A slow drift is no jump.
    """
    pair_s = float(elapsed_s[-1]) / max(len(elapsed_s) - 1, 1)
    width = max(_PAIRS, min(round(_BIN_S / pair_s), len(elapsed_s)) if pair_s > 0 else 1)
    count = len(late) // width
    window = min(_WINDOW, count // 2)
    if window < 2:
        return []
    medians = np.median(late[: count * width].reshape(count, width), axis=1)
    bin_s = max(float(elapsed_s[count * width - 1]) / count, 1e-9)
    stall = min(int(max(_WINDOW - 1, STALL_S / bin_s)), count)
    level = grey_opening(medians, size=(2 * (stall // 2) + 1,))
    before, after = _levels_around(level, window)
    long_before, long_after = _levels_around(level, min(max(_LONG, window), len(level) // 2))
    jump, long_jump = _less_drift(after - before), _less_drift(long_after - long_before)
    deviation = _MAD_TO_SIGMA * float(np.median(np.abs(jump)))
    shows = (np.abs(jump) > _CERTAIN * deviation) | (np.abs(long_jump) > _STILL * np.abs(jump))
    jump[~shows] = 0.0
    usual = float(np.median(medians - level))
    found = []
    while abs(jump[at := int(np.argmax(np.abs(jump)))]) > max(_POSSIBLE * deviation, SMALLEST_STEP_S):
        low, high = max(at + 1 - window, 0) * width, (at + 1 + window) * width
        # Cut where the sum of distances to the level before and the level after is least.
        near, was, becomes = late[low:high], before[at] + usual, after[at] + usual
        gain = np.concatenate([[0.0], np.cumsum(np.abs(near - was) - np.abs(near - becomes))])
        found.append(low + int(np.argmin(gain)))
        jump[max(at - window, 0) : at + window + 1] = 0.0
    return sorted(found)


def _less_drift(jump: Array) -> Array:
    """Without what a drift adds to all of them alike."""
    return jump - float(np.median(jump))


def _levels_around(level: Array, window: int) -> tuple[Array, Array]:
    """Medians of `window` values before and after each boundary between two values, shape (n - 1,)."""
    padded = np.pad(level, window - 1, mode="symmetric")
    medians = np.median(sliding_window_view(padded, window), axis=1)
    boundaries = len(level) - 1
    return medians[:boundaries], medians[window : window + boundaries]
