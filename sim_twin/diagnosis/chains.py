"""Measuring chains over whole records, by their frequency responses: many at little cost.

The record is taken as one period, so that a high-pass is in its steady state.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from sim_twin.sensors import Encoder, Sensor, SensorChain

Array = NDArray[np.float64]


def through_chains(
    clean: Array, sensors: Sequence[Sensor], rate: float, quiet: float, rng: np.random.Generator
) -> list[NDArray[np.floating]]:
    """Samples of `clean` signals, shape (channels, n), as their sensors show them.

    Of the noise that they were recorded with, the share `quiet` (rms) is left at this `rate`.
    """
    return [_shown(row, sensor, rate, quiet, rng) for row, sensor in zip(clean, sensors, strict=True)]


def _shown(
    clean: Array, sensor: Sensor, rate: float, quiet: float, rng: np.random.Generator
) -> NDArray[np.floating]:
    if isinstance(sensor, Encoder):
        count = 2 * np.pi / sensor.counts
        return np.asarray(np.floor(clean / count) * count)
    noise = np.float32(quiet * sensor.noise) * rng.standard_normal(len(clean), np.float32)
    if not clean.any():
        return noise
    length = fft.next_fast_len(len(clean), real=True)
    padded = np.empty(length, np.float32)
    padded[: len(clean)] = clean
    padded[len(clean) :] = np.linspace(clean[-1], clean[0], length - len(clean))
    turned = fft.rfft(padded)
    turned *= _response(sensor, len(turned), rate / length)
    return np.asarray(fft.irfft(turned, length)[: len(clean)] + noise)


def _response(chain: SensorChain, count: int, resolution: float) -> NDArray[np.complex64]:
    """At multiples of `resolution` (Hz)."""
    response = chain.gain * _ramp(-2 * np.pi * chain.skew * resolution, count)
    if chain.bandwidth_corner is None and chain.droop_corner is None:
        return response.astype(np.complex64)
    frequency = resolution * np.arange(count)
    if chain.bandwidth_corner is not None:
        x = 1j * frequency / chain.bandwidth_corner
        response /= 1 + np.sqrt(2) * x + x**2
    if chain.droop_corner is not None:
        response *= 1j * frequency / (chain.droop_corner + 1j * frequency)
    return response.astype(np.complex64)


def _ramp(step: float, count: int) -> NDArray[np.complex128]:
    """exp(i k `step`), k = 0 ... `count` - 1, by products."""
    wide = 512
    coarse = np.exp(1j * step * wide * np.arange(-(-count // wide)))
    return np.outer(coarse, np.exp(1j * step * np.arange(wide))).ravel()[:count]
