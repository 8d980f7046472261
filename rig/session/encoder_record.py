"""An encoder that sends by itself, recorded beside the card: its own sample grid, the run's time base."""

from __future__ import annotations

import math
import threading
from collections import deque
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from daq.angle.unwrap import Unwrapper
from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.errors import InstrumentError, InstrumentSilent, InterlockTripped, RattleError, show_fault
from daq.log.records import ClockRecord, Event, Gap
from daq.time_base.clocks import CardClock, DeviceClock
from drivers.protocols.encoder import PositionBlock, PositionEncoder
from rig.session.acquisition import JOIN_S, AcquisitionFault
from rig.session.interlock import SpeedGuard
from rig.session.shaft_speed import ByAngle, SpeedReading
from rig.stream import Block, Stream
from sim_twin.rigs.channel_table import ENCODER_ANGLE

Array = NDArray[np.float64]

ENCODER_CHANNEL = ENCODER_ANGLE.name
ENCODER_DEVICE = "encoder"
"""As `/clock` names it."""
_BACKLOG_S = 2.0
"""Kept before a record begins, which is where the card was a block ago."""
_SILENT_S = 2.0
"""Positions that come late on a busy machine or bus are a gap at worst; for so long, its timer is off."""
HANGS_S = 0.9
"""While the rig moves nobody waits longer for positions; a missing heartbeat is told by 0.75 s."""
_EARLIEST_S, _LATEST_S = 0.1, 0.5
"""No position comes before it was taken, nor later than so by a stall: its clock was set."""
_BLOCK_S = 0.1
_CHECKED_S = 30.0


def encoder_channel(encoder: PositionEncoder) -> Channel:
    """How a log describes the encoder's angle."""
    rad_per_count = math.tau / encoder.counts_per_revolution
    return Channel(
        ENCODER_CHANNEL, "rad", "angle", "encoder", encoder.identity, scale=rad_per_count, raw_unit="count"
    )


@dataclass(frozen=True, slots=True)
class _Stretch:
    """Consecutive positions: number of the first, its place on the time base (s), unwrapped angle in rad.

    `missing` positions should have come before it. `ambiguous`: whole turns may have been lost within it or
    before it.
    """

    number: int
    missing: int
    card_s: float
    angle_rad: Array
    flags: Flag
    ambiguous: bool


class EncoderRecord:
    """Reads an encoder in a thread of its own; what lies between `begin` and `end` goes to the log.

    Nothing is resampled: a block says where its first position lies by the clock models of that moment, and
    carries CLOCK_NOT_LOCKED while these do not stand. The first error of the thread ends it. Over missing
    positions the angle is certain as long as a shaft at `fastest_rad_s` could not have gone half way round.
    Every block is shown to `guard`: whichever way round the encoder counts, it has to turn as the shaft does.
    """

    def __init__(
        self,
        encoder: PositionEncoder,
        base: CardClock,
        stream: Stream,
        fastest_rad_s: float,
        guard: SpeedGuard,
    ) -> None:
        self._encoder, self._base, self._stream = encoder, base, stream
        self._guard, self._speed = guard, self._new_speed()
        self._clock = DeviceClock(ENCODER_DEVICE, base)
        self._count = max(1, round(_BLOCK_S / encoder.period_s))
        self.angle_per_count = math.tau / encoder.counts_per_revolution
        step = math.ceil(fastest_rad_s / self.angle_per_count * encoder.period_s) + 1
        self._unwrapper = Unwrapper(encoder.total_range, min(step, (encoder.total_range - 1) // 2))
        self._next_number = 0
        self._backlog: deque[_Stretch] = deque()
        self._begin_s = self._end_s = self._first_s = math.inf
        self._first: int | None = None
        self._until = 0  # behind the last position of the record that was due, once it has ended
        self._turned_off = 0.0
        self._gaps: deque[tuple[int, int, str]] = deque()
        self._seen: deque[tuple[Array, Array, Array]] = deque(maxlen=round(_CHECKED_S / _BLOCK_S))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="encoder", daemon=True)
        self._due_s = math.inf  # by when the next positions are to have come; the guard's thread looks
        self.error: RattleError | None = None
        self.ended = False

    def __enter__(self) -> EncoderRecord:
        self._encoder.start()
        self._due_s = self._base.now_s() + HANGS_S  # also the first: its thread may hang before them
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join(JOIN_S)
        with suppress(InstrumentError):
            self._encoder.stop()
        with suppress(RattleError):  # the log may have failed; that is told elsewhere
            counts = asdict(self._encoder.statistics)
            del counts["period_ppm"]
            frames = counts.pop("frames")
            wrong = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in counts.items() if count)
            if wrong:
                time_ns = self._base.unix_ns(float(self._base.card_s(self._base.now_s())))
                text = f"of {frames} positions: {wrong}"
                self._stream(Event(time_ns, "warning", self._encoder.name, "encoder.frames", text))

    def begin(self, card_s: float) -> None:
        """Record positions from this time on, s since the card's sample 0."""
        self._begin_s = self._first_s = card_s

    def end(self, card_s: float) -> None:
        """Record up to this time; `ended` once a position after it has come."""
        self._end_s = card_s

    def due(self, by_s: float) -> int:
        """How many positions are due by then since the record began."""
        if self.ended and self._first is not None:
            return self._until - self._first
        first_s = self._begin_s if self._first is None else self._first_s
        return math.ceil(max((min(self._end_s, by_s) - first_s) / self._encoder.period_s, 0.0))

    @property
    def hangs(self) -> bool:
        """Whether no positions come, or nobody makes anything of them."""
        return self._base.now_s() > self._due_s

    def check(self) -> None:
        """Raise what ended it, or InterlockTripped while the encoder reports an emergency of its own."""
        if self.error is not None:
            raise self.error
        for emergency in self._encoder.emergencies:
            what = f"emergency {emergency.code:04X}h of the {self._encoder.name} ({emergency.text})"
            raise InterlockTripped(f"interlock: {what}")

    def events(self) -> tuple[Event, ...]:
        """What the encoder and its clock did since the last call."""
        return tuple(
            Event(self._unix_ns(notice.arrival_s), notice.level, self._encoder.name, notice.code, notice.text)
            for notice in self._encoder.take_notices()
        )

    def clocks(self, at_last: bool) -> list[ClockRecord]:
        """How the encoder's clock lies, where there is news of it."""
        records, steps = self._clock.refit(at_last)
        for step in steps:
            self._stream(step)
        return records

    def seen(self) -> tuple[Array, Array]:
        """Times on the time base (s since the card's sample 0) and angles (rad) of the last 30 s."""
        if not self._seen:
            return np.zeros(0), np.zeros(0)
        stamp_s, arrival_s, angle = (np.concatenate(column) for column in zip(*self._seen, strict=True))
        return self._clock.card_s(stamp_s, arrival_s), angle

    def _run(self) -> None:
        try:
            silent_since_s: float | None = None
            while not self._stop.is_set():
                try:
                    block = self._encoder.read(self._count)
                    self._clock.note(block.timestamp_s, block.arrival_s)
                    self._gaps.extend((gap.first_frame, gap.count, gap.cause) for gap in block.gaps)
                    cuts = [0, *(np.flatnonzero(np.diff(block.number) != 1) + 1).tolist(), len(block.number)]
                    stretches = [self._stretch(block, low, high) for low, high in pairwise(cuts)]
                    self._backlog.extend(stretches)
                    angle_rad = np.concatenate([stretch.angle_rad for stretch in stretches])
                    self._seen.append((block.timestamp_s, block.arrival_s, angle_rad))
                    self._show(stretches)
                    while self._backlog and self._place(self._backlog[0]):
                        self._backlog.popleft()
                    silent_since_s = None
                    self._due_s = self._base.now_s() + HANGS_S
                except InstrumentSilent:  # it lives, its heartbeat says so
                    silent_since_s = silent_since_s or self._base.now_s()
                    if self._base.now_s() - silent_since_s > _SILENT_S:
                        raise
        except RattleError as error:
            self.error = error
        except Exception as error:  # top of a thread: a fault of ours must stop the rig like any other
            self.error = AcquisitionFault(f"encoder stopped by {type(error).__name__}: {error}")
            self.error.__cause__ = error
        self._due_s = math.inf  # it has ended, and cannot be late any more
        if isinstance(self.error, AcquisitionFault):
            show_fault(self.error.__cause__)

    def _stretch(self, block: PositionBlock, low: int, high: int) -> _Stretch:
        number = int(block.number[low])
        missing, self._next_number = number - self._next_number, int(block.number[high - 1]) + 1
        unwrapped = self._unwrapper.unwrap(block.counts[low:high], missing)
        ambiguous = bool(unwrapped.ambiguous.any())
        if ambiguous:
            what = f"{missing} positions missing" if missing else "a jump beyond what the shaft can turn"
            text = f"{what} at frame {number}: whole turns may be lost"
            time_ns = self._unix_ns(float(block.arrival_s[low]))
            self._stream(Event(time_ns, "warning", self._encoder.name, "encoder.ambiguous", text))
        flags = block.flags & ~Flag.SAMPLES_MISSING_BEFORE
        flags |= Flag.SAMPLES_MISSING_BEFORE if missing else Flag.GOOD
        stamp_s, arrival_s = block.timestamp_s[low : low + 1], block.arrival_s[low : low + 1]
        by_arrival = float(self._base.card_s(self._base.host_s(arrival_s))[0])
        card_s, known = float(self._clock.card_s(stamp_s, arrival_s)[0]), self._clock.locked
        if not -_EARLIEST_S < by_arrival - card_s < _LATEST_S:  # set, and its model does not know it yet
            card_s, known = by_arrival, False
        flags |= Flag.GOOD if known else Flag.CLOCK_NOT_LOCKED
        angle_rad = np.asarray(unwrapped.counts * self.angle_per_count, np.float64)
        return _Stretch(number, missing, card_s, angle_rad, flags, ambiguous)

    def _show(self, stretches: list[_Stretch]) -> None:
        """Show the guard how fast the encoder turns; that is not known where whole turns may be lost."""
        shown = SpeedReading()
        for stretch in stretches:
            if stretch.ambiguous:
                self._speed = self._new_speed()
            shown = self._speed.take(stretch.number, stretch.angle_rad)
        if any(stretch.ambiguous for stretch in stretches):
            shown = SpeedReading()
        shown = replace(shown, speed_rad_s=abs(shown.speed_rad_s))
        for event in self._guard.look(shown, self._next_number * self._encoder.period_s):
            self._stream(event)

    def _new_speed(self) -> ByAngle:
        return ByAngle(1.0 / self._encoder.period_s, math.tau / self._encoder.counts_per_revolution)

    def _place(self, stretch: _Stretch) -> bool:
        """Record what of a stretch belongs to the record; False while that cannot be known."""
        period_s, length = self._encoder.period_s, len(stretch.angle_rad)
        last_s = stretch.card_s + (length - 1) * period_s
        if math.isinf(self._begin_s):
            newest = self._backlog[-1]
            forgotten = newest.card_s - last_s > _BACKLOG_S
            while forgotten and self._gaps and self._gaps[0][0] < stretch.number:
                self._gaps.popleft()
            return forgotten
        if self.ended:
            return True
        times = stretch.card_s + np.arange(length) * period_s
        low, high = map(int, np.searchsorted(times, [self._begin_s, self._end_s]))
        if self._first is not None:
            low = max(self._first - stretch.number, 0)  # no position is left out where a model has moved
        elif low < length:
            # the record begins with the first that was due, which may be missing
            due = min(int((times[low] - self._begin_s) / period_s), stretch.missing)
            self._first, self._first_s = stretch.number + low - due, float(times[low]) - due * period_s
            self._turned_off = math.tau * math.floor(stretch.angle_rad[low] / math.tau)
        # and it ends with the last that was due
        behind = min(int(max((stretch.card_s - self._end_s) / period_s, 0.0)), stretch.missing)
        self._until = stretch.number + high - behind
        self._tell_missing(stretch.number - behind)
        if self._first is not None and high > low:
            values = stretch.angle_rad[low:high] - self._turned_off
            time_ns, first = self._base.unix_ns(float(times[low])), stretch.number + low - self._first
            block = SampleBlock(ENCODER_CHANNEL, first, time_ns, 1.0 / period_s, values, stretch.flags)
            self._stream(Block("measured", block))
        self.ended = last_s >= self._end_s
        return True

    def _tell_missing(self, until: int) -> None:
        """What the encoder said of positions of the record that are missing before that one."""
        while self._first is not None and self._gaps and self._gaps[0][0] < until:
            first, count, cause = self._gaps.popleft()
            before, behind = max(first - self._first, 0), min(first + count, until) - self._first
            if before < behind:
                time_ns = self._base.unix_ns(self._begin_s + before * self._encoder.period_s)
                self._stream(Gap(time_ns, ENCODER_CHANNEL, before, behind - before, cause))

    def _unix_ns(self, arrival_s: float) -> int:
        return self._base.unix_ns(float(self._base.card_s(self._base.host_s(arrival_s))))
