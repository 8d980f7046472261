"""Reads the card in a thread of its own and hands on what belongs to the record."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from daq.block import Flag, SampleBlock, as_logged, sample_time_ns
from daq.clock import Clock
from daq.errors import InterlockTripped, RattleError, show_fault
from daq.log.records import LIMIT_WARNING, Event
from daq.time_base.clocks import CardClock
from drivers.protocols.card import AcquisitionCard, CardReading
from rig.session.interlock import LimitWatch, Passed
from rig.stream import Block, Stream

READING_S = 0.075  # a limit is seen within a reading and off within 0.15 s; a call's cost is small against it
READINGS = 2  # to a block of the record: whoever takes one pays for each, be it as long as it will
_TAKES_S, _READS_S = 0.6, 0.8
"""What comes to a reading; a block and the card's own margins (0.675 s), whose word says more. Whoever needs
longer watches no limit."""
LATE_S, LATE_FOR_S = _READS_S, 1.0
"""Nor does who looks at samples so old for so long: calls may be quick, and what waits in the card grow."""
JOIN_S = 5.0
"""How long the end of a thread is awaited: nothing moves by then, and a driver may have no deadline."""
_FLAG_CODES = {
    Flag.OVERLOAD: "overload",
    Flag.OPEN_SENSOR: "open_sensor",
    Flag.CLOCK_NOT_LOCKED: "clock_not_locked",
    Flag.NOT_FINITE: "not_finite",
}
Reader = Callable[[CardReading], None]
"""Takes a reading in the acquisition thread, which waits for it."""


class AcquisitionFault(RattleError, RuntimeError):
    """A fault of this program in the acquisition thread."""


class Acquisition:
    """The card's samples from the start of its task on; `record_from` to `record_until` are recorded.

    The card's sample clock is the time base, `base`. Whoever waits for progress waits on `changed`, a
    condition that every block notifies. The first error of its thread ends it and stands in `error`.
    A reading goes to the limits first, then to `guard`, then to the record, which is handed to `stream` in
    blocks of two readings with the same flags, then to `readers`.
    `warn` hears of the first warning of each channel, and must not wait; the events tell of all.
    """

    def __init__(
        self,
        card: AcquisitionCard,
        clock: Clock,
        stream: Stream,
        limits: LimitWatch,
        readers: Iterable[Reader] = (),
        warn: Callable[[str], None] = lambda _: None,
        guard: Reader = lambda _: None,
    ) -> None:
        self._card, self._clock, self._stream, self._limits = card, clock, stream, limits
        self._warn, self._warned = warn, set[str]()
        self._readers: tuple[Reader, ...] = (
            self._watch_limits,
            guard,
            self._note_flags,
            self._record,
            *readers,
        )
        self.name, self._names = card.name, [channel.name for channel in card.channels]
        self._count = max(1, round(READING_S * card.sample_rate))
        self._thread = threading.Thread(target=self._run, name="acquisition", daemon=True)
        self._stop = threading.Event()
        self._good = self._raised = (Flag.GOOD,) * len(self._names)
        self.changed = threading.Condition()  # its lock is over `acquired`, `record_from`, `record_until`
        self.base = CardClock(clock, card.sample_rate)
        self.acquired = 0
        self.record_from: int | None = None
        self.record_until: int | None = None
        self.error: RattleError | None = None
        self.tripped: Passed | str | None = None
        self.trips = 0
        self.alarm = threading.Event()  # set where one of these comes, for whoever need not wait for a look
        self._due_s = math.inf  # by when its thread is to have done what it is at; the guard's thread looks
        self.overloads = dict.fromkeys(self._names, 0)
        self.turned_off = dict[str, float]()  # of each angle, rad: set by the first reading of the record
        self._held = list[CardReading]()  # what the next block of the record is made of
        self._held_from = 0, 0  # where that record began, and which of its samples the block begins with

    def __enter__(self) -> Acquisition:
        self._card.arm()  # before the clock looks: only the start itself lies between its two looks
        doubt = self.base.start(self._card.start, self._card.started_s)
        if doubt:
            self._event("warning", "clock.stamp_ignored", f"{self._card.name} {doubt}")
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(JOIN_S)

    @property
    def record_start_ns(self) -> int:
        """Time of the record's sample 0 (Unix epoch, ns); only once `record_from` is set."""
        return sample_time_ns(self.base.start_ns, self.record_from or 0, self._card.sample_rate)

    def check(self) -> None:
        """Raise what ended the acquisition, or InterlockTripped for a limit that was passed."""
        if self.error is not None:
            raise self.error
        if self.tripped is not None:
            raise InterlockTripped(f"interlock: {self.tripped}")

    @property
    def hangs(self) -> bool:
        """Whether its thread has taken so long that it must be taken for dead."""
        return self._clock.monotonic_s() > self._due_s

    def late_s(self, reading: CardReading) -> float:
        """How long ago the last sample of a reading was taken."""
        return self.base.age_s(end_of(reading) / self._card.sample_rate)

    def trip(self, passed: Passed | str) -> None:
        """In the acquisition thread: a limit was passed that ends the run."""
        self.tripped, self.trips = passed, self.trips + 1
        self.alarm.set()

    def start_record(self, count: int) -> int:
        """Record the next `count` samples; returns the card's index of the first."""
        with self.changed:
            self.record_from, self.record_until = self.acquired, self.acquired + count
            return self.acquired

    def records(self, reading: CardReading) -> bool:
        """Whether any of a reading belongs to the record."""
        begin, until = self.record_from, self.record_until
        if begin is None or until is None:
            return False
        return reading.first_sample < until and end_of(reading) > begin

    def end_record(self, reading: CardReading) -> None:
        """In the acquisition thread: the record ends with this reading."""
        self._hand_on()
        with self.changed:
            if self.record_until is not None and self.records(reading):
                self.record_until = min(self.record_until, end_of(reading))

    def _run(self) -> None:
        try:
            try:
                while not self._stop.is_set():
                    self._due_s = self._clock.monotonic_s() + _READS_S
                    reading = self._card.read(self._count)
                    self._due_s = self._clock.monotonic_s() + _TAKES_S
                    self.base.arrived(end_of(reading), reading.arrived_s)
                    for take in self._readers:  # limits first, for whoever comes after may be slow
                        take(reading)
                    with self.changed:
                        self.changed.notify_all()
            finally:
                self._hand_on()  # what came before it stopped, or failed
            self._card.stop()
        except RattleError as error:
            self.error = error
        except Exception as error:  # top of a thread: a fault of ours must stop the rig like any other
            self.error = AcquisitionFault(f"acquisition stopped by {type(error).__name__}: {error}")
            self.error.__cause__ = error
        self._due_s = math.inf  # it has ended, and cannot be late any more
        with self.changed:
            self.changed.notify_all()
        if isinstance(self.error, AcquisitionFault):
            show_fault(self.error.__cause__)

    def _watch_limits(self, reading: CardReading) -> None:
        rows = dict(zip(self._names, reading.values, strict=True))
        for passed in self._limits.check(rows, dict(zip(self._names, reading.flags, strict=True))):
            if passed.abort:
                self.trip(passed)
            elif passed.channel not in self._warned:
                self._warned.add(passed.channel)
                self._warn(str(passed))
            level, code = ("error", "limit.abort") if passed.abort else ("warning", LIMIT_WARNING)
            self._event(level, code, str(passed))

    def _note_flags(self, reading: CardReading) -> None:
        before, self._raised = self._raised, reading.flags  # a flag that lasts is told once
        if reading.flags != self._good:
            for name, flags, raised in zip(self._names, reading.flags, before, strict=True):
                self.overloads[name] += bool(flags & Flag.OVERLOAD)
                for flag, code in _FLAG_CODES.items():
                    if flags & ~raised & flag:
                        self._event("warning", f"sensor.{code}", f"{name}: {code.replace('_', ' ')}")
        for finding in reading.findings:
            self._event("warning", f"sensor.{finding.code}", f"{finding.channel}: {finding.text}")

    def _record(self, reading: CardReading) -> None:
        with self.changed:  # a record that starts now starts after this reading or with it, never within
            self.acquired = end_of(reading)
            begin, until = self.record_from, self.record_until
        if begin is None or until is None:
            return
        low = max(begin - reading.first_sample, 0)
        high = min(reading.values.shape[1], until - reading.first_sample)
        if high <= low:
            return
        if self._held and reading.flags != self._held[0].flags:  # which are those of all samples of a block
            self._hand_on()
        if not self._held:
            self._held_from = begin, reading.first_sample + low - begin
        part = replace(reading, values=reading.values[:, low:high])
        if not self.turned_off:
            for name, row in zip(self._names, part.values, strict=True):
                if name.endswith(".angle"):  # less the whole turns that it had made before the record began
                    begun = float(row[0]) if np.isfinite(row[0]) else 0.0
                    self.turned_off[name] = math.tau * math.floor(begun / math.tau)
        self._held.append(part)
        if len(self._held) == READINGS or reading.first_sample + high == until:
            self._hand_on()

    def _hand_on(self) -> None:
        """Make a block of what is held."""
        held, self._held = self._held, []
        if not held:
            return
        (begin, first), rate = self._held_from, self._card.sample_rate
        time_ns = sample_time_ns(sample_time_ns(self.base.start_ns, begin, rate), first, rate)
        rows = np.concatenate([each.values for each in held], axis=1)
        for name, row, flags in zip(self._names, rows, held[0].flags, strict=True):
            if name in self.turned_off:
                row = row - self.turned_off[name]
            samples = SampleBlock(name, first, time_ns, rate, as_logged(name, row), flags)
            self._stream(Block("measured", samples))

    def _event(self, level: str, code: str, text: str) -> None:
        self._stream(Event(self._clock.unix_ns(), level, "acquisition", code, text))


def end_of(reading: CardReading) -> int:
    """The card's index of the sample after its last one."""
    return reading.first_sample + len(reading.values[0])
