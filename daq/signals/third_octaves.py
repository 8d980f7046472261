"""One-third-octave bands of a spectrum, with the exact midband frequencies of IEC 61260-1:2014."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.signals.spectrum import Autospectrum

_REFERENCE_HZ = 1000.0
_NOMINAL = np.array([1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0])
"""Nominal midband frequencies of a decade (IEC 61260-1:2014)."""


class ThirdOctaves(NamedTuple):
    """One row a band, every array of shape (b,): frequencies in Hz and the mean square in unit^2."""

    nominal_hz: NDArray[np.float64]
    midband_hz: NDArray[np.float64]
    lower_hz: NDArray[np.float64]
    upper_hz: NDArray[np.float64]
    mean_square: NDArray[np.float64]


def third_octaves(spectrum: Autospectrum) -> ThirdOctaves:
    """Mean square of all bands that the lines of `spectrum` (evenly spaced, without 0 Hz) reach into.

    Midband frequencies 1000 Hz x 10^(n/10), edges a factor 10^(1/20) below and above (IEC 61260-1:2014,
    clause 5, G = 10^(3/10)). The edges are sharp, unlike those of a filter of a class. A line's power is
    spread evenly over its spacing, so the bands add up to the mean square of the spectrum; a band narrower
    than the spacing shows no more than its share. The highest may reach beyond half the sampling rate.
    """
    frequency, density = spectrum
    if not len(frequency):
        return ThirdOctaves(*(np.empty(0) for _ in ThirdOctaves._fields))
    spacing = frequency[0]
    limits = np.concatenate(([spacing / 2], frequency + spacing / 2))
    number = np.arange(_band_of(limits[0]), _band_of(limits[-1]) + 1)
    midband = _REFERENCE_HZ * 10 ** (number / 10)
    edges = _REFERENCE_HZ * 10 ** ((np.append(number, number[-1] + 1) - 0.5) / 10)
    below = np.interp(edges, limits, np.concatenate(([0.0], np.cumsum(density) * spacing)))
    nominal = np.round(_NOMINAL[number % 10] * 10.0 ** (number // 10) * _REFERENCE_HZ, 9)
    return ThirdOctaves(nominal, midband, edges[:-1], edges[1:], np.diff(below))


def _band_of(frequency_hz: float) -> int:
    """Number of the band that holds a frequency; 0 is that of 1 kHz."""
    return int(np.floor(10 * np.log10(frequency_hz / _REFERENCE_HZ) + 0.5))
