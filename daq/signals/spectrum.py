"""Autospectra of one channel: density, power and amplitude of the same average over segments.

All are one-sided and hold no line at 0 Hz, because each segment's mean is removed. With a segment x, a window
w and the lines X = rfft(w x), the density is 2 |X|^2 / (rate sum w^2), the power 2 |X|^2 / (sum w)^2; at half
the sampling rate, a line without a mirror, without the 2. The average is that of |X|^2.
Welch 1967, doi:10.1109/TAU.1967.1161901.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from daq.errors import UnphysicalParameter

_FEWEST_SAMPLES = 4
RESOLUTION_HZ = 2.0
_SHORTEST_RECORD = 16
_REFERENCE_HZ = 1000.0
_NOMINAL = np.array([1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0])
"""Nominal midband frequencies of a decade (IEC 61260-1:2014)."""


@dataclass(frozen=True, slots=True, eq=False)
class Segmenting:
    """How a record is cut: `samples` a segment, the share (0 to below 1) by which they overlap, the window.

    `window` is a name that scipy.signal.get_window knows (periodic form), or its weights, shape (samples,).
    """

    samples: int
    overlap: float = 0.5
    window: str | tuple[str, float] | NDArray[np.floating] = "hann"

    def __post_init__(self) -> None:
        if self.samples < _FEWEST_SAMPLES:
            raise UnphysicalParameter("segments", "samples", self.samples, f"at least {_FEWEST_SAMPLES}")
        if not 0 <= self.overlap < 1:
            raise UnphysicalParameter("segments", "overlap", self.overlap, "0 to below 1")
        if not isinstance(self.window, str | tuple) and len(self.window) != self.samples:
            raise UnphysicalParameter(
                "segments", "weights of the window", len(self.window), f"{self.samples}, one a sample"
            )

    @property
    def step(self) -> int:
        """Samples from the start of one segment to the start of the next."""
        return self.samples - int(self.overlap * self.samples)

    def weights(self) -> NDArray[np.float64]:
        """The window, shape (samples,)."""
        if isinstance(self.window, str | tuple):
            return _named_window(self.window, self.samples)
        return np.asarray(self.window, dtype=np.float64)


@lru_cache(maxsize=16)
def _named_window(name: str | tuple[str, float], samples: int) -> NDArray[np.float64]:
    """Weights by name, read-only: a live view asks for the same ones a hundred times a second."""
    weights = np.asarray(signal.get_window(name, samples), dtype=np.float64)
    weights.flags.writeable = False
    return weights


class SegmentCutter:
    """Cuts blocks of several channels into segments and carries what is left from block to block."""

    def __init__(self, segmenting: Segmenting) -> None:
        self._samples, self._step = segmenting.samples, segmenting.step
        self._kept: NDArray[np.float64] | None = None

    def add(self, values: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
        """Segments, shape (channels, samples), that `values`, shape (channels, n), complete."""
        kept = values if self._kept is None else np.concatenate((self._kept, values), axis=1)
        count = max((kept.shape[1] - self._samples) // self._step + 1, 0)
        self._kept = kept[:, count * self._step :].copy()
        for first in range(0, count * self._step, self._step):
            # A copy, so that every segment lies in memory in the same way: sums are then equal to the bit.
            yield kept[:, first : first + self._samples].copy()


def usable(values: ArrayLike, flagged: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
    """A copy of `values`, shape (n,) or (channels, n), as (channels, n), NaN where it must not be used.

    That is where it is not finite or `flagged`, of shape (n,) or (channels, n), is True.
    """
    copy = np.array(values, dtype=np.float64, ndmin=2)
    bad = ~np.isfinite(copy)
    copy[bad if flagged is None else bad | flagged] = np.nan
    return copy


def windowed_lines(segment: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Fourier lines above 0 Hz of a segment, shape (channels, samples), less its mean, times the window."""
    centred = segment - segment.mean(axis=1, keepdims=True)
    return np.asarray(np.fft.rfft(centred * weights, axis=1)[:, 1:])


def line_frequencies(samples: int, sample_rate: float) -> NDArray[np.float64]:
    """Frequencies in Hz of the lines of `windowed_lines`, shape (samples // 2,)."""
    return np.arange(1, samples // 2 + 1, dtype=np.float64) * (sample_rate / samples)


def density_scale(weights: NDArray[np.float64], sample_rate: float) -> NDArray[np.float64]:
    """What turns the squares of `windowed_lines` into a one-sided density in 1/Hz, shape (samples // 2,).

    A line at half the sampling rate has no mirror below zero and counts once.
    """
    frequency = line_frequencies(len(weights), sample_rate)
    return np.where(frequency < sample_rate / 2, 2.0, 1.0) / (sample_rate * float(np.sum(weights**2)))


def without_gap(segment: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which channels of a segment, shape (channels, samples), hold no NaN, shape (channels,)."""
    return np.asarray(~np.isnan(segment).any(axis=1))


class Autospectrum(NamedTuple):
    """One-sided autospectral density: frequencies in Hz, shape (m,), and density in unit^2/Hz, shape (m,)."""

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AveragedSpectrum:
    """The average over `averages` segments; arrays have shape (m,) and hold NaN where there was no segment.

    `density` in unit^2/Hz: what noise has, whatever the window. `noise_bandwidth_hz` is the width of the
    window's ideal counterpart for noise.
    """

    frequency_hz: NDArray[np.float64]
    density: NDArray[np.float64]
    noise_bandwidth_hz: float
    sample_rate: float
    averages: int

    @property
    def power(self) -> NDArray[np.float64]:
        """Mean square in unit^2: A^2/2 at the line of a sine of amplitude A."""
        return self.density * self.noise_bandwidth_hz

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """Amplitude (zero to peak) in unit: A at the line of a sine of amplitude A."""
        mirrored = self.frequency_hz < self.sample_rate / 2
        return np.sqrt(np.where(mirrored, 2.0, 1.0) * self.power)


class SpectrumAverage:
    """Autospectrum of a channel whose samples come in blocks of any size; the cuts leave no trace.

    A segment with a sample that is flagged or not finite is left out; hand samples that are missing over as
    NaN. Once `memory` segments are in, each new one counts 1/`memory` (exponential average); else all count
    alike.
    """

    def __init__(self, sample_rate: float, segmenting: Segmenting, memory: int | None = None) -> None:
        self._sample_rate = sample_rate
        self._cutter = SegmentCutter(segmenting)
        self._weights = segmenting.weights()
        self._memory = memory
        self._count = 0
        self._mean = np.full(segmenting.samples // 2, np.nan)

    def add(self, values: NDArray[np.floating], flagged: NDArray[np.bool_] | None = None) -> None:
        """Take the next samples, shape (n,); those where `flagged`, shape (n,), is True must not count."""
        for segment in self._cutter.add(usable(values, flagged)):
            if without_gap(segment)[0]:
                self.add_segment(segment)

    def add_segment(self, segment: NDArray[np.float64]) -> None:
        """Take a segment, shape (1, samples), all of it finite."""
        lines = windowed_lines(segment, self._weights)[0]
        power = lines.real**2 + lines.imag**2
        self._count += 1
        mean = power if self._count == 1 else self._mean
        self._mean = mean + (power - mean) / min(self._count, self._memory or self._count)

    def result(self) -> AveragedSpectrum:
        square, total = float(np.sum(self._weights**2)), float(np.sum(self._weights))
        return AveragedSpectrum(
            frequency_hz=line_frequencies(len(self._weights), self._sample_rate),
            density=self._mean * density_scale(self._weights, self._sample_rate),
            noise_bandwidth_hz=self._sample_rate * square / total**2,
            sample_rate=self._sample_rate,
            averages=self._count,
        )


def averaged_spectrum(
    values: NDArray[np.floating],
    sample_rate: float,
    segmenting: Segmenting,
    flagged: NDArray[np.bool_] | None = None,
) -> AveragedSpectrum:
    """What `SpectrumAverage` finds in the whole of `values`, shape (n,)."""
    average = SpectrumAverage(sample_rate, segmenting)
    average.add(values, flagged)
    return average.result()


def autospectrum(
    values: NDArray[np.floating], sample_rate: float, resolution_hz: float = RESOLUTION_HZ
) -> Autospectrum:
    """Welch's estimate (Hann window, half overlap, mean removed) of `values`, shape (n,), in unit^2/Hz.

    Segments last 1/`resolution_hz`, or as long as the record where that is shorter. Samples that are not
    finite part the record: the longest finite stretch is used. Empty where that has under 16 samples.
    """
    finite = longest_finite(values)
    if len(finite) < _SHORTEST_RECORD:
        return Autospectrum(np.empty(0), np.empty(0))
    samples = min(len(finite), max(round(sample_rate / resolution_hz), _SHORTEST_RECORD))
    segmenting = Segmenting(samples)
    average = SpectrumAverage(sample_rate, segmenting)
    for first in range(0, len(finite) - samples + 1, segmenting.step):
        average.add_segment(np.array(finite[first : first + samples], dtype=np.float64, ndmin=2))
    spectrum = average.result()
    return Autospectrum(spectrum.frequency_hz, spectrum.density)


def longest_finite(values: NDArray[np.floating]) -> NDArray[np.floating]:
    """Longest run of `values`, shape (n,), without NaN or infinity."""
    bad = np.flatnonzero(~np.isfinite(values))
    edges = np.concatenate(([-1], bad, [len(values)]))
    longest = int(np.argmax(np.diff(edges)))
    return values[edges[longest] + 1 : edges[longest + 1]]


def log_bands(spectrum: Autospectrum, bands: int) -> Autospectrum:
    """Mean density in at most `bands` bands, equally wide on a logarithmic axis; none for an empty band."""
    frequency, density = spectrum
    if len(frequency) == 0:
        return spectrum
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), bands + 1)
    # Few edges are sought among many frequencies: the reverse takes far longer.
    first = np.searchsorted(frequency, edges[1:-1])
    count = np.diff(first, prepend=0, append=len(frequency))
    band = np.repeat(np.arange(bands), count)
    filled = count > 0
    return Autospectrum(
        np.bincount(band, frequency, bands)[filled] / count[filled],
        np.bincount(band, density, bands)[filled] / count[filled],
    )


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
