"""A record cut into overlapping, windowed segments, the same whether it comes whole or in blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import signal

from daq.errors import UnphysicalParameter

_FEWEST_SAMPLES = 4


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
