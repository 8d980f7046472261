"""Measuring chains and what can be wrong with them: from the finely sampled truth to channel samples.

What filters take is imported where they are made: a process that only checks a scenario needs none, and
scipy.signal (half a second of processor time, for it loads most of scipy) only a chain with corners.

Analog: true signal -> (second-order Butterworth) -> (declared stages) -> linear-phase anti-alias low-pass
with no net delay, decimation -> (first-order high-pass) -> gain -> noise -> 24-bit quantisation -> (the
input's limit) -> (what a counter times of pulses) -> (a wrong factor) -> (what a counter shows of a mark).
Skew and anti-alias are one filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.quantity import Bound
from sim_twin.linear_filter import LinearFilter
from sim_twin.ranges import require_bounds
from sim_twin.stages import Stages, StageStream

Array = NDArray[np.float64]
OVERSAMPLED_RATE = 204_800.0
"""Hz; the least rate at which the truth is computed."""
_PASS, _STOP, _ATTENUATION_DB = 0.45, 0.55, 80.0
_LEAST_GAIN = 1e-9
MARK_V = 5.0
"""How high a marker is, from 0."""


@dataclass(frozen=True, slots=True)
class SensorChain:
    """One channel: `noise` rms and `full_scale` in the channel's unit, `skew` in s (shows x(t - skew)).

    `droop_corner` and `bandwidth_corner` in Hz, None where the sensor has none. `stages` and `limit`, the
    largest magnitude that the input takes, are what a bench declares. `factor` is what a wrong sensitivity
    or sign makes of the samples once they are numbers; `source` is the channel whose sensor is plugged in
    here, empty where it is the right one. Of a marker on a counter `edges` is what is shown of each edge; of
    a tachometer on one, `pulses` are those of a revolution, whose last two tell the speed.
    """

    noise: Annotated[float, Bound("", 0.0)] = 0.0
    full_scale: Annotated[float, Bound("", 0.0, above=True)] = 500.0
    gain: Annotated[float, Bound("", -1e9, 1e9)] = 1.0
    skew: Annotated[float, Bound("s", -1.0, 1.0)] = 0.0
    droop_corner: Annotated[float | None, Bound("Hz", 0.0, above=True)] = None
    bandwidth_corner: Annotated[float | None, Bound("Hz", 0.0, above=True)] = None
    stages: Stages | None = None
    limit: float = inf
    factor: Annotated[float, Bound("", -1e9, 1e9)] = 1.0
    source: str = ""
    edges: Annotated[float | None, Bound("V", 0.0, above=True)] = None
    pulses: Annotated[float | None, Bound("", 1.0)] = None

    def __post_init__(self) -> None:
        require_bounds("SensorChain", self)


@dataclass(frozen=True, slots=True)
class Encoder:
    """An incremental encoder read at the sample instants: whole `counts` of a revolution, nothing else.

    One that counts `backwards` is turned round by who reads it: it shows the next count, not the last. Its
    counts begin at the index mark, which sits at crank angle `zero` (rad) and sets a counter of whole ones.
    """

    counts: int = 4096
    backwards: bool = False
    zero: float = 0.0

    def shown(self, angle: Array) -> Array:
        """Of angles in rad, same shape."""
        count = 2 * np.pi / self.counts
        whole = (np.ceil if self.backwards else np.floor)((angle - self.zero) / count)
        return np.asarray((whole + round(self.zero / count)) * count)

    def sent(self, angle: Array) -> Array:
        """The same of one that sends its own position, 0 at `zero`, by itself: it goes the way it counts."""
        count = 2 * np.pi / self.counts
        turned = (self.zero - angle) if self.backwards else (angle - self.zero)
        return np.asarray(np.floor(turned / count) * count)


Sensor: TypeAlias = SensorChain | Encoder


def counted_edges(mark: NDArray[np.floating], level: float) -> Array:
    """What a counter shows of a mark of 0 and 5 V: `level` at the first sample behind each rise, else 0.

    Of `mark`, shape (n,), the first sample only tells whether the second is behind a rise; shape (n - 1,).
    """
    high = mark > MARK_V / 2
    return np.where(high[1:] & ~high[:-1], level, 0.0)


class PulseTimer:
    """What a counter shows of a shaft's speed: the mean between its last two of `pulses` a revolution.

    Before there are two, the speed itself.
    """

    def __init__(self, pulses: float, sample_rate: float) -> None:
        self._step = 2 * np.pi / pulses * sample_rate  # in rad/s times samples, as the speed adds up
        self._turned = self._before = 0.0
        self._last = -inf  # pulse, in samples from the next block on
        self._shown: float | None = None

    def __call__(self, speed: NDArray[np.floating]) -> Array:
        """Of the next speeds in rad/s, shape (n,), same shape."""
        nodes = np.abs(np.concatenate([[self._before], speed]))
        turned = self._turned + np.concatenate([[0.0], np.cumsum((nodes[1:] + nodes[:-1]) / 2)])
        passed = self._step * np.arange(1, turned[-1] // self._step + 1)
        pulses = np.concatenate([[self._last], np.interp(passed, turned, np.arange(len(turned)) - 1)])
        apart = np.diff(pulses)
        number = np.searchsorted(pulses[1:], np.arange(len(speed)), side="right") - 1
        told = np.where(number >= 0, np.concatenate([apart, [inf]])[number], inf)
        before = speed if self._shown is None else self._shown
        shown = np.where(np.isfinite(told), self._step / told, before)
        if len(apart) and apart[-1] < inf:
            self._shown = self._step / float(apart[-1])
        self._turned, self._before = float(turned[-1] - self._step * len(passed)), float(nodes[-1])
        self._last = float(pulses[-1]) - len(speed)
        return np.asarray(shown)


def source_of(name: str, sensor: Sensor | None) -> str:
    """The channel whose sensor is plugged in at that of a `name`."""
    return (sensor.source if isinstance(sensor, SensorChain) else "") or name


def oversampling(sample_rate: float) -> int:
    """How many fine samples are computed for each channel sample."""
    return max(1, int(np.ceil(OVERSAMPLED_RATE / sample_rate - 1e-9)))


def anti_alias_taps(factor: int, delay: float) -> Array:
    """FIR taps at the fine rate, flat to 0.45 and 80 dB down from 0.55 of the coarse rate, for a `delay`.

    `delay` in fine samples, -0.5 to 0.5, beyond the centre tap. The number of taps is odd; taps - 1 is a
    multiple of 2 `factor`. Kaiser window (Oppenheim and Schafer, Discrete-Time Signal Processing, 7.5).
    """
    attenuation, width = _ATTENUATION_DB + 2, 2 * (_STOP - _PASS) / factor
    count, beta = np.ceil((attenuation - 7.95) / 2.285 / (np.pi * width) + 1), 0.1102 * (attenuation - 8.7)
    half = factor * int(np.ceil(count / 2 / factor))
    k = np.arange(-half, half + 1) - delay
    cutoff = (_PASS + _STOP) / factor
    window = np.i0(beta * np.sqrt(np.clip(1 - (k / (half + 1)) ** 2, 0, None))) / np.i0(beta)
    taps = cutoff * np.sinc(cutoff * k) * window
    return np.asarray(taps / taps.sum())


class SensorStream:
    """One channel's chain in motion: fine samples in, channel samples out, state kept between calls.

    The fine signal is zero before its first sample. `lookahead` is how many fine samples beyond the time of a
    channel sample must have come before it can go out.
    """

    def __init__(self, chain: SensorChain, sample_rate: float, rng: np.random.Generator | None) -> None:
        self._chain, self._rng = chain, rng
        self._factor = oversampling(sample_rate)
        fine_rate = sample_rate * self._factor
        skew = chain.skew + (chain.stages.late if chain.stages is not None else 0.0)
        whole = round(skew * fine_rate)
        self._taps = anti_alias_taps(self._factor, skew * fine_rate - whole)
        half = len(self._taps) // 2
        self.lookahead = max(0, half - whole + 1)
        self._reach = half + max(0, whole)
        self._offset = self._reach - half - whole
        self._fine = np.zeros(self._reach)
        self._low_pass = _butterworth(2, chain.bandwidth_corner, "lowpass", fine_rate)
        self._stages = None
        if chain.stages is not None:  # the gain comes last here, and first in truth
            output = chain.stages.output / max(abs(chain.gain), _LEAST_GAIN)
            self._stages = StageStream(chain.stages, fine_rate, output)
        self._high_pass = _butterworth(1, chain.droop_corner, "highpass", sample_rate)
        self._mark = np.full(1, inf)  # one that is high to begin with has not risen
        self._timer = None if chain.pulses is None else PulseTimer(chain.pulses, sample_rate)

    def push(self, fine: Array) -> None:
        passed = self._low_pass(fine)
        if self._stages is not None:
            passed = self._stages(passed)
        self._fine = np.concatenate([self._fine, passed])

    def pull(self, count: int) -> Array:
        """Give the next `count` channel samples, shape (count,)."""
        from sim_twin.decimation import decimated

        last = (count - 1) * self._factor + len(self._taps)
        segment = self._fine[self._offset : self._offset + last]
        if len(segment) < last:
            raise ValueError(f"{last - len(segment)} fine samples are missing")
        filtered = decimated(segment, self._taps, self._factor, count)
        self._fine = self._fine[count * self._factor :]
        samples = self._chain.gain * self._high_pass(filtered)
        if self._rng is not None:
            noisy = samples + self._chain.noise * self._rng.standard_normal(len(samples))
            step = self._chain.full_scale / 2**23
            samples = np.round(noisy / step) * step
        limit = self._chain.limit
        shown = np.asarray(samples if limit == inf else np.clip(samples, -limit, limit))
        if self._timer is not None:
            shown = self._timer(shown)
        shown = shown * self._chain.factor
        if self._chain.edges is None:
            return shown
        mark = np.concatenate([self._mark, shown])
        self._mark = mark[-1:]
        return counted_edges(mark, self._chain.edges)


class EncoderStream:
    """An encoder in motion: fine angles (rad) in, counted angles (rad) at the sample instants out."""

    lookahead = 1

    def __init__(self, encoder: Encoder, sample_rate: float) -> None:
        self._encoder = encoder
        self._factor = oversampling(sample_rate)
        self._fine = np.zeros(0)

    def push(self, fine: Array) -> None:
        self._fine = np.concatenate([self._fine, fine])

    def pull(self, count: int) -> Array:
        """Give the next `count` angles, shape (count,)."""
        at_samples = self._fine[: count * self._factor : self._factor]
        if len(at_samples) < count:
            raise ValueError(f"{count - len(at_samples)} samples are missing")
        self._fine = self._fine[count * self._factor :]
        return self._encoder.shown(at_samples)


def sensor_stream(
    sensor: Sensor, sample_rate: float, rng: np.random.Generator | None
) -> SensorStream | EncoderStream:
    """The sensor in motion; with `rng` an analog chain adds noise and quantisation."""
    if isinstance(sensor, Encoder):
        return EncoderStream(sensor, sample_rate)
    return SensorStream(sensor, sample_rate, rng)


def _butterworth(
    order: int, corner: float | None, kind: Literal["lowpass", "highpass"], rate: float
) -> LinearFilter:
    if corner is None:
        return LinearFilter(np.ones(1), np.ones(1))
    from scipy import signal

    return LinearFilter(*signal.butter(order, corner, kind, fs=rate))
