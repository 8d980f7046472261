"""The moves of a run: start, settle, record, ramp down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from daq.quantity import settings_of
from rig.files.pairing import SOFT_START_FROM_S
from rig.files.scenario import AcquisitionSection
from rig.session.driven_rig import DrivenRig
from rig.session.frequency import ON_THEIR_WAY_S, FrequencyHold, Trimmed
from rig.session.twin_feed import TwinFeed

PRE_TRIGGER_S = 0.05
"""Recorded before a drive that starts from rest, so that the record shows the start."""

_TRIES = 3
"""A card whose samples come late may still show the ramp; then the frequency is measured again."""


def starts_softly(wanted: AcquisitionSection) -> bool:
    """Whether there is time for a ramp before the record."""
    return wanted.settle >= SOFT_START_FROM_S


@dataclass(frozen=True, slots=True)
class Sequence:
    """A run's moves, with everything that has to know of them."""

    wanted: AcquisitionSection
    rig: DrivenRig
    feed: TwinFeed
    hold: FrequencyHold | None = None
    path: tuple[Any, ...] = ()

    def drive_and_record(self) -> None:
        """Move and record, and bring the drive to rest; raises what ends it early, with the drive on."""
        rig, wanted = self.rig, self.wanted
        if wanted.settle > 0:
            self._settle()
        pre_trigger = 0 if wanted.settle > 0 else self._samples(PRE_TRIGGER_S)
        if pre_trigger:
            self.feed.feed_from = rig.acquisition.acquired
        begin = rig.start_record(pre_trigger + self._samples(wanted.duration))
        rig.logbook.tell("info", "record.start", "recording")
        with rig.screen.bar("recording", wanted.duration) as bar:
            if pre_trigger:
                self._until(begin + pre_trigger)
                self._start()
            rig.watch.until(rig.acquisition, lambda: rig.recorded, lambda: bar.at(self._since(begin)))
        rig.logbook.tell("info", "record.end", "recorded")
        rig.end_record()
        rig.ramp_down()

    def _settle(self) -> None:
        wanted, acquisition = self.wanted, self.rig.acquisition
        with self.rig.screen.bar("settling", wanted.settle) as bar:
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
        hold, motion = self.hold, self.rig.motion
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
        self.rig.logbook.tell("info", "drive.trimmed", f"{found}; corrected")
        return True

    def _start(self) -> None:
        self.rig.start(starts_softly(self.wanted), self.path)
        tell = self.rig.logbook.tell
        if self.path:
            came = "; ".join(map(_named, self.path))
            tell("info", "drive.path", f"came without a rest through {came}")
        tell("info", "drive.on", self.rig.motion.what)

    def _until(self, sample: int, show: Callable[[], None] = lambda: None) -> None:
        acquisition = self.rig.acquisition
        self.rig.watch.until(acquisition, lambda: acquisition.acquired >= sample, show)

    def _since(self, sample: int) -> float:
        return (self.rig.acquisition.acquired - sample) / self.rig.sample_rate

    def _samples(self, seconds: float) -> int:
        return round(seconds * self.rig.sample_rate)


def _named(drive: Any) -> str:
    """A section [drive] in words, SI."""
    settings = settings_of(type(drive)).items()
    return ", ".join(f"{key} {getattr(drive, each.name):g}" for key, each in settings)
