"""A plant whose sensors and cables fail as it is rehearsed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import NDArray

from drivers.ni_daq.emulator.wiring import DaqmxError
from drivers.protocols.card import Plant
from drivers.rehearsal import Rehearsal, Rehearsed

_BEYOND = 1e12  # of whatever unit: more than any input takes
_HIGH_V = 1.0  # above the noise of a marker's low level, below its 5 V


class SpoiltPlant:
    """What the sensors of `plant` show, but for `faults`; one that names no channel hits the first."""

    def __init__(self, plant: Plant[Any], faults: Iterable[Rehearsed], seed: int) -> None:
        self._plant, self.channels, self.drive = plant, plant.channels, plant.drive
        self._rehearsal = Rehearsal(faults, seed)
        self._going: list[tuple[float, Callable[[NDArray[np.float64]], None]]] = []
        self._made, self._rate = 0, 1.0  # samples since the start, and Hz

    def start(self, sample_rate: float) -> None:
        """As any plant."""
        self._plant.start(sample_rate)
        self._made, self._rate = 0, sample_rate

    def advance(self, count: int) -> NDArray[np.float64]:
        """As any plant; raises `DaqmxError` where the card itself is to fail."""
        shown = self._plant.advance(count)
        for fault in self._rehearsal.due(self._made / self._rate):
            if fault.kind == "overruns":
                text = "samples were overwritten before they were read"
                raise DaqmxError(DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE, text)
            lasts_s = np.inf if fault.kind == "marks_missing" else fault.number("for")  # each mark by lot
            self._going.append((self._made + lasts_s * self._rate, self._failure(fault, shown)))
        self._made += count
        for until, spoil in self._going:
            if until > self._made - count:
                spoil(shown)
        return shown

    def _failure(self, fault: Rehearsed, shown: NDArray[np.float64]) -> Callable[[NDArray[np.float64]], None]:
        row = next(at for at, name in enumerate(self.channels) if name.endswith(fault.channel))
        if fault.kind == "marks_missing":
            return _MissingMarks(row, fault.number("share"), self._rehearsal.lot.random)
        value = {"clips": _BEYOND, "not_finite": np.nan}.get(fault.kind, float(shown[row, 0]))
        part = slice(0, 1) if fault.kind == "not_finite" else slice(None)

        def spoil(block: NDArray[np.float64]) -> None:
            block[row, part] = value

        return spoil


class _MissingMarks:
    """Leaves out a share of the pulses of a row whose low level is 0 V."""

    def __init__(self, row: int, share: float, lot: Callable[[], float]) -> None:
        self._row, self._share, self._lot = row, share, lot
        self._made, self._last, self._left_out = 0, -2, False  # -2: no sample is right behind it

    def __call__(self, block: NDArray[np.float64]) -> None:
        for at in np.flatnonzero(block[self._row] > _HIGH_V).tolist():
            if self._made + at != self._last + 1:  # a new pulse, whose fate holds for all of it
                self._left_out = self._lot() < self._share
            self._last = self._made + at
            if self._left_out:
                block[self._row, at] = 0.0
        self._made += block.shape[1]
