"""Numbers that describe one cycle of one channel."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Samples: TypeAlias = NDArray[np.float64]
Features: TypeAlias = dict[str, float]

_LONGEST_LAG_S = 3e-3
_SILENT = 1e-12


def levels(cycle: Samples, rate: float, lowest_hz: float, bands_an_octave: int = 1) -> Features:
    """Largest, smallest and rms value, and the logarithm of the power in bands from `lowest_hz` up."""
    power = np.abs(np.fft.rfft(cycle)) ** 2 / len(cycle) ** 2
    frequency = np.fft.rfftfreq(len(cycle), 1 / rate)
    bands = int(bands_an_octave * np.log2(rate / 2 / lowest_hz))
    edges = lowest_hz * 2.0 ** (np.arange(1 + bands) / bands_an_octave)
    found = {"max": cycle.max(), "min": cycle.min(), "rms": np.sqrt(np.mean(cycle**2))}
    for low, high in pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        found[f"band {low:g}"] = np.log10(power[inside].sum() + _SILENT)
    return {name: float(value) for name, value in found.items()}


def orders(cycle: Samples, phase: Samples, wanted: Sequence[int]) -> Features:
    """Cosine and sine amplitudes at multiples of the cycle; `phase` in rad for each sample."""
    found: Features = {}
    for order in wanted:
        turned = 2 * np.mean(cycle * np.exp(-1j * order * phase))
        found |= {f"cos {order}": float(turned.real), f"sin {order}": float(turned.imag)}
    return found


def contacts(cycle: Samples, threshold: float) -> Features:
    """Onsets above `threshold`, share of time above it, and where in the cycle the first and the peak lie."""
    above = cycle > threshold
    onsets = np.flatnonzero(above[1:] & ~above[:-1])
    first = (onsets[0] + 1) / len(cycle) if len(onsets) else -1.0
    peak = float(np.argmax(cycle)) / len(cycle) if above.any() else -1.0
    return {"onsets": float(len(onsets)), "share": float(above.mean()), "first": float(first), "peak": peak}


def lag(one: Samples, other: Samples, rate: float) -> float:
    """By how many seconds `other` follows `one`: the highest correlation within 3 ms, between samples."""
    reach = round(_LONGEST_LAG_S * rate)
    spectrum = np.fft.rfft(one - one.mean()).conj() * np.fft.rfft(other - other.mean())
    wrapped = np.fft.irfft(spectrum, len(one))
    near = np.concatenate([wrapped[-reach:], wrapped[: reach + 1]])
    top = int(np.clip(np.argmax(near), 1, len(near) - 2))
    before, at, after = near[top - 1 : top + 2]
    bend = before - 2 * at + after
    fraction = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float((top - reach + np.clip(fraction, -1, 1)) / rate)
