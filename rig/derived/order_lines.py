"""Order spectra of some channels, in pieces as a run brings them."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from daq.errors import UnphysicalParameter
from daq.signals.even_angles import AngleSampler, EvenAngles
from daq.signals.orders import order_map

POINTS = 1024
"""Even angles a turn: orders up to 0.44 of it come through."""

LOWEST_ORDER, HIGHEST_ORDER = 0.5, 0.4 * POINTS
"""What is drawn."""

_BANDS = 360
TURNS = 8
"""Of a block: orders are 1/8 apart. Blocks overlap by half."""

AVERAGED = 8
"""The newest blocks make the spectrum: 36 turns."""


class OrderLines:
    """Amplitudes over orders of c channels, averaged over the newest blocks of turns, all of them for None.

    What comes in pieces of any size gives what `order_map` gives of the whole. A hole in the samples or in
    their turns ends a block, and the next begins behind it.
    """

    def __init__(self, averaged: int | None = AVERAGED) -> None:
        self.blocks = 0
        self._squares: deque[NDArray[np.float64]] = deque(maxlen=averaged)
        self._restart()

    def _restart(self) -> None:
        self._sampler = AngleSampler(POINTS)
        self._first: int | None = None  # even angle that the kept values begin at
        self._even: NDArray[np.float64] = np.empty((0, 0))

    def add(self, values: NDArray[np.floating], turns: NDArray[np.float64]) -> None:
        """Take the next samples, shape (c, n), and their turns, shape (n,), NaN where unknown."""
        known = np.isfinite(turns)
        edges = np.flatnonzero(np.diff(known)) + 1
        for part in np.split(np.arange(len(turns)), edges):
            if not len(part):
                continue
            if known[part[0]]:
                self._take(values[:, part], turns[part])
            else:
                self._restart()

    def _take(self, values: NDArray[np.floating], turns: NDArray[np.float64]) -> None:
        try:
            found = self._sampler.add(values, turns)
        except UnphysicalParameter:  # the angle leapt: a new count of turns begins
            self._restart()
            return
        even, first = found.values, found.first
        if self._first is None:
            heard = np.isfinite(even).any(axis=0)  # a channel that is not must not silence the others
            if not heard.any():
                return
            start = int(np.argmax(heard))
            even, first = even[:, start:], first + start
            self._first, self._even = first, even[:, :0]
        self._even = np.concatenate((self._even, even), axis=1)
        assert self._first is not None  # noqa: S101  set before the first even angle is kept
        whole = TURNS * POINTS
        while self._even.shape[1] >= whole:
            blocks = (EvenAngles(self._first, row[:whole]) for row in self._even)
            rows = [order_map(block, POINTS, TURNS).amplitude[0] for block in blocks]
            self._squares.append(np.array(rows) ** 2)
            self.blocks += 1
            self._first += whole // 2
            self._even = self._even[:, whole // 2 :]

    @property
    def order(self) -> NDArray[np.float64]:
        """Orders of the lines, shape (m,)."""
        return np.arange(TURNS * POINTS // 2 + 1) / TURNS

    @property
    def amplitude(self) -> NDArray[np.float64] | None:
        """Root of the mean square, zero to peak in the channels' units, shape (c, m); None before a block.

        NaN for a channel of which no block is whole.
        """
        if not self._squares:
            return None
        squares = np.array(self._squares)
        heard = np.isfinite(squares).all(axis=2, keepdims=True)
        total, counted = np.where(heard, squares, 0.0).sum(axis=0), heard.sum(axis=0)
        mean = np.divide(total, counted, out=np.full_like(total, np.nan), where=counted > 0)
        return np.asarray(np.sqrt(mean))


def largest_in_bands(
    order: NDArray[np.float64], amplitude: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The largest line above 0 of each of many narrow bands, so that no peak is lost; shapes (k,)."""
    seen = (order >= LOWEST_ORDER) & (order <= HIGHEST_ORDER) & (amplitude > 0)
    order, amplitude = order[seen], amplitude[seen]
    if not len(order):
        return order, amplitude
    band = np.floor(np.log(order / LOWEST_ORDER) / math.log(HIGHEST_ORDER / LOWEST_ORDER) * _BANDS)
    begins = np.flatnonzero(np.diff(band, prepend=-1.0))
    ends = np.append(begins[1:], len(order))
    chosen = [first + int(np.argmax(amplitude[first:end])) for first, end in zip(begins, ends, strict=True)]
    return order[chosen], amplitude[chosen]
