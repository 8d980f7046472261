"""What an encoder sends by itself, sorted into positions, heartbeats, emergencies and errors of the bus."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import can
import numpy as np

from daq.block import Flag
from daq.errors import DeviceLost, InstrumentError, InstrumentSilent
from drivers.canopen_cia406 import frames
from drivers.canopen_cia406.frames import BusError, NmtState
from drivers.canopen_cia406.objects import PositionLayout
from drivers.canopen_cia406.order import FrameOrder, Placed, PositionFrame
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.protocols.encoder import Emergency, PositionBlock, PositionGap, PositionStatistics
from drivers.protocols.instrument import MOST_NOTICES, Notice

HEARTBEATS_MISSED = 3  # one or two may be late on a busy bus or machine
_ATTENTIVE_S = 0.1
"""The link looks twice as often; what passes beyond that is a stall of this machine and no silence."""


_MISSING, _UNREAD = "frames missing", "not read in time"
_NOT_CERTAIN = "; how many and where is not certain"
_MOST_CAUSES = 1000  # a second's at 1 kHz; none is taken out while no position comes


class Gaps:
    """Is told of positions that are kept and of what became of others, and hands out the gaps."""

    def __init__(self) -> None:
        self.last: Placed | None = None
        self._gaps: deque[PositionGap] = deque()
        self._causes: deque[tuple[float, str]] = deque(maxlen=_MOST_CAUSES)
        self._unread = False

    def lost(self, timestamp_s: float, cause: str) -> None:
        """What came at this time was no position, or none came."""
        self._causes.append((timestamp_s, cause))

    def not_read(self) -> bool:
        """One is thrown away because nobody reads; whether it is the first since one was kept."""
        first, self._unread = not self._unread, True
        return first

    def keep(self, placed: Placed) -> None:
        """One is kept; those between it and the last one that was are a gap."""
        expected = 0 if self.last is None else self.last.number + 1
        # What was rejected tells why others are missing at its own place alone.
        since_s, until_s = -math.inf, placed.frame.timestamp_s
        if placed.stepped:  # times before it are those of another clock
            until_s = math.inf
        elif self.last is not None:
            since_s = self.last.frame.timestamp_s
        known = [cause for at_s, cause in self._causes if since_s < at_s < until_s]
        while self._causes and self._causes[0][0] < until_s:
            self._causes.popleft()
        if self._unread:
            known.append(_UNREAD)
        cause = "; ".join(dict.fromkeys(known)) or _MISSING
        if not placed.certain:
            cause += _NOT_CERTAIN
        if placed.number > expected:
            self._gaps.append(PositionGap(expected, placed.number - expected, cause))
        self.last, self._unread = placed, False

    def before(self, number: int) -> tuple[PositionGap, ...]:
        """Return and forget the gaps before a frame."""
        gaps: list[PositionGap] = []
        while self._gaps and self._gaps[0].first_frame < number:
            gaps.append(self._gaps.popleft())
        return tuple(gaps)


class PositionStream:
    """Takes every frame in the link's thread; hands out blocks to one reader.

    All that both touch is under the lock of `_changed`. The first fault is kept: positions that came before
    it are read first, then `take` raises it, until `connected` begins anew.
    """

    def __init__(self, settings: EncoderSettings) -> None:
        self._settings, self._node = settings, settings.node
        self._changed = threading.Condition()
        self._take: dict[int, Callable[[can.Message, float], None]] = {
            frames.TPDO1 + self._node: self._position,
            frames.HEARTBEAT + self._node: self._heartbeat,
            frames.EMCY + self._node: self._emergency,
        }
        self._linux = settings.interface in frames.LINUX_INTERFACES
        self._notices: deque[Notice] = deque(maxlen=MOST_NOTICES)
        self._emergencies: tuple[Emergency, ...] = ()
        self._looked_s = self._unheard_s = self._beat_s = self._beat_stamp_s = (
            0.0  # s of the monotonic clock, but for the stamp of a beat
        )
        self._beats = 0
        self._state = -1  # none heard yet
        self._fault: InstrumentError | None = None
        self.connected()

    @property
    def emergencies(self) -> tuple[Emergency, ...]:
        """Emergencies that were not taken back."""
        return self._emergencies

    @property
    def _ended(self) -> bool:
        return self._fault is not None or not self._streaming

    @property
    def statistics(self) -> PositionStatistics:
        """What became of the frames since `begin`."""
        with self._changed:
            order = self._order
            return replace(
                self._counts,
                frames=self._enqueued,
                missing=order.missing + self._counts.queue_overruns,
                duplicates=order.duplicates,
                reordered=order.reordered,
                late=order.late,
                clock_steps=order.clock_steps,
                uncertain=order.uncertain,
                period_ppm=order.period_ppm,
            )

    def connected(self) -> None:
        """Forget everything: a new connection begins."""
        with self._changed:
            self._fault, self._beats, self._state = None, 0, -1
            self._emergencies = ()
            self._notices.clear()
            self.begin(PositionLayout(0, 4), 1, 0.0)
            self._streaming = False

    def begin(self, layout: PositionLayout, total_range: int, heartbeat_s: float) -> None:
        """Expect positions from now on, and a heartbeat every `heartbeat_s` once the node is operational."""
        with self._changed:
            self._layout, self._total_range = layout, total_range
            # A start counts from frame 0: order, gaps and counts of before would not fit.
            self._order = FrameOrder(self._settings.period_s)
            self._capacity = max(round(self._settings.buffer_s / self._settings.period_s), 10)
            self._queue: deque[Placed] = deque()
            self._gaps = Gaps()
            self._counts = PositionStatistics()
            self._enqueued = 0
            self._set_by_s = 0.0
            self._suspect = self._unsure = self._operational = False  # overrun not told yet; numbers; node
            self._wanted = 1  # how many the reader waits for: it is not woken before
            self._beat_limit_s = HEARTBEATS_MISSED * heartbeat_s
            self._streaming = True

    def end(self) -> None:
        """Expect no more positions; those that are there stay."""
        with self._changed:
            self._close_order()
            self._streaming = self._operational = False
            self._changed.notify_all()

    def await_heartbeat(self, seconds: float, state: NmtState | None = None) -> bool:
        """Wait for a heartbeat that comes from now on, in `state` if one is given; whether it came.

        Raises `DeviceLost`.
        """
        with self._changed:
            before = self._beats

            def came() -> bool:
                wanted = state is None or self._state == state
                return self._fault is not None or (self._beats > before and wanted)

            it_came = self._changed.wait_for(came, seconds)
            if self._fault is not None:
                raise self._fault
            return it_came

    def take_notices(self) -> tuple[Notice, ...]:
        with self._changed:
            notices = tuple(self._notices)
            self._notices.clear()
        return notices

    def take(self, count: int, seconds: float) -> PositionBlock:
        """Wait for `count` positions for so long; see `PositionEncoder.read`."""
        with self._changed:
            self._wanted, self._capacity = count, max(self._capacity, 2 * count)
            # The reader sleeps until there are enough, or there will be no more.
            self._changed.wait_for(lambda: len(self._queue) >= count or self._ended, seconds)
            if self._ended and not self._queue:  # what came before a fault is read first
                raise self._fault or self._lost_error("it was not started")
            if not self._ended and len(self._queue) < count:
                what = f"{len(self._queue)} of {count} positions within {seconds:.3g} s; {self._last_good()}"
                check = "its cyclic timer and that it is operational"
                raise InstrumentSilent(self._settings.name, self._settings.address, what, check)
            placed = [self._queue.popleft() for _ in range(min(count, len(self._queue)))]
            gaps = self._gaps.before(placed[-1].number)
            flags = Flag.SAMPLES_MISSING_BEFORE if gaps or self._suspect else Flag.GOOD
            self._suspect = False
        if not all(item.certain for item in placed):
            flags |= Flag.CLOCK_NOT_LOCKED
        return PositionBlock(
            number=np.array([item.number for item in placed], dtype=np.int64),
            arrival_s=np.array([item.frame.arrival_s for item in placed]),
            timestamp_s=np.array([item.frame.timestamp_s for item in placed]),
            counts=np.array([item.frame.counts for item in placed], dtype=np.int64),
            gaps=gaps,
            flags=flags,
        )

    # In the link's thread from here on.

    def frame(self, message: can.Message, arrival_s: float) -> None:
        """Take a frame of any node."""
        with self._changed:
            self._attend(arrival_s)
            if message.is_error_frame:
                self._error_frame(message, arrival_s)
            elif not (message.is_remote_frame or message.is_extended_id):
                take = self._take.get(message.arbitration_id)
                if take is not None:
                    take(message, arrival_s)
                # By one clock alone, one that was set would look the same.
                self._check_heart(min(arrival_s - self._beat_s, message.timestamp - self._beat_stamp_s))

    def quiet(self, now_s: float) -> None:
        """Nothing waits on the bus."""
        with self._changed:
            self._attend(now_s)
            self._close_order()  # nothing is on its way that could belong between the last frames
            self._check_heart(self._unheard_s)

    def lost(self, why: str, cause: Exception | None = None) -> None:
        """The first reason why no position can come any more."""
        with self._changed:
            if self._fault is None:
                self._close_order()
                self._fault = self._lost_error(f"the connection is lost: {why}")
                self._fault.__cause__ = cause
            self._changed.notify_all()

    def _position(self, message: can.Message, arrival_s: float) -> None:
        if not self._streaming or self._fault is not None:
            return
        if message.dlc != self._layout.length or len(message.data) != message.dlc:
            what = f"a frame of {message.dlc} bytes instead of {self._layout.length}"
            self._reject("wrong_length", message.timestamp, what)
            return
        counts = self._layout.decode(message.data)
        if counts >= self._total_range:
            what = f"position {counts} beyond the total range of {self._total_range}"
            self._reject("out_of_range", message.timestamp, what)
            return
        for placed in self._order.put(PositionFrame(message.timestamp, arrival_s, counts)):
            self._enqueue(placed)

    def _enqueue(self, placed: Placed) -> None:
        if placed.stepped:
            text = "the clock of the timestamps was set"
            self._note(placed.frame.arrival_s, "warning", "encoder.clock_step", text)
        if not (placed.certain or self._unsure):
            text = (
                f"frame {placed.number}: positions come too unevenly to tell which are missing, "
                "numbers may be off from here on; a bus or interface that stalls?"
            )
            self._note(placed.frame.arrival_s, "warning", "encoder.numbering", text)
        self._unsure = not placed.certain
        by_one_clock = self._by_one_clock(placed)  # also of what is lost below: later times hang on it
        if len(self._queue) >= self._capacity:  # bounded: who does not read must not fill the memory
            if self._gaps.not_read():
                text = f"positions are lost: nobody read for {self._settings.buffer_s:g} s"
                self._note(placed.frame.arrival_s, "error", "encoder.overrun", text)
            self._count("queue_overruns")
            return
        self._gaps.keep(placed)
        self._queue.append(by_one_clock)
        self._enqueued += 1
        if len(self._queue) >= self._wanted:
            self._changed.notify_all()

    def _by_one_clock(self, placed: Placed) -> Placed:
        """With its time as if the clock had not been set, where it is certain which frame it is.

        The sender's timer went on, and tells by how much the clock of the timestamps was set.
        """
        last, frame = self._gaps.last, placed.frame
        if last is not None and placed.stepped and placed.certain:
            passed_s = (placed.number - last.number) * self._settings.period_s
            self._set_by_s += frame.timestamp_s - last.frame.timestamp_s - passed_s
        return placed._replace(frame=frame._replace(timestamp_s=frame.timestamp_s - self._set_by_s))

    def _heartbeat(self, message: can.Message, arrival_s: float) -> None:
        try:
            state = frames.heartbeat_state(message.data)
        except ValueError:
            self._count("wrong_length")
            return
        # A node that fell back or restarted lost what was set in it: it is opened and verified again by hand.
        self._state, self._beats = state, self._beats + 1
        self._unheard_s, self._beat_s, self._beat_stamp_s = 0.0, arrival_s, message.timestamp
        if self._streaming and self._operational and state != NmtState.OPERATIONAL:
            self.lost(f"it fell back to {frames.state_name(state)}; its settings are no longer certain")
        self._operational = self._streaming and state == NmtState.OPERATIONAL
        self._changed.notify_all()

    def _attend(self, now_s: float) -> None:
        self._unheard_s += min(now_s - self._looked_s, _ATTENTIVE_S)
        self._looked_s = now_s

    def _check_heart(self, unheard_s: float) -> None:
        if self._operational and self._fault is None and unheard_s > self._beat_limit_s:
            limit = f"{HEARTBEATS_MISSED} periods ({self._beat_limit_s:g} s)"
            self.lost(f"no heartbeat for {unheard_s:.2f} s, more than {limit}")

    def _emergency(self, message: can.Message, arrival_s: float) -> None:
        try:
            emergency = frames.emergency(message.data, arrival_s)
        except ValueError:
            self._count("wrong_length")
            return
        if emergency.code & 0xFF00 == 0:  # error reset or no error (CiA 301, table of emergency error codes)
            self._emergencies = ()
            self._note(arrival_s, "info", "encoder.emergency_over", emergency.text)
            return
        self._emergencies = (
            *self._emergencies[-31:],
            emergency,
        )  # bounded, for a node that sends them for ever
        self._count("emergencies")
        text = f"emergency {emergency.code:04X}h ({emergency.text}), register {emergency.register:02X}h"
        self._note(arrival_s, "error", "encoder.emergency", text)

    def _error_frame(self, message: can.Message, arrival_s: float) -> None:
        kind = BusError(message.arbitration_id) if self._linux else BusError(0)
        self._count("error_frames")
        if kind & BusError.BUS_OFF:
            self.lost("the bus is off")
        # linux/can/error.h: byte 1 bit 0 is an overflow of the receive buffer; socketcand leaves bytes out
        elif kind & BusError.CONTROLLER and (len(message.data) < 2 or message.data[1] & 0x01):
            self._suspect = True
            cause = "receive buffer of the interface overran"
            self._gaps.lost(message.timestamp, cause)
            self._count("receiver_overruns")
            self._note(arrival_s, "error", "encoder.receiver_overrun", f"the {cause}")
        else:
            text = f"error frame, class {message.arbitration_id:03X}h"
            self._note(arrival_s, "warning", "encoder.error_frame", text)

    def _reject(self, counter: str, timestamp_s: float, cause: str) -> None:
        self._gaps.lost(timestamp_s, cause)
        self._count(counter)

    def _count(self, counter: str) -> None:
        self._counts = replace(self._counts, **{counter: getattr(self._counts, counter) + 1})

    def _close_order(self) -> None:
        for placed in self._order.flush():
            self._enqueue(placed)

    def _note(self, arrival_s: float, level: str, code: str, text: str) -> None:
        self._notices.append(Notice(arrival_s, level, code, text))

    def _lost_error(self, why: str) -> DeviceLost:
        check = "cable, power and bus of the encoder; open it again to have its settings verified"
        return DeviceLost(self._settings.name, self._settings.address, f"{why}; {self._last_good()}", check)

    def _last_good(self) -> str:
        last = self._gaps.last
        if last is None:
            return "no position came"
        number, frame = last.number, last.frame
        return f"last good position: frame {number}, {frame.counts} counts at {frame.timestamp_s:.6f} s"
