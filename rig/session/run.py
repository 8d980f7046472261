"""The sequence of a run: connect, check, arm, start, settle, record, ramp down; safe on every way out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from daq.block import SampleBlock
from daq.channel import Channel
from daq.clock import Clock
from daq.errors import InterlockTripped, RattleError
from daq.log import LogWriter
from daq.log.reader import Origin
from daq.log.records import Event
from daq.recorder import Recorder
from drivers.protocols import CardReading
from rig.files.bench import Bench
from rig.files.model_file import ModelFile
from rig.files.pairing import SOFT_START_FROM_S
from rig.files.scenario import Scenario
from rig.live import LiveView
from rig.session.acquisition import Acquisition
from rig.session.deriving import derive_live
from rig.session.devices import Devices
from rig.session.drive import Shaker, drive_off_after
from rig.session.hub import Hub, Sink
from rig.session.limits import LimitWatch
from rig.session.progress import Screen
from rig.session.provenance import new_run, run_record
from rig.session.signals import StopRequest
from rig.session.sinks import LogSink, ViewSink
from rig.session.supervisor import Supervisor
from rig.twin.alignment import Alignment
from rig.twin.matched_twin import with_model
from rig.twin.picture import picture_of
from rig.twin.prediction_file import twin_record
from rig.twin.rigs import KINDS
from rig.twin.scenario_twin import predicted_channels, twin_of
from rig.twin.worker import Shape, TwinFailed, TwinWorker
from sim_twin.twin import AnyTwin

PRE_TRIGGER_S = 0.05
"""Recorded before a drive that starts from rest, so that the record shows the start."""
_SILENCE_S = 5.0
_LOOKS_EVERY_S = 3.0
"""A sequence that has looked at nothing for so long hangs, whatever the acquisition says."""


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What to run: checked files, turned by `connect` into devices and notes for the log.

    `model`: what calibration found of the rig; None where the twin is the scenario's.
    """

    scenario: Scenario
    bench: Bench
    connect: Callable[[ExitStack, Screen], tuple[Devices, dict[str, str]]]
    folder: Path
    live: bool = False
    model: ModelFile | None = None


def run_scenario(request: RunRequest, screen: Screen, clock: Clock) -> Path:
    """Run and return the path of the log. Whatever happens and is raised, the drive is off after it."""
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        devices, notes = request.connect(stack, screen)
        stack.callback(devices.close)
        stop.check()
        with screen.busy("connecting"):
            devices.open()
        stack.enter_context(drive_off_after(devices.generator, devices.spare_generator, screen))
        screen.say(f"generator  {devices.generator.identity} at {devices.generator.address}")
        screen.say(f"card       {len(devices.card.channels)} channels at {devices.card.sample_rate:g} Hz, "
                   f"{devices.card.address}")  # fmt: skip
        return _Run(request, devices, notes, stop, screen, clock).execute(stack)


class _Run:
    """The state of one run."""

    def __init__(
        self,
        request: RunRequest,
        devices: Devices,
        notes: dict[str, str],
        stop: StopRequest,
        screen: Screen,
        clock: Clock,
    ) -> None:
        self._request, self._scenario = request, request.scenario
        self._devices, self._notes, self._stop, self._screen, self._clock = (
            devices,
            notes,
            stop,
            screen,
            clock,
        )
        self._rate = devices.card.sample_rate
        self._soft = self._scenario.acquisition.settle >= SOFT_START_FROM_S
        self._names = [channel.name for channel in devices.card.channels]
        self._reference = KINDS[self._scenario.rig].reference
        self._feed_from: int | None = None
        self._last = False
        self._view: LiveView | None = None
        self._looked_s = clock.monotonic_s()

    def execute(self, stack: ExitStack) -> Path:
        scenario = self._scenario
        twin = self._twin()
        shaker = Shaker(self._devices.generator, scenario.drive, self._devices.force_per_volt, self._wait)
        shaker.arm(self._soft)
        self._supervisor = Supervisor(self._devices.spare_generator)
        self._supervisor.launch()
        stack.callback(self._supervisor.close)
        self._worker = stack.enter_context(
            TwinWorker(twin, self._rate, scenario.acquisition.settle, self._deliver)
        )
        with self._screen.busy("warming up the twin (compiled on the first run)"):
            self._worker.wait_ready(self._stop.check)
        run = new_run(self._request.folder, scenario.name, self._clock)
        stack.push(partial(self._tell_of_partial, run.log))
        self._recorder = stack.enter_context(Recorder(LogWriter(run.log), self._clock))
        self._hub = Hub(self._sinks(stack, twin))
        self._declare(twin, run.id)
        limits = LimitWatch(scenario.limits, self._rate)
        self._acquisition = Acquisition(self._devices.card, self._clock, self._hub, limits, self._on_reading)
        with (
            self._supervisor,
            self._acquisition,
            drive_off_after(self._devices.generator, self._devices.spare_generator, self._screen),
        ):
            self._drive_and_record(shaker)
        self._close_record()
        if self._request.live:
            self._screen.hold("the live view stays open; Enter closes it ")
        return run.log

    def _twin(self) -> AnyTwin:
        twin, model = twin_of(self._scenario, self._names), self._request.model
        return twin if model is None else with_model(twin, model, self._screen.warn)

    def _sinks(self, stack: ExitStack, twin: AnyTwin) -> list[Sink]:
        sinks: list[Sink] = [LogSink(self._recorder)]
        if self._request.live:
            picture = picture_of(twin)
            channels = (self._devices.card.channels, self._predicted(twin))
            view = stack.enter_context(LiveView(self._scenario.name, *channels, picture))
            self._screen.say(f"live view  {view.url}")
            self._view = view
            sinks.append(ViewSink(view, picture))
        origins: dict[Origin, list[Channel]] = {"measured": list(self._devices.card.channels)}
        origins["predicted"] = self._predicted(twin)
        derived = derive_live(sinks, origins, self._scenario, self._recorder, self._clock)
        self._derived = stack.enter_context(derived)
        return [*sinks, derived]

    def _predicted(self, twin: AnyTwin) -> list[Channel]:
        return [channel for channel in predicted_channels(twin) if channel.name in self._names]

    def _declare(self, twin: AnyTwin, run_id: str) -> None:
        self._recorder.metadata("scenario", {"toml": self._scenario.text})
        record = run_record(self._request.bench, self._devices, run_id, self._clock)
        self._recorder.metadata("run", record | self._notes)
        if self._request.model is not None:
            self._recorder.metadata("twin", twin_record(None, self._request.model))
        for channel in self._devices.card.channels:
            self._recorder.declare("measured", channel)
        for channel in self._predicted(twin):
            self._recorder.declare("predicted", channel)
        for warning in self._devices.card.warnings:
            self._screen.warn(warning)
            self._event("warning", "card.warning", warning)

    def _drive_and_record(self, shaker: Shaker) -> None:
        wanted = self._scenario.acquisition
        with self._screen.bar("settling", wanted.settle) as bar:
            if wanted.settle > 0:
                self._start(shaker)
                full = self._acquisition.acquired
                self._feed_from = full
                self._until(full + self._samples(wanted.settle), bar.at, full)
        pre_trigger = 0 if wanted.settle > 0 else self._samples(PRE_TRIGGER_S)
        if pre_trigger:
            self._feed_from = self._acquisition.acquired
        count = pre_trigger + self._samples(wanted.duration)
        begin = self._acquisition.start_record(count)
        self._event("info", "record.start", "recording")
        with self._screen.bar("recording", wanted.duration) as bar:
            if pre_trigger:
                self._until(begin + pre_trigger)
                self._start(shaker)
            self._until(begin + count, bar.at, begin)
        self._event("info", "record.end", "recorded")
        shaker.ramp_down()
        self._event("info", "drive.off", "drive ramped down and off")

    def _start(self, shaker: Shaker) -> None:
        drive = self._scenario.drive
        shaker.start(self._soft)
        self._event("info", "drive.on", f"{drive.amplitude:g} N at {drive.frequency:g} Hz")

    def _samples(self, seconds: float) -> int:
        return round(seconds * self._rate)

    def _until(self, sample: int, show: Callable[[float], None] = lambda _: None, since: int = 0) -> None:
        """Wait until the card has acquired `sample`; raises what ends the run early."""
        silent_since, seen = self._clock.monotonic_s(), -1
        while self._acquisition.acquired < sample:
            self._check()
            with self._acquisition.changed:
                self._acquisition.changed.wait(0.1)
            show((self._acquisition.acquired - since) / self._rate)
            if self._acquisition.acquired != seen:
                silent_since, seen = self._clock.monotonic_s(), self._acquisition.acquired
            elif self._clock.monotonic_s() - silent_since > _SILENCE_S:
                raise RattleError(f"{self._devices.card.name} gave no samples for {_SILENCE_S:g} s")
        self._check()

    def _wait(self, seconds: float) -> None:
        end = self._clock.monotonic_s() + seconds
        while (left := end - self._clock.monotonic_s()) > 0:
            self._check()
            self._clock.sleep(min(left, 0.02))
        self._check()

    def _check(self) -> None:
        """Raise whatever ends the run: a lost device, a limit, a person."""
        self._looked_s = self._clock.monotonic_s()
        if self._acquisition.error is not None:
            raise self._acquisition.error
        if self._acquisition.tripped is not None:
            raise InterlockTripped(f"interlock: {self._acquisition.tripped}; the drive is off")
        self._supervisor.check()
        if self._stop.wanted:
            self._event("warning", "run.interrupted", "stopped by a person")
        self._stop.check()

    def _on_reading(self, reading: CardReading) -> None:
        """In the acquisition thread: a sign of life, and how far the record is for the twin."""
        acquisition = self._acquisition
        looked_ago = self._clock.monotonic_s() - self._looked_s
        if acquisition.tripped is None and looked_ago < _LOOKS_EVERY_S:
            self._supervisor.beat()
        begin, until = acquisition.record_from, acquisition.record_until
        feed_from = self._feed_from
        if feed_from is not None and reading.first_sample >= feed_from and self._reference in self._names:
            self._worker.drive(reading.first_sample, reading.values[self._names.index(self._reference)])
        if begin is not None and until is not None and not self._last:
            end = min(reading.first_sample + reading.values.shape[1], until)
            self._last = end == until
            self._worker.recorded(begin, end - begin, acquisition.record_start_ns, self._last)

    def _deliver(self, message: object) -> None:
        """In the twin's thread: pass on what it predicts, for the channels that are measured."""
        if isinstance(message, SampleBlock):
            if message.channel in self._names:
                self._hub.block("predicted", message)
        elif isinstance(message, Shape):
            self._hub.shape(message.time_s, message.deflection)
        elif isinstance(message, Alignment):
            self._note_alignment(message)

    def _note_alignment(self, alignment: Alignment) -> None:
        self._feed_from = None
        text = f"drive at {alignment.frequency:.5g} Hz, phase {np.degrees(alignment.phase):.1f} degrees"
        if alignment.trusted:
            self._event("info", "twin.aligned", text)
        else:
            unseen = f"{self._reference} shows no drive"
            self._event("warning", "drive.not_seen", f"{unseen}; the twin follows the scenario")
            self._screen.warn(f"{unseen}: is the amplifier on?")

    def _close_record(self) -> None:
        record = self._acquisition.arrivals.record("host", self._acquisition.start_ns)
        if record is not None:
            self._recorder.clock_record(record)
        try:
            with self._screen.busy("finishing the prediction"):
                self._worker.finish(self._stop.check)
        except TwinFailed as error:
            self._event("error", "twin.failed", str(error))
            raise TwinFailed(
                f"{error}; all that was measured is in the log, rattle overlay adds a prediction"
            ) from error
        self._derived.finish()
        if self._view is not None:
            self._event("info", "view.dropped", f"{self._view.dropped} blocks were not shown")
        self._recorder.close()

    def _tell_of_partial(
        self, log: Path, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        if kind is not None:
            self._screen.say(f"log so far {log}")

    def _event(self, level: str, code: str, text: str) -> None:
        self._hub.event(Event(self._clock.unix_ns(), level, "rig", code, text))
