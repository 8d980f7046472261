"""A shaft that turns in a run: its speed by the card and by an encoder, both guarded, and its mark."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from daq.angle.marker import MarkTracker
from daq.angle.skew import find_skew
from daq.channel import Channel
from daq.clock import Clock
from daq.log.records import Event
from drivers.protocols.card import CardReading
from drivers.protocols.encoder import PositionEncoder
from rig.rigs import shows_marks
from rig.session.acquisition import Acquisition, end_of
from rig.session.encoder_check import at_marks
from rig.session.encoder_record import EncoderRecord
from rig.session.interlock import guards_of_shaft
from rig.session.motor import OVERSPEED
from rig.session.shaft_speed import ShaftSpeed, Tachometer
from rig.stream import Stream

_MOST_MARKS = 4096  # over a minute at 3000 rpm
_SAME_SPEED = 0.005
"""Two speeds of one shaft, over the same turns, lie nearer; a wrong number of pulses is farther off."""
_FEWEST_TURNS = 3  # a median of as many intervals bears one mark too many or too few

_ANY_SPEED_RAD_S = 314.0
"""3000 rpm: what a shaft may turn at where nothing is wanted of it."""


class MarkWatch:
    """Follows the marker, taken in the acquisition thread; `channel` is None where there is none.

    Counted is what was wrong while it was recorded: a shaft that comes up or runs out has no even marks.
    """

    def __init__(self, channels: Iterable[Channel]) -> None:
        self.channel = next((channel.name for channel in channels if shows_marks(channel.name)), None)
        self._tracker = MarkTracker()
        self._seen: deque[float] = deque(maxlen=_MOST_MARKS)
        self._missing = self._rejected = 0

    @property
    def marks(self) -> NDArray[np.float64]:
        """The latest marks that were seen, in samples since the card's start; shape (m,)."""
        return np.array(self._seen, np.float64)

    @property
    def fault(self) -> str:
        """What was wrong with the recorded marks, in words; empty for nothing."""
        if not (self._missing or self._rejected):
            return ""
        return (
            f"{self.channel}: {self._missing} marks missing in the record, put in evenly; "
            f"{self._rejected} edges rejected as no marks"
        )

    def contradiction(self, name: str, zeros: NDArray[np.float64], begin: int, end: int) -> str:
        """How angle `name` contradicts the marks between two samples, in words; empty where it does not.

        `zeros`, shape (m,): where the angle passes whole turns, in samples since the card's start.
        """
        inside = (marks[(marks >= begin) & (marks < end)] for marks in (zeros, self.marks))
        # samples of a turn, whatever single marks lack or are too many
        by_angle, by_mark = (
            float(np.median(np.diff(each))) if len(each) > _FEWEST_TURNS else None for each in inside
        )
        if by_angle is None or by_mark is None:
            return ""
        if abs(by_mark - by_angle) <= _SAME_SPEED * by_angle + 1.0:  # a mark is known to a sample
            return ""
        return (
            f"{name} turns {by_mark / by_angle:.4g} times as fast as {self.channel}: pulses per turn of the "
            "one, loose or doubled mark of the other?"
        )

    def standing(self, skew: str, name: str) -> tuple[str, str]:
        """Code and words for how an encoder stands: to the mark, or to whatever angle `name` has its zero at.

        Without a mark that zero need not be the crank's, nor the same in the next run.
        """
        if self.channel is not None:
            return "encoder.at_mark", skew
        return "encoder.at_angle_zero", f"against the zero of {name}, not the crank's mark: {skew}"

    def take(self, values: NDArray[np.float64], recorded: bool) -> None:
        """Take the next samples of `channel`, shape (n,), and whether they belong to the record."""
        before = self._tracker.missing, self._tracker.extra
        marks, _ = self._tracker.track(values)
        self._seen.extend(marks.position[~marks.interpolated].tolist())
        if recorded:
            self._missing += self._tracker.missing - before[0]
            self._rejected += self._tracker.extra - before[1]


class ShaftWatch:
    """What `channels` of a card, and an encoder where there is one, show of a shaft; nothing of other rigs.

    `take` is called in the acquisition thread, all else by the sequence. The bench allows `highest_rad_s`.
    """

    def __init__(
        self, channels: Sequence[Channel], sample_rate: float, clock: Clock, highest_rad_s: float = math.inf
    ) -> None:
        self._names, self._rate = [channel.name for channel in channels], sample_rate
        self._speed = ShaftSpeed(channels, sample_rate, clock)
        self._tachometer = Tachometer(channels, clock)
        self._marks = MarkWatch(channels)
        self._by_card, self._by_encoder = guards_of_shaft(clock, highest_rad_s)

    @property
    def tripped(self) -> bool:
        """Whether the shaft did what ends a run."""
        return self._by_card.tripped is not None or self._by_encoder.tripped is not None

    def rpm(self) -> float:
        """By angle or mark; where these do not tell, as a mark of a slow shaft, by a tachometer."""
        rpm = self._speed.rpm()
        return self._tachometer.rpm() if math.isnan(rpm) else rpm

    def recording(
        self, encoder: PositionEncoder, acquisition: Acquisition, stream: Stream, wanted_rad_s: float | None
    ) -> EncoderRecord:
        """An encoder beside the card, of a shaft that is to turn at up to `wanted_rad_s`."""
        fastest_rad_s = OVERSPEED * (wanted_rad_s or _ANY_SPEED_RAD_S)
        return EncoderRecord(encoder, acquisition.base, stream, fastest_rad_s, self._by_encoder)

    def arm(self, wanted_rad_s: float) -> None:
        self._by_card.arm(wanted_rad_s)
        self._by_encoder.arm(wanted_rad_s)

    def disarm(self) -> None:
        self._by_card.disarm()
        self._by_encoder.disarm()

    def check(self) -> None:
        self._by_card.check()
        self._by_encoder.check()

    def take(self, reading: CardReading, acquisition: Acquisition) -> Iterator[Event]:
        """Take a block; what to tell of it."""
        if self._tachometer.channel is not None:
            self._tachometer.take(reading.values[self._names.index(self._tachometer.channel)])
        if self._speed.channel is not None:
            self._speed.take(reading.first_sample, reading.values[self._names.index(self._speed.channel)])
            yield from self._by_card.look(self._speed.shown, end_of(reading) / self._rate)
        if self._marks.channel is not None:
            row = reading.values[self._names.index(self._marks.channel)]
            # on a ramp between two speeds marks are not even
            self._marks.take(row, acquisition.records(reading) and self._by_card.armed)

    def faults(self, acquisition: Acquisition) -> Iterator[tuple[str, str]]:
        """Code and text: what was wrong with the recorded marks, and how they contradict the angle."""
        begin, end = acquisition.record_from or 0, acquisition.record_until or 0
        if self._marks.fault:
            yield "marker.irregular", self._marks.fault
        if self._marks.channel is not None and self._speed.channel not in (None, self._marks.channel):
            apart = self._marks.contradiction(str(self._speed.channel), self._speed.marks, begin, end)
            if apart:
                yield "marker.contradicted", apart

    def encoder_at_mark(self, encoder: EncoderRecord) -> Iterator[tuple[str, str]]:
        """Code and text: how the encoder stands against the card's mark."""
        marks = self._speed.marks if self._marks.channel is None else self._marks.marks
        seen = at_marks(*encoder.seen(), marks / self._rate, encoder.angle_per_count, self._rate)
        if (skew := find_skew([seen])) is not None:
            yield self._marks.standing(str(skew), str(self._speed.channel))
