"""What a sensor shows while nothing is driven: its level, its noise, and what the mains put into it; and the
taps of a hand."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAINS_HZ: Final = (50.0, 60.0)
_HARMONICS: Final = 10
_OFF: Final = 0.01
"""Of its frequency: what the mains may be off by (EN 50160)."""
_REACH: Final = 2
"""Bins either side over which a Hann window spreads a line; it is 1.5 bins wide for noise."""
_AROUND: Final = 30
_ABOVE: Final = 8.0
"""Times the power that noise puts in as many bins, of which five a line are; noise alone comes so far once in
10^6 lines."""


class Line(NamedTuple):
    """A line of the mains; its amplitude is that of a sine, in the channel's unit."""

    frequency_hz: float
    amplitude: float


@dataclass(frozen=True, slots=True)
class AtRest:
    """What was seen of a channel, in its unit: `noise` is the rms about its mean, without drift and lines."""

    mean: float
    noise: float
    lines: tuple[Line, ...]


def at_rest(values: Array, sample_rate: float) -> AtRest:
    """What some seconds show, shape (n,); all NaN where a sample is not finite.

    The lines are those of 50 or 60 Hz and its harmonics, whichever has more, that stand out of the noise.
    """
    if not np.isfinite(values).all():
        return AtRest(np.nan, np.nan, ())
    mean, count = float(values.mean()), len(values)
    ramp = np.arange(count) - (count - 1) / 2
    rest = values - mean
    rest = rest - ramp * (ramp @ rest) / (ramp @ ramp)
    # a Hann window twice the mean power of which is 3/4: the sum over all bins is the variance
    power = np.abs(np.fft.rfft(rest * (0.5 - 0.5 * np.cos(2 * np.pi * np.arange(count) / count)))) ** 2
    power *= 2.0 / count**2 / 0.375
    bin_hz = sample_rate / count
    hums = [_lines(power, mains_hz, bin_hz) for mains_hz in MAINS_HZ]
    found = max(hums, key=_power)
    return AtRest(mean, float(np.sqrt(max(power.sum() - _power(found), 0.0))), tuple(found))


def _power(lines: list[Line]) -> float:
    return sum(line.amplitude**2 / 2 for line in lines)


def _lines(power: Array, mains_hz: float, bin_hz: float) -> list[Line]:
    """Those of `mains_hz` and its harmonics that are there, by the power in each bin."""
    low, high = (round(mains_hz * share / bin_hz) for share in (1 - _OFF, 1 + _OFF))
    if high + 1 >= len(power):
        return []
    strongest = low + int(np.argmax(power[low : high + 1]))
    left, middle, right = np.log(np.maximum(power[strongest - 1 : strongest + 2], 1e-300))
    bend = left - 2 * middle + right
    exact = strongest + (0.5 * (left - right) / bend if bend < 0 else 0.0)
    if _line(power, strongest) is None:  # its harmonics may be there without it
        exact = mains_hz / bin_hz
    found = [(number, _line(power, round(number * exact))) for number in range(1, _HARMONICS + 1)]
    return [Line(number * exact * bin_hz, float(np.sqrt(2 * line))) for number, line in found if line]


def _line(power: Array, at: int) -> float | None:
    """The power of a line there, without that of the noise around it; None where none stands out."""
    around = np.concatenate((power[max(at - _AROUND, 1) : max(at - 3, 1)], power[at + 4 : at + _AROUND]))
    inside = power[max(at - _REACH, 1) : at + _REACH + 1]
    if at + _REACH >= len(power) or not len(around):
        return None
    noise = float(np.median(around)) / np.log(2) * len(inside)  # a bin's mean, by the median of its chi2
    found = float(inside.sum())
    return found - noise if found > _ABOVE * noise and found > 0 else None


class Tap(NamedTuple):
    """What each channel showed of a tap: its largest swing, with the sign of the first; shape (channels,).

    0 where it did not leave its noise. `at_sample` counts as the samples do that were taken.
    """

    at_sample: int
    swings: Array


_LEVEL_BLOCKS, _FEWEST = 20, 8
_OUT_OF_NOISE: Final = 8.0
_BEFORE_S, _AFTER_S = 0.002, 0.06
_FIRST_SWING: Final = 0.5
"""Of the largest: what counts as the first swing of a tap, and not as what came before it."""


class TapFinder:
    """Finds taps in consecutive blocks of all channels; after each it waits until a whole block is quiet.

    A channel has left its noise where it is `_OUT_OF_NOISE` times its rms off its level, both of the last
    blocks, and farther than `least`, shape (channels,). The noise of blocks is a median: taps are not in it.
    """

    def __init__(self, sample_rate: float, least: Array) -> None:
        self._rate, self._least = sample_rate, least
        self._means: deque[Array] = deque(maxlen=_LEVEL_BLOCKS)
        self._spreads: deque[Array] = deque(maxlen=_LEVEL_BLOCKS)
        self._kept, self._first = np.zeros((len(least), 0)), 0
        self._due: int | None = None  # the sample at which the tap under way was seen
        self._ringing = False

    def take(self, values: Array) -> Tap | None:
        """Take the next samples, shape (channels, n); a tap that has come to its end with them."""
        values = np.nan_to_num(values)
        self._kept = np.concatenate((self._kept, values), axis=1)
        begin = self._first + self._kept.shape[1] - values.shape[1]
        found = None
        if len(self._means) >= _FEWEST:
            level = self._level()[:, None]
            limit = np.maximum(_OUT_OF_NOISE * np.median(self._spreads, axis=0), self._least)[:, None]
            beyond = (np.abs(values - level) > limit).any(axis=0)
            if self._due is None and not self._ringing and beyond.any():
                self._due = begin + int(np.argmax(beyond))
            self._ringing = self._ringing and bool(beyond.any())
            if self._due is not None and self._first + self._kept.shape[1] >= self._due + self._samples(
                _AFTER_S
            ):
                low = max(self._due - self._samples(_BEFORE_S) - self._first, 0)
                seen = self._kept[:, low : self._due + self._samples(_AFTER_S) - self._first] - level
                swings = _swings(seen, limit[:, 0])
                found = Tap(self._due, swings) if swings.any() else None
                self._due, self._ringing = None, True
        self._means.append(values.mean(axis=1))
        self._spreads.append(values.std(axis=1))
        keep = max(self._kept.shape[1] - self._samples(1.0), 0)
        self._kept, self._first = self._kept[:, keep:], self._first + keep
        return found

    def _level(self) -> Array:
        """Where the next block is to lie, shape (channels,): medians, drawn on as far as they drift."""
        means = np.array(self._means)
        half = len(means) // 2
        before, lately = np.median(means[:half], axis=0), np.median(means[half:], axis=0)
        return np.asarray(lately + (lately - before) * (len(means) - half + 1) / len(means))

    def _samples(self, seconds: float) -> int:
        return round(seconds * self._rate)


def _swings(seen: Array, limit: Array) -> Array:
    largest = np.abs(seen).max(axis=1)
    first = np.argmax(np.abs(seen) >= _FIRST_SWING * largest[:, None], axis=1)
    signs = np.sign(seen[np.arange(len(seen)), first])
    return np.where(largest > limit, signs * largest, 0.0)
