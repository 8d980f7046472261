"""Measuring chains and what can be wrong with them: from the finely sampled truth to channel samples.

What filters take is imported where they are made: a process that only checks a scenario needs none, and
scipy.signal (half a second of processor time, for it loads most of scipy) only a chain with corners.

Analog: true signal -> (second-order Butterworth) -> linear-phase anti-alias low-pass with no net delay,
decimation -> (first-order high-pass) -> gain -> noise -> 24-bit quantisation. Skew and anti-alias are one
filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.quantity import Bound
from sim_twin.ranges import require_bounds

Array = NDArray[np.float64]
OVERSAMPLED_RATE = 204_800.0
"""Hz; the least rate at which the truth is computed."""
_PASS, _STOP, _ATTENUATION_DB = 0.45, 0.55, 80.0


@dataclass(frozen=True, slots=True)
class SensorChain:
    """One channel: `noise` rms and `full_scale` in the channel's unit, `skew` in s (shows x(t - skew)).

    `droop_corner` and `bandwidth_corner` in Hz, None where the sensor has none.
    """

    noise: Annotated[float, Bound("", 0.0)] = 0.0
    full_scale: Annotated[float, Bound("", 0.0, above=True)] = 500.0
    gain: Annotated[float, Bound("", -1e9, 1e9)] = 1.0
    skew: Annotated[float, Bound("s", -1.0, 1.0)] = 0.0
    droop_corner: Annotated[float | None, Bound("Hz", 0.0, above=True)] = None
    bandwidth_corner: Annotated[float | None, Bound("Hz", 0.0, above=True)] = None

    def __post_init__(self) -> None:
        require_bounds("SensorChain", self)


@dataclass(frozen=True, slots=True)
class Encoder:
    """An incremental encoder read at the sample instants: whole `counts` of a revolution, nothing else."""

    counts: int = 4096


Sensor: TypeAlias = SensorChain | Encoder


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
        whole = round(chain.skew * fine_rate)
        self._taps = anti_alias_taps(self._factor, chain.skew * fine_rate - whole)
        half = len(self._taps) // 2
        self.lookahead = max(0, half - whole + 1)
        self._reach = half + max(0, whole)
        self._offset = self._reach - half - whole
        self._fine = np.zeros(self._reach)
        self._low_pass = _butterworth(2, chain.bandwidth_corner, "lowpass", fine_rate)
        self._high_pass = _butterworth(1, chain.droop_corner, "highpass", sample_rate)

    def push(self, fine: Array) -> None:
        self._fine = np.concatenate([self._fine, self._low_pass(fine)])

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
        if self._rng is None:
            return samples
        noisy = samples + self._chain.noise * self._rng.standard_normal(len(samples))
        step = self._chain.full_scale / 2**23
        return np.asarray(np.round(noisy / step) * step)


class EncoderStream:
    """An encoder in motion: fine angles (rad) in, counted angles (rad) at the sample instants out."""

    lookahead = 1

    def __init__(self, encoder: Encoder, sample_rate: float) -> None:
        self._count = 2 * np.pi / encoder.counts
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
        return np.asarray(np.floor(at_samples / self._count) * self._count)


def sensor_stream(
    sensor: Sensor, sample_rate: float, rng: np.random.Generator | None
) -> SensorStream | EncoderStream:
    """The sensor in motion; with `rng` an analog chain adds noise and quantisation."""
    if isinstance(sensor, Encoder):
        return EncoderStream(sensor, sample_rate)
    return SensorStream(sensor, sample_rate, rng)


class LinearFilter:
    """A recursive filter of up to second order with memory; starts at rest."""

    def __init__(self, b: Array, a: Array) -> None:
        self._passes = len(a) == len(b) == 1
        self._b, self._a = (np.pad(each / a[0], (0, 3 - len(each))) for each in (b, a))
        self._state = np.zeros(2)

    def __call__(self, x: Array) -> Array:
        """Filter the next samples, shape (n,) to (n,)."""
        if self._passes:
            return x

        from sim_twin.decimation import second_order

        y = np.empty(len(x))
        second_order(self._b, self._a, np.ascontiguousarray(x, np.float64), self._state, y)
        return y


def oscillator(
    omega: float, decay: float, B: float, C: tuple[float, float], D: float, rate: float
) -> LinearFilter:
    """C (x, x') + D u of x'' + `decay` x' + `omega`^2 x = B u, exact for u that is linear between samples.

    By the exponential of motion, u and its slope together (Franklin, Powell and Workman, Digital Control of
    Dynamic Systems, 3rd edition, pages 204-206).
    """
    from scipy.linalg import expm

    together = np.zeros((4, 4))
    together[:2, :3] = np.array([[0.0, 1.0, 0.0], [-(omega**2), -decay, B]]) * (1 / rate)
    together[2, 3] = 1.0
    turn, row = expm(together), np.array([C])
    A, slope = turn[:2, :2], turn[:2, 3:]
    column, direct = turn[:2, 2:3] - slope + A @ slope, D + (row @ slope)[0, 0]
    denominator = np.asarray(np.poly(A), np.float64)
    return LinearFilter(np.poly(A - column @ row) + (direct - 1) * denominator, denominator)


def resonance(frequency: float, damping_ratio: float, rate: float) -> LinearFilter:
    """One mode, gain 1 at low frequency, exact for inputs that are linear between samples."""
    omega = 2 * np.pi * frequency
    return oscillator(omega, 2 * damping_ratio * omega, omega**2, (1.0, 0.0), 0.0, rate)


def _butterworth(
    order: int, corner: float | None, kind: Literal["lowpass", "highpass"], rate: float
) -> LinearFilter:
    if corner is None:
        return LinearFilter(np.ones(1), np.ones(1))
    from scipy import signal

    return LinearFilter(*signal.butter(order, corner, kind, fs=rate))
