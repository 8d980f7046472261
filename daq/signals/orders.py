"""Orders of a rotating machine: spectra over orders, and amplitude and phase of chosen orders along a run-up.

Order o is what runs o times a turn. Its line c, amplitude |c| (zero to peak) and phase arg c, stand for Re(c
e^(2 pi j o turn)): at turn 0 a cosine of phase 0 has its crest. The phase of an order that is no whole
number depends on which turn is 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from daq.errors import UnphysicalParameter
from daq.signals.even_angles import EvenAngles
from daq.signals.spectrum import Segmenting, usable

_APART = 4.0
"""Bins (1 / turns of a block) that tracked orders must lie apart for the fit to part them."""

_SPEED_DEGREE = 3


@dataclass(frozen=True, slots=True)
class OrderMap:
    """Lines over orders for b blocks of turns: `order` (m,), `turn` of the middle (b,), `lines` (b, m).

    Hann window, amplitude right at a line; NaN for a block with a value that is NaN.
    """

    order: NDArray[np.float64]
    turn: NDArray[np.float64]
    lines: NDArray[np.complex128]

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """In the channel's unit, shape (b, m)."""
        return np.abs(self.lines)

    @property
    def spectrum(self) -> NDArray[np.float64]:
        """Root of the mean square of `amplitude` over the blocks that are not NaN, shape (m,)."""
        good = self.amplitude[~np.isnan(self.lines).any(axis=1)]
        return np.sqrt(np.mean(good**2, axis=0)) if len(good) else np.full(len(self.order), np.nan)


@dataclass(frozen=True, slots=True)
class OrderTracks:
    """Lines, shape (o, b), of o orders in b blocks; NaN for a block with a sample that is NaN.

    `turn`, `time_s` (after the first sample) and `speed_hz` (turns a second), each of shape (b,), are those
    in the middle of a block; `order` has shape (o,).
    """

    order: NDArray[np.float64]
    turn: NDArray[np.float64]
    time_s: NDArray[np.float64]
    speed_hz: NDArray[np.float64]
    lines: NDArray[np.complex128]

    @property
    def amplitude(self) -> NDArray[np.float64]:
        """Zero to peak, in the channel's unit, shape (o, b)."""
        return np.abs(self.lines)

    @property
    def phase(self) -> NDArray[np.float64]:
        """In rad, from -pi to pi, shape (o, b)."""
        return np.angle(self.lines)


def order_map(even: EvenAngles, points: int, turns: int = 8, overlap: float = 0.5) -> OrderMap:
    """Spectra over orders of blocks of `turns` turns of one channel at `points` even angles a turn.

    Orders are 1/`turns` apart and reach up to `points`/2, of which what `AngleSampler` filters out is
    missing.
    """
    segmenting = Segmenting(points * turns, overlap)
    weights = segmenting.weights()
    order = np.arange(points * turns // 2 + 1) / turns
    starts = np.arange(0, len(even.values) - segmenting.samples + 1, segmenting.step)
    first = (even.first + starts) / points
    sides = np.where((order > 0) & (order < points / 2), 2.0, 1.0)
    lines = np.empty((len(starts), len(order)), dtype=np.complex128)
    for row, start in enumerate(starts):
        block = even.values[start : start + segmenting.samples]
        lines[row] = np.fft.rfft(block * weights) * sides / weights.sum()
    lines *= np.exp(-2j * np.pi * np.outer(first, order))
    return OrderMap(order, first + turns / 2, lines)


def order_tracks(
    values: NDArray[np.floating],
    sample_rate: float,
    turns: NDArray[np.floating],
    orders: Sequence[float],
    turns_a_block: float = 8.0,
    flagged: NDArray[np.bool_] | None = None,
) -> OrderTracks:
    """Amplitude and phase of `orders` along `values`, with their turns both of shape (n,), every half block.

    In each block all orders and the mean are fitted together by least squares under a Hann window, with
    amplitudes that may bend (parabolas over the block): no resampling, and orders do not leak into each
    other. What is not tracked must lie some four bins (4 / `turns_a_block`) away. Samples without a turn are
    left out. Raises UnphysicalParameter for tracked orders (0 among them) less than four bins apart.
    """
    chosen = np.asarray(orders, dtype=np.float64)
    apart = float(np.min(np.diff(np.sort(np.append(chosen, 0.0)))))
    if apart * turns_a_block < _APART:
        allowed = f"at least {_APART:g} over the turns of a block, here {_APART / turns_a_block:g}"
        raise UnphysicalParameter("order tracking", "distance of orders", apart, allowed)
    known = np.flatnonzero(np.isfinite(turns))
    signal, way = usable(values, flagged)[0][known], np.maximum.accumulate(turns[known])
    half = turns_a_block / 2
    centres = np.empty(0)
    if len(way):
        centres = np.arange(np.ceil(way[0] / half) + 1, np.floor(way[-1] / half)) * half
    speeds, lines = np.empty((2, len(centres))), np.empty((len(chosen), len(centres)), dtype=np.complex128)
    for block, centre in enumerate(centres):
        part = slice(*np.searchsorted(way, (centre - half, centre + half)))
        place, weight = (way[part] - centre) / half, np.gradient(way[part])
        weight *= np.cos(np.pi / 2 * place) ** 2
        times = polynomial.polyfit(place, known[part] / sample_rate, _SPEED_DEGREE, w=np.sqrt(weight))
        speeds[:, block] = times[0], half / times[1]
        if np.isnan(signal[part]).any():
            lines[:, block] = np.nan
            continue
        angle = 2 * np.pi * np.outer(chosen, way[part])
        steady = np.vstack((np.cos(angle), np.sin(angle), np.ones_like(place)))
        rows = np.vstack((steady, steady * place, steady * place**2))
        weighted = rows * weight
        found = np.linalg.solve(weighted @ rows.T, weighted @ signal[part])
        lines[:, block] = found[: len(chosen)] - 1j * found[len(chosen) : 2 * len(chosen)]
    return OrderTracks(chosen, centres, speeds[0], speeds[1], lines)
