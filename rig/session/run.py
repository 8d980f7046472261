"""A run: connect, check, arm, move and record as `Sequence` says; safe on every way out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from daq.block import sample_time_ns
from daq.channel import Channel
from daq.clock import Clock
from daq.errors import RecorderFailed
from daq.log.reader import Origin
from daq.log.records import RECORD_END, RECORD_START
from daq.quantity import settings_of
from daq.time_base.run_clock import RunClock
from drivers.protocols.card import CardReading
from rig.bounds import bounds_of
from rig.derived.derivation import DerivationProcess, derived_channels
from rig.files.bench import Bench
from rig.files.model_file import ModelFile
from rig.files.pairing import SOFT_START_FROM_S
from rig.files.scenario import AcquisitionSection, Scenario
from rig.rigs import RIGS
from rig.session.acquisition import Reader
from rig.session.devices import Connect, Standing, connected
from rig.session.driven_rig import DrivenRig
from rig.session.encoder_record import encoder_channel
from rig.session.frequency import HELD, ON_THEIR_WAY_S, FrequencyCheck, FrequencyHold, Trimmed
from rig.session.levels import Levels
from rig.session.on_page import show
from rig.session.pace import Work
from rig.session.progress import FIRST_START, IMPACTS, Screen
from rig.session.signals import StopRequest
from rig.session.twin_feed import TwinFeed
from rig.stream import Consumer, Record
from rig.twin.chains import declared_by, mounting_of
from rig.twin.prediction_file import twin_record
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.rigs.channel_table import ENCODER_ANGLE
from sim_twin.twin import AnyTwin

if TYPE_CHECKING:
    from rig.live.view import LiveView, Swept

RECORDED = "recorded"
ENDS, UNTIL_STOPPED = "ends", "until stopped"
"""In the log's record of a run: that its scenario asks for no time."""
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
    open_ended: bool = False
    counted: Counted | None = None

    def drive_and_record(self) -> float:
        """Move and record, and bring the drive to rest; returns how many s were recorded.

        Raises what ends it early, with the drive on.
        """
        rig, wanted = self.rig, self.wanted
        if wanted.settle > 0:
            work = Work(f"start and settle {rig.name}", wanted.settle)
            with rig.screen.bar("settling", wanted.settle, "s", work, rig.levels.worst) as settling:
                self._start()
                full = rig.acquisition.acquired
                end, feed_from = full + self._samples(wanted.settle), full
                if self._trim(full):
                    feed_from = rig.acquisition.acquired + self._samples(ON_THEIR_WAY_S)
                self.feed.feed_from = feed_from
                self._until(max(end, feed_from), lambda: settling(self._since(full)))
        pre_trigger = 0 if wanted.settle > 0 else self._samples(PRE_TRIGGER_S)
        if pre_trigger:
            self.feed.feed_from = rig.acquisition.acquired
        count = pre_trigger + self._samples(wanted.duration)
        begin = rig.start_record(count)
        rig.logbook.tell("info", RECORD_START, "recording")
        counted = self.counted
        if counted is None:
            lasts_s = 0.0 if self.open_ended else wanted.duration
            shown = rig.screen.bar("recording", lasts_s, beside=rig.levels.worst)
        else:
            beside = partial(_so_far, counted, rig.levels)
            shown = rig.screen.bar(
                "recording", counted.wanted, IMPACTS, beside=beside, longest_s=wanted.duration
            )
        try:
            with shown as bar:
                if pre_trigger:
                    self._until(begin + pre_trigger)
                    self._start()
                rig.watch.until(
                    rig.acquisition,
                    lambda: rig.recorded,
                    lambda: bar(self._since(begin) if counted is None else counted.so_far),
                )
        finally:  # what ends a run may come just as its record has ended
            end = rig.acquisition.record_until or begin + count
            text = RECORDED if end == begin + count else f"{RECORDED} until it was enough"
            if rig.recorded:
                with suppress(RecorderFailed):  # which ends the run by itself
                    rig.logbook.tell("info", RECORD_END, text)
        rig.end_record()
        rig.ramp_down()
        return (end - begin) / rig.sample_rate

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
            found = self.rig.watch.meanwhile(self.rig.acquisition, hold.end)
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
            # each section [drive] in words, SI
            settings = settings_of(type(self.path[0])).items()
            came = (
                ", ".join(f"{key} {getattr(drive, each.name):g}" for key, each in settings)
                for drive in self.path
            )
            tell("info", "drive.path", f"came without a rest through {'; '.join(came)}")
        tell("info", "drive.on", self.rig.motion.what)

    def _until(self, sample: int, show: Callable[[], None] = lambda: None) -> None:
        acquisition = self.rig.acquisition
        self.rig.watch.until(acquisition, lambda: acquisition.acquired >= sample, show)

    def _since(self, sample: int) -> float:
        return (self.rig.acquisition.acquired - sample) / self.rig.sample_rate

    def _samples(self, seconds: float) -> int:
        return round(seconds * self.rig.sample_rate)


class Counted(Protocol):
    """A consumer of impacts, `wanted` of which end a record.

    There were `so_far` when `enough` was asked last, which it is in the acquisition thread.
    """

    @property
    def wanted(self) -> int: ...

    @property
    def so_far(self) -> int: ...

    def enough(self) -> bool: ...

    def __call__(self, record: Record) -> None: ...


def _so_far(counted: Counted, levels: Levels) -> str:
    return f"{counted.so_far} of {counted.wanted} impacts   {levels.worst()}".rstrip()


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What to run: checked files, turned by `connect` into devices and notes for the log.

    `model`: what calibration found of the rig; None where the twin is the scenario's. `consumers` get every
    record; `enough` is asked in the acquisition thread after each reading that was recorded, and must be
    quick: once it returns True, the record ends with that reading. Or `counted` ends it.
    `open_ended`: nothing else is meant to end it. `path`: the sections [drive] that the drive comes through
    before it settles. `armed`: it waits for Enter, with all connected and measuring, before anything moves.
    `standing` has the devices where they stay connected for the next run. `swept` is shown beside it.
    """

    scenario: Scenario
    bench: Bench
    connect: Connect
    folder: Path
    view: LiveView | None = None
    model: ModelFile | None = None
    consumers: tuple[Consumer, ...] = ()
    enough: Callable[[], bool] = lambda: False
    open_ended: bool = False
    path: tuple[Any, ...] = ()
    armed: bool = False
    standing: Standing | None = None
    swept: Swept | None = None
    counted: Counted | None = None


def run_scenario(request: RunRequest, screen: Screen, clock: Clock) -> Path:
    """Run and return the path of the log. Whatever happens and is raised, the drive is off after it."""
    scenario, bench, standing = request.scenario, request.bench, request.standing
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        if standing is None:
            devices, notes = connected(stack, request.connect, scenario, bench, screen, stop)
        else:
            devices, notes = standing.connected(scenario, bench, screen, stop)
        rig = DrivenRig(bench, devices, stop, screen, RunClock(clock), standing)
        rig.motion = rig.motion.with_drive(scenario.drive)
        return _Run(request, rig, notes, stop).execute(stack)


class _Run:
    """The parts of one run, joined."""

    def __init__(
        self,
        request: RunRequest,
        rig: DrivenRig,
        notes: dict[str, str],
        stop: StopRequest,
    ) -> None:
        self._request, self._scenario = request, request.scenario
        self._rig, self._notes, self._stop = rig, notes, stop
        self._dropped_before = 0 if request.view is None else request.view.dropped
        self._hold: FrequencyHold | None = None
        self._frequency: FrequencyCheck | None = None
        held = RIGS[self._scenario.rig].held_sine(self._scenario.drive)
        if held is not None and held[0] in rig.names and not request.bench.unseen:
            self._hold = FrequencyHold(*held, rig.sample_rate)
            self._frequency = FrequencyCheck(*held)

    def execute(self, stack: ExitStack) -> Path:
        """Warm up the twin, arm, move and record, finish the prediction; returns the log's path."""
        rig, wanted, model = self._rig, self._scenario.acquisition, self._request.model
        twin = self._matched()
        shown = twin.model.channels.drive
        if shown in rig.names and not self._request.bench.unseen:
            rig.hold_force(shown, self._scenario.drive.frequency, twin, self._request.path)
        rig.launch(stack)
        look_at = "the amplifier on" if rig.motion.speed_rad_s is None else "its sensor on, the speed right"
        beside = [ENCODER_ANGLE.name] if ENCODER_ANGLE.name in twin.sensors else []
        crew = None if self._request.standing is None else self._request.standing.crew
        stands = crew is not None and crew.has("twin")
        self._feed = feed = TwinFeed(
            twin,
            (*rig.names, *beside),
            rig.sample_rate,
            wanted.settle,
            rig.stream,
            rig.logbook.tell,
            rig.screen.warn,
            look_at,
            crew,
        )
        predicted = [channel for channel in predicted_channels(twin) if channel.name in rig.names]
        origins: dict[Origin, list[Channel]] = {
            "measured": list(rig.devices.card.channels),
            "predicted": predicted,
        }
        names = {origin: tuple(channel.name for channel in each) for origin, each in origins.items()}
        mounting = mounting_of(self._chains, twin.model.channels)
        derivation = DerivationProcess(
            names, self._scenario, rig.clock, rig.stream, crew=crew, mounting=mounting
        )
        stack.enter_context(derivation.worker)
        stack.enter_context(feed.worker)
        emulated = "daq_card" in self._request.bench.emulated  # then its start has told it
        work = None if stands else Work(f"warm up {self._scenario.rig}")
        with rig.screen.busy("warming up the twin", work, "" if emulated or stands else FIRST_START):
            feed.worker.wait_ready(self._stop.check)
            derivation.wait_ready(self._stop.check)
        # not before: an output that waits for its trigger is on, and nobody looks while a twin warms up
        rig.motion.arm(starts_softly(wanted), self._request.path)
        log = rig.open_log(stack, self._request.folder, self._scenario.name)
        derived = derived_channels(origins, self._scenario)
        counted = self._request.counted
        further = [each for each in (counted, self._frequency) if each is not None]
        rig.stream += [*self._request.consumers, *further, derivation]
        stack.callback(lambda: derivation.finish(rig.logbook.note))  # however the run ends
        stack.callback(feed.worker.close)  # what it predicts from then on would not be derived from
        readers: list[Reader] = [lambda reading: feed.take(reading, rig.acquisition)]
        if (view := self._request.view) is not None:
            readers.append(self._show(view, twin, origins["measured"], derived))
        if (hold := self._hold) is not None:
            row = rig.names.index(hold.channel)
            readers.insert(0, lambda reading: hold.take(reading.values[row]))
        enough = self._request.enough if counted is None else counted.enough
        rig.record(self._scenario.limits, rig.motion.speed_rad_s, readers, enough)
        rig.logbook.events.append(derivation.events)
        rig.on_stopping = feed.end
        for channel in derived:
            rig.recorder.declare("derived", channel)
        ends = {ENDS: UNTIL_STOPPED} if self._request.open_ended else {}
        rig.declare(log.stem, self._scenario.text, {**self._notes, **ends})
        if model is not None:
            rig.recorder.metadata("twin", twin_record(None, model))
        for channel in predicted_channels(twin):
            if channel.name in (*rig.names, *beside):
                rig.recorder.declare("predicted", channel)
        work = Work(f"finish {self._scenario.rig}", wanted.settle + self._move_and_record())
        with rig.screen.busy("finishing the prediction", work):
            feed.finish(self._stop.check)
            derivation.finish(rig.logbook.note, self._stop.check)
        if view is not None:
            dropped = view.dropped - self._dropped_before
            if dropped:
                rig.logbook.tell("info", "view.dropped", f"{dropped} blocks were not shown")
        rig.recorder.close()
        rig.screen.stage(f"recorded: {log}")
        return log

    @property
    def _chains(self) -> dict[str, str]:
        """What the bench declares of them, as the card samples."""
        return declared_by(self._request.bench, self._rig.sample_rate)

    def _matched(self) -> AnyTwin:
        """The scenario's twin behind the bench's chains, as calibration found it where it did."""
        twin = twin_of(self._scenario, self._rig.names, self._chains)
        if (model := self._request.model) is None:
            return twin
        from rig.twin.logged import with_model

        return with_model(twin, model, self._scenario, self._rig.screen.warn)

    def _show(self, view: LiveView, twin: AnyTwin, card: list[Channel], derived: list[Channel]) -> Reader:
        """Give the view every record from now on, which it may drop; what is returned shows it the levels."""
        from rig.live.picture import layout_of, picture_of
        from rig.live.view import Levels

        encoder, measured = self._rig.devices.encoder, [*card, *self._rig.devices.logged]
        if encoder is not None:
            measured = [*measured, encoder_channel(encoder)]
        bounds = bounds_of(self._request.bench.daq_card.ranges, self._scenario.limits)
        cycle_s = 1 / self._scenario.drive.cycle_hz
        names = {channel.name for channel in measured}
        predicted = [channel for channel in predicted_channels(twin) if channel.name in names]
        picture, rig = picture_of(twin), self._rig
        shown = layout_of(
            self._scenario.name, measured, predicted, picture, derived=derived, bounds=bounds, cycle_s=cycle_s
        )
        show(view, shown, rig.screen)
        rig.stream.append(view.offer)
        if self._request.swept is not None:
            view.offer(self._request.swept)

        def levels(reading: CardReading) -> None:
            end = reading.first_sample + reading.values.shape[1]
            time_ns = sample_time_ns(rig.acquisition.base.start_ns, end, rig.sample_rate)
            most = np.fmax(np.fmax.reduce(reading.values, axis=1), -np.fmin.reduce(reading.values, axis=1))
            view.offer(Levels(time_ns, most.tolist()))

        return levels

    def _await_enter(self) -> None:
        rig = self._rig
        rig.screen.say("armed: Enter starts")
        rig.screen.stage("armed: Enter at the terminal starts")
        rig.watch.until(rig.acquisition, rig.screen.enter_pressed())

    def _move_and_record(self) -> float:
        """Returns how many s were recorded."""
        rig, request = self._rig, self._request
        with rig.moving():
            if request.armed:
                self._await_enter()
            wanted = self._scenario.acquisition
            moves = Sequence(
                wanted, rig, self._feed, self._hold, request.path, request.open_ended, request.counted
            )
            recorded_s = moves.drive_and_record()
        rig.tell_of_marks()
        if rig.encoder is not None:
            for code, text in rig.shaft.encoder_at_mark(rig.encoder):
                rig.logbook.tell("info", code, text)
        found = None if self._frequency is None else self._frequency.result()
        if found is not None and found.code == HELD:
            rig.logbook.tell("info", found.code, str(found))
        elif found is not None:
            rig.warn(found.code, str(found))
        return recorded_s
