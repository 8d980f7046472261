"""A run: connect, check, arm, move and record as `Sequence` says; safe on every way out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from daq.channel import Channel
from daq.clock import Clock
from daq.log import LogWriter
from daq.log.reader import Origin
from daq.recorder import Recorder
from daq.time_base import RunClock
from drivers.protocols import CardReading
from rig.derived import derived_channels
from rig.files.bench import Bench
from rig.files.model_file import ModelFile
from rig.files.rigs import RIGS
from rig.files.scenario import Scenario
from rig.live import LiveView
from rig.session.acquisition import Acquisition, Recorded
from rig.session.deriving import derive_live
from rig.session.devices import Devices
from rig.session.drive import Motion, drive_off_after
from rig.session.encoder_record import EncoderRecord, encoder_channel
from rig.session.frequency import HELD, FrequencyHold, FrequencySink
from rig.session.hub import Hub, Sink
from rig.session.limits import LimitWatch
from rig.session.logbook import Logbook
from rig.session.progress import Screen
from rig.session.provenance import new_run, run_record
from rig.session.sequence import Sequence, starts_softly
from rig.session.shaft_watch import ShaftWatch
from rig.session.signals import StopRequest
from rig.session.sinks import LogSink, ViewSink
from rig.session.supervisor import Supervisor
from rig.session.twin_feed import TwinFeed
from rig.session.watch import Watch
from rig.twin.matched_twin import with_model
from rig.twin.picture import picture_of
from rig.twin.prediction_file import twin_record
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.twin import AnyTwin


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What to run: checked files, turned by `connect` into devices and notes for the log.

    `model`: what calibration found of the rig; None where the twin is the scenario's. `enough` is called in
    the acquisition thread with each reading's recorded values by channel, and must be quick; once it returns
    True, the record ends with that reading. `view_stays` until a person closes it.
    `path`: the sections [drive] that the drive comes through before it settles.
    """

    scenario: Scenario
    bench: Bench
    connect: Callable[[ExitStack, Screen], tuple[Devices, dict[str, str]]]
    folder: Path
    live: bool = False
    model: ModelFile | None = None
    enough: Callable[[Recorded], bool] | None = None
    view_stays: bool = True
    path: tuple[Any, ...] = ()


def run_scenario(request: RunRequest, screen: Screen, clock: Clock) -> Path:
    """Run and return the path of the log. Whatever happens and is raised, the drive is off after it."""
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        devices, notes = request.connect(stack, screen)
        stack.callback(devices.close)
        stop.check()
        with screen.busy("connecting"):
            devices.open()
        stack.enter_context(drive_off_after(devices.actuator, devices.spare, screen))
        screen.say(f"drive      {devices.actuator.identity} at {devices.actuator.address}")
        screen.say(f"card       {len(devices.card.channels)} channels at {devices.card.sample_rate:g} Hz, "
                   f"{devices.card.address}")  # fmt: skip
        if devices.encoder is not None:
            screen.say(f"encoder    {devices.encoder.identity} at {devices.encoder.address}")
        return _Run(request, devices, notes, stop, screen, RunClock(clock)).execute(stack)


class _Run:
    """The parts of one run, joined."""

    def __init__(
        self,
        request: RunRequest,
        devices: Devices,
        notes: dict[str, str],
        stop: StopRequest,
        screen: Screen,
        clock: RunClock,
    ) -> None:
        self._request, self._scenario = request, request.scenario
        self._devices, self._notes, self._stop = devices, notes, stop
        self._screen, self._clock = screen, clock
        self._rate = devices.card.sample_rate
        self._names = [channel.name for channel in devices.card.channels]
        self._watch = Watch(clock)
        self._shaft = ShaftWatch(devices.card.channels, self._rate, clock)
        self._hold: FrequencyHold | None
        self._frequency: FrequencySink | None
        self._hold, self._frequency = self._frequency_watched()
        self._view: LiveView | None = None

    def execute(self, stack: ExitStack) -> Path:
        """Arm, warm up the twin, move and record, finish the prediction; returns the log's path."""
        twin, motion = self._twin(), self._motion()
        motion.arm(starts_softly(self._scenario.acquisition), self._request.path)
        self._supervisor = Supervisor(self._devices.spare)
        self._supervisor.launch()
        stack.callback(self._supervisor.close)
        self._feed = TwinFeed(
            twin, self._names, self._rate, self._scenario.acquisition.settle, self._unseen(motion)
        )
        self._origins: dict[Origin, list[Channel]] = {
            "measured": list(self._devices.card.channels),
            "predicted": self._predicted(twin),
        }
        self._derived = derive_live(self._origins, self._scenario, self._clock)
        stack.enter_context(self._derived.worker)
        stack.enter_context(self._feed.worker)
        with self._screen.busy("warming up the twin (compiled on the first run)"):
            self._feed.worker.wait_ready(self._stop.check)
            self._derived.wait_ready(self._stop.check)
        run = new_run(self._request.folder, self._scenario.name, self._clock)
        stack.push(partial(self._tell_of_partial, run.log))
        self._recorder = stack.enter_context(Recorder(LogWriter(run.log), self._clock))
        self._hub = self._feed.hub = Hub(self._sinks(stack, twin))
        self._logbook = Logbook(self._clock, self._recorder, self._hub, self._screen)
        self._feed.tell = self._logbook.tell
        self._declare(run.id)
        self._move_and_record(motion)
        with self._screen.busy("finishing the prediction"):
            self._feed.finish(self._stop.check)
        self._derived.finish(self._logbook.note, self._stop.check)
        if self._view is not None:
            self._logbook.tell("info", "view.dropped", f"{self._view.dropped} blocks were not shown")
        self._recorder.close()
        if self._request.live and self._request.view_stays:
            self._screen.hold("the live view stays open; Enter closes it ")
        return run.log

    def _twin(self) -> AnyTwin:
        twin, model = twin_of(self._scenario, self._names), self._request.model
        return twin if model is None else with_model(twin, model, self._screen.warn)

    def _motion(self) -> Motion:
        """The motion; raises ConfigurationError for a crank that no channel shows."""
        motion = self._devices.motion(self._watch.wait, self._shaft.rpm)
        if motion.speed_rad_s is not None:
            self._shaft.required(self._request.bench.source)
        return motion

    def _unseen(self, motion: Motion) -> Callable[[str], None]:
        look_at = "the amplifier on" if motion.speed_rad_s is None else "its sensor on, the speed right"
        return lambda text: self._screen.warn(f"{text}: is {look_at}?")

    def _move_and_record(self, motion: Motion) -> None:
        limits = LimitWatch(self._scenario.limits, self._rate)
        acquisition = Acquisition(
            self._devices.card, self._clock, self._hub, limits, self._on_reading, self._request.enough
        )
        self._acquisition, encoder = acquisition, self._encoder(acquisition, motion)
        self._follow(motion, encoder)
        sequence = Sequence(
            wanted=self._scenario.acquisition,
            motion=motion,
            acquisition=acquisition,
            encoder=encoder,
            feed=self._feed,
            shaft=self._shaft,
            supervisor=self._supervisor,
            watch=self._watch,
            screen=self._screen,
            tell=self._logbook.tell,
            sample_rate=self._rate,
            hold=self._hold,
            path=self._request.path,
        )
        with ExitStack() as running:
            running.enter_context(self._supervisor)
            running.enter_context(self._logbook)
            running.enter_context(acquisition)
            if encoder is not None:
                running.enter_context(encoder)
            running.enter_context(drive_off_after(sequence, self._devices.spare, self._screen))
            sequence.drive_and_record()
        for code, text in self._shaft.faults(acquisition):
            self._logbook.tell("warning", code, text)
            self._screen.warn(text)
        if encoder is not None:
            for code, text in self._shaft.encoder_at_mark(encoder):
                self._logbook.tell("info", code, text)
        if self._frequency is not None:
            self._verify(self._frequency)

    def _encoder(self, acquisition: Acquisition, motion: Motion) -> EncoderRecord | None:
        encoder = self._devices.encoder
        if encoder is None:
            return None
        gap, wanted_rad_s = self._recorder.gap, motion.speed_rad_s
        return self._shaft.recording(encoder, acquisition, self._hub, gap, wanted_rad_s)

    def _follow(self, motion: Motion, encoder: EncoderRecord | None) -> None:
        """Say what is looked at while the sequence waits, and what the log gets of it."""
        acquisition, logbook = self._acquisition, self._logbook
        self._watch.checks += [acquisition.check, self._shaft.check, motion.check, self._supervisor.check]
        actuator = self._devices.actuator.name
        logbook.events.append(lambda: logbook.stamped(actuator, motion.take_notices()))
        logbook.events.append(self._derived.events)
        logbook.clocks.append(acquisition.base.refit)
        logbook.clocks.append(lambda _: motion.clocks(acquisition.base))
        if encoder is not None:
            self._watch.checks.append(encoder.check)
            logbook.events.append(encoder.events)
            logbook.clocks.append(encoder.clocks)
        self._watch.checks += [logbook.look, self._heed_stop]

    def _heed_stop(self) -> None:
        if self._stop.wanted:
            self._logbook.tell("warning", "run.interrupted", "stopped by a person")
        self._stop.check()

    def _on_reading(self, reading: CardReading) -> None:
        """In the acquisition thread: a sign of life, the shaft's speed, and the twin's share."""
        acquisition = self._acquisition
        for event in self._shaft.take(reading, acquisition):
            self._hub.event(event)
        if acquisition.tripped is None and not self._shaft.tripped and not self._watch.hangs:
            self._supervisor.beat()
        if self._hold is not None:
            self._hold.take(reading.values[self._names.index(self._hold.channel)])
        self._feed.take(reading, acquisition)

    def _frequency_watched(self) -> tuple[FrequencyHold, FrequencySink] | tuple[None, None]:
        """What holds and verifies the frequency of a drive that is a measured sine."""
        sine = RIGS[self._scenario.rig].sine
        hertz = None if sine is None else sine.hertz(self._scenario.drive)
        if sine is None or hertz is None or sine.channel not in self._names or self._request.bench.unseen:
            return None, None
        of_sine = (sine.channel, hertz, self._rate)
        return FrequencyHold(*of_sine), FrequencySink(*of_sine)

    def _verify(self, frequency: FrequencySink) -> None:
        """Say whether the record's drive had the frequency that the scenario asks for."""
        found = frequency.result()
        self._logbook.tell("info" if found.code == HELD else "warning", found.code, str(found))
        if found.code != HELD:
            self._screen.warn(str(found))

    def _sinks(self, stack: ExitStack, twin: AnyTwin) -> list[Sink]:
        sinks: list[Sink] = [LogSink(self._recorder)]
        derived = derived_channels(self._origins, self._scenario)
        if self._frequency is not None:
            sinks.append(self._frequency)
        if self._request.live:
            picture = picture_of(twin)
            channels = (self._origins["measured"], self._origins["predicted"])
            view = stack.enter_context(LiveView(self._scenario.name, *channels, picture, derived=derived))
            self._screen.say(f"live view  {view.url}")
            self._view = view
            sinks.append(ViewSink(view))
        for channel in derived:
            self._recorder.declare("derived", channel)
        self._derived.deliver_to(Hub(sinks), self._recorder.metadata)
        stack.callback(lambda: self._derived.finish(self._logbook.note))  # however the run ends
        stack.callback(self._feed.worker.close)  # what it predicts from then on would not be derived from
        return [*sinks, self._derived]

    def _predicted(self, twin: AnyTwin) -> list[Channel]:
        return [channel for channel in predicted_channels(twin) if channel.name in self._names]

    def _declare(self, run_id: str) -> None:
        self._recorder.metadata("scenario", {"toml": self._scenario.text})
        record = run_record(self._request.bench, self._devices, self._notes, run_id, self._clock)
        self._recorder.metadata("run", record)
        if self._request.model is not None:
            self._recorder.metadata("twin", twin_record(None, self._request.model))
        for channel in self._devices.card.channels:
            self._recorder.declare("measured", channel)
        if self._devices.encoder is not None:
            self._recorder.declare("measured", encoder_channel(self._devices.encoder))
        for channel in self._origins["predicted"]:
            self._recorder.declare("predicted", channel)
        for warning in self._devices.card.warnings:
            self._screen.warn(warning)
            self._logbook.tell("warning", "card.warning", warning)

    def _tell_of_partial(
        self, log: Path, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        if kind is not None:
            self._screen.say(f"log so far {log}")
