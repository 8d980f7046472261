"""Autospectra of one channel."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

RESOLUTION_HZ = 2.0
_FEWEST_SAMPLES = 16


class Autospectrum(NamedTuple):
    """One-sided autospectral density: frequencies in Hz, shape (m,), and density in unit^2/Hz, shape (m,)."""

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]


def autospectrum(
    values: NDArray[np.floating], sample_rate: float, resolution_hz: float = RESOLUTION_HZ
) -> Autospectrum:
    """Welch's estimate (Hann window, half overlap, mean removed) of `values`, shape (n,), in unit^2/Hz.

    Segments last 1/`resolution_hz`, or as long as the record where that is shorter. Samples that are not
    finite part the record: the longest finite stretch is used. Empty where that has under 16 samples.
    Welch 1967, doi:10.1109/TAU.1967.1161901.
    """
    finite = longest_finite(values)
    if len(finite) < _FEWEST_SAMPLES:
        return Autospectrum(np.empty(0), np.empty(0))
    segment = min(len(finite), max(round(sample_rate / resolution_hz), _FEWEST_SAMPLES))
    frequency, density = signal.welch(finite, sample_rate, nperseg=segment)
    return Autospectrum(
        np.asarray(frequency[1:], dtype=np.float64), np.asarray(density[1:], dtype=np.float64)
    )


def longest_finite(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Longest run of `values`, shape (n,), without NaN or infinity."""
    bad = np.flatnonzero(~np.isfinite(values))
    if not len(bad):
        return values
    edges = np.concatenate(([-1], bad, [len(values)]))
    longest = int(np.argmax(np.diff(edges)))
    return values[edges[longest] + 1 : edges[longest + 1]]


def log_bands(spectrum: Autospectrum, bands: int) -> Autospectrum:
    """Mean density in at most `bands` bands, equally wide on a logarithmic axis; none for an empty band."""
    frequency, density = spectrum
    if len(frequency) == 0:
        return spectrum
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), bands + 1)
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, bands - 1)
    count = np.bincount(band, minlength=bands)
    filled = count > 0
    return Autospectrum(
        np.bincount(band, frequency, bands)[filled] / count[filled],
        np.bincount(band, density, bands)[filled] / count[filled],
    )
