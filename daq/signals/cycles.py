"""Figures of each cycle of the drive or revolution of the crank."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from daq.signals.segments import usable

_ROUNDING = 1e-6
"""Of a sample: how far the end of a record may fall short of the end of a cycle."""


@dataclass(frozen=True, slots=True)
class CycleFigures:
    """One row a whole cycle, every array of shape (m,); all but numbers and counts in the channel's unit.

    `cycle` is the whole part of its turns, `samples` how many it has. A cycle with a sample that is flagged,
    not finite or without a turn has NaN.
    """

    cycle: NDArray[np.int64]
    samples: NDArray[np.int64]
    mean: NDArray[np.float64]
    rms: NDArray[np.float64]
    minimum: NDArray[np.float64]
    maximum: NDArray[np.float64]

    @property
    def peak(self) -> NDArray[np.float64]:
        """Largest magnitude."""
        return np.maximum(np.abs(self.minimum), np.abs(self.maximum))

    def __len__(self) -> int:
        return len(self.cycle)


@dataclass(slots=True)
class _Running:
    """A cycle so far. Sums are taken one by one, so that they do not depend on how blocks cut it."""

    cycle: int
    whole: bool
    samples: int = 0
    total: float = 0.0
    square: float = 0.0
    minimum: float = np.inf
    maximum: float = -np.inf

    def add(self, values: NDArray[np.float64]) -> None:
        self.samples += len(values)
        self.total = _one_by_one(self.total, values)
        self.square = _one_by_one(self.square, values * values)
        self.minimum = float(np.minimum(self.minimum, values.min()))
        self.maximum = float(np.maximum(self.maximum, values.max()))


class CycleMeter:
    """Figures of the cycles of a channel whose samples come in blocks of any size; the cuts leave no trace.

    A sample belongs to the cycle that is the whole part of its turns; turns that go back stay in it. A cycle
    that had begun before the first sample is left out.
    """

    def __init__(self) -> None:
        self._running: _Running | None = None
        self._turns = np.empty(0)  # of the last two samples

    def add(
        self,
        values: NDArray[np.floating],
        turns: NDArray[np.floating],
        flagged: NDArray[np.bool_] | None = None,
    ) -> CycleFigures:
        """Take the next samples, their turns and flags, all of shape (n,); return the cycles that ended."""
        news = usable(values, flagged)[0]
        news[np.isnan(turns)] = np.nan
        way = np.fmax.accumulate(np.concatenate((self._turns[-1:], turns)))[len(self._turns[-1:]) :]
        known = np.isfinite(way)
        news, way = news[known], way[known]
        self._turns = np.concatenate((self._turns, way))[-2:]
        number = np.floor(way).astype(np.int64)
        begins = np.flatnonzero(np.diff(number, prepend=number[:1] - 1))
        ended = []
        for first, end in zip(begins, [*begins[1:], len(number)], strict=False):
            running = self._running
            if running is None or running.cycle != number[first]:
                ended += [running] if running is not None and running.whole else []
                whole = running is not None or bool(way[first] == number[first])
                running = self._running = _Running(int(number[first]), whole)
            running.add(news[first:end])
        return _figures(ended)

    def finish(self) -> CycleFigures:
        """The last cycle, if the record ends where it does."""
        running, self._running = self._running, None
        if running is None or not running.whole or len(self._turns) <= 1:
            return _figures([])
        step = float(self._turns[1] - self._turns[0])
        return _figures([running] if self._turns[1] + (1 + _ROUNDING) * step >= running.cycle + 1 else [])


def cycle_figures(
    values: NDArray[np.floating],
    turns: NDArray[np.floating],
    flagged: NDArray[np.bool_] | None = None,
) -> CycleFigures:
    """What `CycleMeter` finds in a whole record."""
    meter = CycleMeter()
    parts = meter.add(values, turns, flagged), meter.finish()
    columns = (
        np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(CycleFigures)
    )
    return CycleFigures(*columns)


def _figures(rows: list[_Running]) -> CycleFigures:
    samples = np.array([row.samples for row in rows], dtype=np.int64)
    return CycleFigures(
        cycle=np.array([row.cycle for row in rows], dtype=np.int64),
        samples=samples,
        mean=np.array([row.total for row in rows]) / samples,
        rms=np.sqrt(np.array([row.square for row in rows]) / samples),
        minimum=np.array([row.minimum for row in rows]),
        maximum=np.array([row.maximum for row in rows]),
    )


def _one_by_one(start: float, values: NDArray[np.float64]) -> float:
    return float(np.add.accumulate(np.concatenate(([start], values)))[-1])
