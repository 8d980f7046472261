"""A measuring chain of its own for the blind check: from the engine's fine truth to channel samples.

In order: skew and second-order low-pass (both in the frequency domain), linear-phase anti-alias filter with
decimation, first-order high-pass in steady state, gain, faults, white noise, 24-bit quantisation, a wrong
factor. No net delay.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal

from benchmarks.blind.catalogue import swapped_by

Array: TypeAlias = NDArray[np.float64]
Fault: TypeAlias = Callable[[Array, float, np.random.Generator], Array]
"""What a channel's electronics do wrong: samples, sample rate in Hz, random numbers -> samples."""

_SIDE_LOBES_DB = 84.0
_TAPS_PER_FACTOR = 62

WIRING = ("sensor_factor", "swapped_channels", "analog_delay")
"""What is wrong between sensors and card; any rig's chains know it."""


@dataclass(frozen=True, slots=True)
class Chain:
    """One channel. `noise` rms and `full_scale` in its unit; it shows x(t - `skew`), skew in s.

    `high_pass` and `low_pass` are corner frequencies in Hz, None where the channel has none. `factor` is what
    a wrong sensitivity or sign makes of its numbers.
    """

    noise: float
    full_scale: float
    gain: float = 1.0
    skew: float = 0.0
    high_pass: float | None = None
    low_pass: float | None = None
    faults: tuple[Fault, ...] = ()
    factor: float = 1.0


def healthy(rng: np.random.Generator, noise: float, full_scale: float, gain_spread: float = 0.005) -> Chain:
    """A chain as a healthy rig may have it: gain within `gain_spread`, skew within 2 us (both one sigma)."""
    return Chain(noise, full_scale, 1 + gain_spread * rng.standard_normal(), 2e-6 * rng.standard_normal())


def altered(chain: Chain, channel: str, effects: Sequence[Mapping[str, Any]]) -> Chain:
    """The `chain` of an analog channel with those of the sensor and clock effects that concern it."""
    for effect in effects:
        values = effect["parameters"]
        if effect["name"] == "analog_delay":
            chain = replace(chain, skew=chain.skew + values["seconds"])
        if values.get("channel") != channel:
            continue
        if effect["name"] == "sensor_gain":
            chain = replace(chain, gain=chain.gain * values["gain"])
        elif effect["name"] == "sensor_factor":
            chain = replace(chain, factor=chain.factor * values["factor"])
        elif effect["name"] == "sensor_droop":
            chain = replace(chain, high_pass=values["corner_hz"])
        elif effect["name"] == "sensor_bandwidth":
            chain = replace(chain, low_pass=values["corner_hz"])
        elif effect["name"] == "time_skew":
            chain = replace(chain, skew=chain.skew + values["seconds"])
    return chain


def plugged(fine: Mapping[str, Array], effects: Sequence[Mapping[str, Any]]) -> dict[str, Array]:
    """The signals by the channels that their sensors are plugged into."""
    found = dict(fine)
    for effect in effects:
        if effect["name"] == "swapped_channels":
            one, other = swapped_by(effect["parameters"])
            found[one], found[other] = found[other], found[one]
    return found


def sensed(
    fine: Array,
    factor: int,
    sample_rate: float,
    lead: int,
    count: int,
    chain: Chain,
    rng: np.random.Generator,
) -> Array:
    """Return `count` samples at `sample_rate` Hz of `fine`, sampled `factor` times as fast.

    `lead`: samples at `sample_rate` that `fine` holds before sample 0. It should go on for a few milliseconds
    after the last sample; ends that the filters reach beyond are held.
    """
    delayed = _delayed(fine, factor * sample_rate, chain.skew, chain.low_pass)
    samples = _decimated(delayed, factor)
    if chain.high_pass is not None:
        samples = _high_passed(samples, sample_rate, chain.high_pass)
    samples = chain.gain * samples[lead : lead + count]
    if len(samples) < count:
        raise ValueError(f"{count - len(samples)} samples are missing at the end")
    for fault in chain.faults:
        samples = fault(samples, sample_rate, rng)
    shown = quantised(samples + chain.noise * rng.standard_normal(count), chain.full_scale)
    return np.asarray(chain.factor * shown)


def quantised(samples: Array, full_scale: float) -> Array:
    """Round to one of 2**24 steps over -`full_scale` to `full_scale`."""
    step = full_scale / 2**23
    return np.asarray(step * np.clip(np.rint(samples / step), -(2**23), 2**23 - 1))


def _delayed(x: Array, rate: float, skew: float, corner: float | None) -> Array:
    margin = round(0.01 * rate) + abs(round(2 * skew * rate))
    padded = np.pad(x, margin, mode="edge")
    size = fft.next_fast_len(len(padded), real=True)
    f = fft.rfftfreq(size, 1 / rate)
    response = np.exp(-2j * np.pi * f * skew)
    if corner is not None:
        s = 1j * f / corner
        response /= s**2 + np.sqrt(2) * s + 1
    y = fft.irfft(fft.rfft(padded, size) * response, size)
    return np.asarray(y[margin : margin + len(x)])


def _decimated(x: Array, factor: int) -> Array:
    taps = anti_alias(factor)
    half = len(taps) // 2
    count = -(-len(x) // factor)
    return np.asarray(signal.upfirdn(taps, np.pad(x, half, mode="edge"), down=factor))[
        len(taps) // factor : len(taps) // factor + count
    ]


@lru_cache
def anti_alias(factor: int) -> Array:
    """Taps at the fine rate: flat to 0.45, 80 dB down from 0.55 of the coarse rate; their number is odd.

    `factor`: fine over coarse rate, at least 2.
    """
    window = ("chebwin", _SIDE_LOBES_DB)
    return np.asarray(signal.firwin(_TAPS_PER_FACTOR * factor + 1, 0.5, window=window, fs=float(factor)))


def _high_passed(x: Array, rate: float, corner: float) -> Array:
    """x less its own running mean; the running mean starts at the mean of all."""
    pole = np.exp(-2 * np.pi * corner / rate)
    mean, _ = signal.lfilter([1 - pole], [1, -pole], x, zi=[pole * x.mean()])
    return np.asarray(x - mean)
