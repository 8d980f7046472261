"""An instrument that is asked now and then, recorded beside the card on the run's time base."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from daq.block import Flag, SampleBlock, as_logged
from daq.errors import InstrumentSilent, RattleError, show_fault
from daq.log.records import Event, Gap
from daq.time_base.clocks import CardClock
from drivers.protocols.instrument import Logger
from rig.session.acquisition import JOIN_S
from rig.stream import Block, Stream

_ROUNDING = 1e-6
"""Of a period: no reading is due at the very end."""


class LoggerRecord:
    """Asks a logger in a thread of its own, once a period from `begin` to `end`.

    Reading k is asked for k periods after `begin`, and stands in the log with the time at which it was. One
    that does not come is a gap, the last ones too; whatever else goes wrong with a logger ends its record
    with a warning, not the run.
    """

    def __init__(self, logger: Logger, base: CardClock, stream: Stream) -> None:
        self._logger, self._base, self._stream = logger, base, stream
        self._begin_s = self._end_s = math.inf
        self.lost = False
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name=logger.name, daemon=True)

    def __enter__(self) -> LoggerRecord:
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        if self._thread.is_alive():
            self._thread.join(JOIN_S)

    def begin(self, begin_s: float, end_s: float) -> None:
        """Record from this time on and before that one at the latest, s since the card's sample 0."""
        self._begin_s, self._end_s = begin_s, end_s
        self._thread.start()

    def end(self, end_s: float) -> None:
        """End the record there."""
        self._end_s = min(self._end_s, end_s)
        self._done.set()

    def due(self, by_s: float) -> int:
        """How many readings are due by then since the record began."""
        until_s = min(by_s, self._end_s)
        return math.ceil(max((until_s - self._begin_s) / self._logger.period_s - _ROUNDING, 0.0))

    def _run(self) -> None:
        number = due = wanted = 0  # of the next reading; behind the last that was due, and that is in the log
        fault: Exception | None = None
        try:
            period_s = self._logger.period_s
            while (due_s := self._begin_s + number * period_s) < self._end_s:
                if self._done.wait(due_s - self._now_s()):
                    return
                asked_s, due = self._now_s(), number + 1
                try:
                    values = self._logger.read()
                except InstrumentSilent as error:
                    self._warn("logger.silent", str(error))
                else:
                    self._put(number, number - wanted, (asked_s + self._now_s()) / 2, values)
                    wanted = due
                # An answer that took longer than a period costs those readings that were due meanwhile.
                until_s = min(self._now_s(), self._end_s)
                number = due = max(due, math.ceil((until_s - self._begin_s) / period_s))
        except RattleError as error:
            self._lose(str(error))
        except Exception as error:  # top of a thread: nothing that moves hangs on it
            fault = error
            self._lose(f"stopped by {type(error).__name__}: {error}")
        finally:
            with suppress(RattleError):
                self._miss(wanted, due - wanted, self._base.unix_ns(self._now_s()))
            if fault is not None:
                show_fault(fault)

    def _put(self, number: int, missing: int, card_s: float, values: Sequence[float]) -> None:
        time_ns = self._base.unix_ns(card_s)
        self._miss(number - missing, missing, time_ns)
        flags = Flag.SAMPLES_MISSING_BEFORE if missing else Flag.GOOD
        for channel, value in zip(self._logger.channels, values, strict=True):
            here = flags if math.isfinite(value) else flags | Flag.NOT_FINITE
            samples = as_logged(channel.name, np.array([value]))
            block = SampleBlock(channel.name, number, time_ns, 1.0 / self._logger.period_s, samples, here)
            self._stream(Block("measured", block))

    def _miss(self, first: int, count: int, time_ns: int) -> None:
        for channel in self._logger.channels if count else ():
            self._stream(Gap(time_ns, channel.name, first, count, "no answer in time"))

    def _lose(self, text: str) -> None:
        self.lost = True
        self._warn("logger.lost", text)

    def _warn(self, code: str, text: str) -> None:
        with suppress(RattleError):  # the log may have failed; that is told elsewhere
            time_ns = self._base.unix_ns(self._now_s())
            self._stream(Event(time_ns, "warning", self._logger.name, code, text))

    def _now_s(self) -> float:
        """Now on the time base."""
        return float(self._base.card_s(self._base.now_s()))
