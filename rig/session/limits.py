"""Watches the scenario's limits on what is measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.block import BLIND, Flag
from rig.files.scenario import Limit


@dataclass(frozen=True, slots=True)
class Passed:
    """A limit that was passed: `abort` or only a warning; `value` and `level` in the channel's unit."""

    channel: str
    unit: str
    value: float
    level: float
    abort: bool

    def __str__(self) -> str:
        if math.isnan(self.value):
            return f"{self.channel} is overloaded, open or not finite: its limit cannot be watched"
        return f"{self.channel} = {self.value:.4g} {self.unit}, limit {self.level:.4g} {self.unit}"


class LimitWatch:
    """Checks each channel's absolute value against its limits.

    A level counts as passed once the value has been beyond it for `hold` s without a break; each is told once
    until the channel has stayed below it for a whole block.
    """

    def __init__(self, limits: Sequence[Limit], sample_rate: float) -> None:
        self._limits = tuple(limits)
        self._hold = {limit.channel: max(1, round(limit.hold * sample_rate)) for limit in limits}
        self._beyond: dict[tuple[str, bool], int] = {}
        self._told: set[tuple[str, bool]] = set()

    def check(
        self, rows: Mapping[str, NDArray[np.floating]], flags: Mapping[str, Flag] | None = None
    ) -> list[Passed]:
        """Check the next samples, one row (n,) a channel; return what has been passed newly.

        A channel that `flags` marks as overloaded, open or not finite cannot be watched: with an abort level
        it counts as passed at once.
        """
        found: list[Passed] = []
        for limit in self._limits:
            if limit.abort is not None and flags and flags[limit.channel] & BLIND:
                found.append(Passed(limit.channel, limit.unit, math.nan, limit.abort, abort=True))
                continue
            values = np.abs(rows[limit.channel])
            for level, abort in ((limit.warning, False), (limit.abort, True)):
                if level is not None and self._held(limit, values, level, abort):
                    found.append(Passed(limit.channel, limit.unit, float(np.nanmax(values)), level, abort))
        return [passed for passed in found if self._news(passed)]

    def _held(self, limit: Limit, values: NDArray[np.floating], level: float, abort: bool) -> bool:
        beyond = values > level
        before = self._beyond.get((limit.channel, abort), 0)
        inside = np.flatnonzero(~beyond)
        longest = before + len(beyond)
        if len(inside):
            runs = np.diff(np.concatenate(([-1 - before], inside, [len(beyond)]))) - 1
            if inside[0] == 0:
                runs[0] = 0  # it ended with the last block, which has told of it
            longest = int(runs.max())
            before = -int(inside[-1]) - 1
        self._beyond[limit.channel, abort] = before + len(beyond)
        if not beyond.any():
            self._told.discard((limit.channel, abort))
        return longest >= self._hold[limit.channel]

    def _news(self, passed: Passed) -> bool:
        key = (passed.channel, passed.abort)
        news = key not in self._told
        self._told.add(key)
        return news
