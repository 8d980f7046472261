"""A plant whose sensors and cables fail as it is rehearsed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
from nidaqmx.error_codes import DAQmxErrors
from numpy.typing import NDArray

from drivers.ni_daq.emulator.wiring import DaqmxError
from drivers.protocols.card import Plant
from drivers.rehearsal import Rehearsal, Rehearsed

_BEYOND = 1e12  # of whatever unit: more than any input takes
_HIGH_V = 1.0  # above the noise of a marker's low level, below its 5 V
_LASTING = ("marks_missing", "marks_doubled", "marks_late", "offset")
_CHATTER_S, _CHATTERS_EVERY_S = 0.02, 0.1
_GLITCH_S, _GLITCH_AFTER_S = 5e-4, 0.02  # after the mark, which is over by then from 42 rpm on


class SpoiltPlant:
    """What the sensors of `plant` show, but for `faults`; one that names no channel hits the first.

    `press` is called where a person presses the emergency stop.
    """

    def __init__(
        self,
        plant: Plant[Any],
        faults: Iterable[Rehearsed],
        seed: int,
        press: Callable[[], None] = lambda: None,
    ) -> None:
        self._plant, self.channels, self.drive, self._press = plant, plant.channels, plant.drive, press
        self._rehearsal = Rehearsal(faults, seed)
        self.loose: frozenset[str] = frozenset()
        """Channels whose cables have come loose."""
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
            if fault.kind == "stop_pressed":
                self._press()
                continue
            if fault.kind == "comes_loose":  # the converter makes of it what an idle input shows
                self.loose |= {self.channels[self._row(fault)]}
                continue
            lasts_s = np.inf if fault.kind in _LASTING else fault.number("for")
            self._going.append((self._made + lasts_s * self._rate, self._failure(fault, shown)))
        self._made += count
        for until, spoil in self._going:
            if until > self._made - count:
                spoil(shown)
        return shown

    def _row(self, fault: Rehearsed) -> int:
        return next(at for at, name in enumerate(self.channels) if name.endswith(fault.channel))

    def _failure(self, fault: Rehearsed, shown: NDArray[np.float64]) -> Callable[[NDArray[np.float64]], None]:
        row = self._row(fault)
        lot = self._rehearsal.lot.random
        match fault.kind:
            case "marks_missing":
                return _Marks(row, lambda: math.inf if lot() < fault.number("share") else 0.0)
            case "marks_late":
                return _Marks(row, lambda: fault.number("by") * lot() * self._rate)
            case "marks_doubled":
                glitch = round(_GLITCH_AFTER_S * self._rate), max(round(_GLITCH_S * self._rate), 1)
                return _Marks(row, lambda: 0.0, lambda: lot() < fault.number("share"), glitch)
            case "chatters":
                return _Chatter(row, fault.number("height"), self._rate)
            case "offset":
                return partial(_raise, row, fault.number("by"))
        value = {"clips": _BEYOND, "not_finite": np.nan}.get(fault.kind, float(shown[row, 0]))
        part = slice(0, 1) if fault.kind == "not_finite" else slice(None)

        def spoil(block: NDArray[np.float64]) -> None:
            block[row, part] = value

        return spoil


def _raise(row: int, by: float, block: NDArray[np.float64]) -> None:
    block[row] += by


class _Marks:
    """Takes away from pulses of a row whose low level is 0 V, or adds to them.

    Of each pulse the first `lacks()` samples are low. Where it is `doubled()`, another follows its beginning:
    after how many samples, and how long, says `glitch`.
    """

    def __init__(
        self,
        row: int,
        lacks: Callable[[], float],
        doubled: Callable[[], bool] = lambda: False,
        glitch: tuple[int, int] = (0, 0),
    ) -> None:
        self._row, self._lacks, self._doubled, self._glitch = row, lacks, doubled, glitch
        self._made, self._last, self._low_until = 0, -2, 0.0  # -2: no sample is right behind it
        self._high: tuple[int, int] = (0, 0)

    def __call__(self, block: NDArray[np.float64]) -> None:
        row = block[self._row]
        for at in np.flatnonzero(row > _HIGH_V).tolist():
            if self._made + at != self._last + 1:  # a new pulse
                self._low_until = self._made + at + self._lacks()
                if self._doubled():
                    first = self._made + at + self._glitch[0]
                    self._high, self._level = (first, first + self._glitch[1]), row[at]
            self._last = self._made + at
            if self._last < self._low_until:
                row[at] = 0.0
        first, end = (max(each - self._made, 0) for each in self._high)
        if first < end:
            row[first:end] = self._level
        self._made += block.shape[1]


class _Chatter:
    """Adds `height` to a row now and then."""

    def __init__(self, row: int, height: float, rate: float) -> None:
        self._row, self._height, self._made = row, height, 0
        self._long, self._every = round(_CHATTER_S * rate), round(_CHATTERS_EVERY_S * rate)

    def __call__(self, block: NDArray[np.float64]) -> None:
        at = self._made + np.arange(block.shape[1])
        block[self._row] += self._height * (at % self._every < self._long)
        self._made += block.shape[1]
