"""The moves of a run: start, settle, record, ramp down."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rig.files.pairing import SOFT_START_FROM_S
from rig.files.scenario import AcquisitionSection
from rig.session.acquisition import Acquisition
from rig.session.drive import Motion
from rig.session.encoder_record import EncoderRecord
from rig.session.frequency import ON_THEIR_WAY_S, FrequencyHold, Trimmed
from rig.session.progress import Screen
from rig.session.shaft_watch import ShaftWatch
from rig.session.supervisor import SILENCE_S, Supervisor
from rig.session.twin_feed import TwinFeed
from rig.session.watch import Watch

PRE_TRIGGER_S = 0.05
"""Recorded before a drive that starts from rest, so that the record shows the start."""

_TRIES = 3
"""A card whose samples come late may still show the ramp; then the frequency is measured again."""


def starts_softly(wanted: AcquisitionSection) -> bool:
    """Whether there is time for a ramp before the record."""
    return wanted.settle >= SOFT_START_FROM_S


@dataclass(frozen=True, slots=True)
class Sequence:
    """A run's moves, with everything that has to know of them; `tell(level, code, text)` notes an event."""

    wanted: AcquisitionSection
    motion: Motion
    acquisition: Acquisition
    encoder: EncoderRecord | None
    feed: TwinFeed
    shaft: ShaftWatch
    supervisor: Supervisor
    watch: Watch
    screen: Screen
    tell: Callable[[str, str, str], None]
    sample_rate: float
    hold: FrequencyHold | None = None
    path: tuple[Any, ...] = ()

    def drive_and_record(self) -> None:
        """Move and record, and bring the drive to rest; raises what ends it early, with the drive on."""
        acquisition, wanted = self.acquisition, self.wanted
        if wanted.settle > 0:
            self._settle()
        pre_trigger = 0 if wanted.settle > 0 else self._samples(PRE_TRIGGER_S)
        if pre_trigger:
            self.feed.feed_from = acquisition.acquired
        count = pre_trigger + self._samples(wanted.duration)
        begin = acquisition.start_record(count)
        if self.encoder is not None:
            self.encoder.begin(begin / self.sample_rate)
        self.tell("info", "record.start", "recording")
        with self.screen.bar("recording", wanted.duration) as bar:
            if pre_trigger:
                self._until(begin + pre_trigger)
                self._start()
            self.watch.until(acquisition, lambda: self._recorded(), lambda: bar.at(self._since(begin)))
        self.tell("info", "record.end", "recorded")
        self._end_encoder()
        self.bring_to_rest(self.motion.ramp_down)
        self.tell("info", "drive.off", "drive ramped down and off")

    def bring_to_rest(self, stop: Callable[[], None]) -> None:
        """Stop the drive; the supervisor waits as long as that may take."""
        self.shaft.disarm()
        if self.motion.longest_stop_s > 0.0:
            self.supervisor.beat(self.motion.longest_stop_s + SILENCE_S)
        stop()

    def off(self) -> None:
        """The safe state, on whatever way out."""
        self.bring_to_rest(self.motion.off)

    def _settle(self) -> None:
        wanted, acquisition = self.wanted, self.acquisition
        with self.screen.bar("settling", wanted.settle) as bar:
            self._start()
            full = acquisition.acquired
            end = full + self._samples(wanted.settle)
            if self._trim(full):
                self.feed.feed_from = acquisition.acquired + self._samples(ON_THEIR_WAY_S)
                end = max(end, self.feed.feed_from)
            else:
                self.feed.feed_from = full
            self._until(end, lambda: bar.at(self._since(full)))

    def _trim(self, since: int) -> bool:
        """Correct what the frequency is off by the measured drive; returns whether it was."""
        hold, motion = self.hold, self.motion
        measured_s = 0.0 if hold is None else hold.measured_s(self.wanted.settle)
        if (
            hold is None
            or not measured_s
            or not starts_softly(self.wanted)
            or not isinstance(motion, Trimmed)
        ):
            return False
        since += self._samples(ON_THEIR_WAY_S)
        for _ in range(_TRIES):
            self._until(since)
            hold.begin()
            since += self._samples(measured_s)
            self._until(since)
            found = hold.end()
            if found.known:
                break
        if not found.correctable:
            return False
        motion.trim(found.off)
        self.tell("info", "drive.trimmed", f"{found}; corrected")
        return True

    def _start(self) -> None:
        self.motion.start(starts_softly(self.wanted), self.path)
        if self.motion.speed_rad_s is not None:
            self.shaft.arm(self.motion.speed_rad_s)
        if self.path:
            came = "; ".join(map(_named, self.path))
            self.tell("info", "drive.path", f"came without a rest through {came}")
        self.tell("info", "drive.on", self.motion.what)

    def _until(self, sample: int, show: Callable[[], None] = lambda: None) -> None:
        self.watch.until(self.acquisition, lambda: self.acquisition.acquired >= sample, show)

    def _recorded(self) -> bool:
        """Whether the record is complete; what asks for less may have brought its end nearer."""
        until = self.acquisition.record_until
        return until is not None and self.acquisition.acquired >= until

    def _end_encoder(self) -> None:
        until = self.acquisition.record_until
        if self.encoder is not None and until is not None:
            encoder = self.encoder
            encoder.end(until / self.sample_rate)
            self.watch.until(self.acquisition, lambda: encoder.ended)

    def _since(self, sample: int) -> float:
        return (self.acquisition.acquired - sample) / self.sample_rate

    def _samples(self, seconds: float) -> int:
        return round(seconds * self.sample_rate)


def _named(drive: Any) -> str:
    """A section [drive] in words, SI."""
    return ", ".join(f"{key} {value:g}" for key, value in dataclasses.asdict(drive).items())
