"""A shaft that turns in a run: its speed by the card and by an encoder, both guarded, and its mark."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from daq.channel import Channel
from daq.clock import Clock
from daq.log.records import Event, Gap
from drivers.protocols.card import CardReading
from drivers.protocols.encoder import PositionEncoder
from rig.session.acquisition import Acquisition
from rig.session.encoder_check import encoder_at_marks
from rig.session.encoder_record import EncoderRecord
from rig.session.hub import Hub
from rig.session.mark_watch import MarkWatch
from rig.session.motor import OVERSPEED
from rig.session.shaft_speed import ShaftSpeed
from rig.session.speed_guard import guards_of_shaft

_ANY_SPEED_RAD_S = 314.0
"""3000 rpm: what a shaft may turn at where nothing is wanted of it."""


class ShaftWatch:
    """What `channels` of a card, and an encoder where there is one, show of a shaft; nothing of other rigs.

    `take` is called in the acquisition thread, all else by the sequence.
    """

    def __init__(self, channels: Sequence[Channel], sample_rate: float, clock: Clock) -> None:
        self._names, self._rate = [channel.name for channel in channels], sample_rate
        self._speed = ShaftSpeed(channels, sample_rate, clock)
        self._marks = MarkWatch(channels)
        self._by_card, self._by_encoder = guards_of_shaft(clock)

    @property
    def tripped(self) -> bool:
        """Whether the shaft did what ends a run."""
        return self._by_card.tripped is not None or self._by_encoder.tripped is not None

    def rpm(self) -> float:
        """Speed in rpm, NaN where nothing recent shows it."""
        return self._speed.rpm()

    def recording(
        self,
        encoder: PositionEncoder,
        acquisition: Acquisition,
        hub: Hub,
        on_gap: Callable[[Gap], None],
        wanted_rad_s: float | None,
    ) -> EncoderRecord:
        """An encoder beside the card, of a shaft that is to turn at up to `wanted_rad_s`."""
        fastest_rad_s = OVERSPEED * (wanted_rad_s or _ANY_SPEED_RAD_S)
        return EncoderRecord(encoder, acquisition.base, hub, on_gap, fastest_rad_s, self._by_encoder)

    def arm(self, wanted_rad_s: float) -> None:
        """Hold the shaft to a speed from now on."""
        self._by_card.arm(wanted_rad_s)
        self._by_encoder.arm(wanted_rad_s)

    def disarm(self) -> None:
        """Let it do what it likes: the drive is about to change its speed."""
        self._by_card.disarm()
        self._by_encoder.disarm()

    def check(self) -> None:
        """Raise InterlockTripped once it has tripped."""
        self._by_card.check()
        self._by_encoder.check()

    def take(self, reading: CardReading, acquisition: Acquisition) -> Iterator[Event]:
        """Take a block; what to tell of it."""
        if self._speed.channel is not None:
            self._speed.take(reading.first_sample, reading.values[self._names.index(self._speed.channel)])
            yield from self._by_card.look(self._speed.shown, acquisition.acquired / self._rate)
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
        skew = encoder_at_marks(*encoder.seen(), marks / self._rate, encoder.angle_per_count, self._rate)
        if skew is not None:
            yield self._marks.standing(str(skew), str(self._speed.channel))
