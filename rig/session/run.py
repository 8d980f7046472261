"""A run: connect, check, arm, move and record as `Sequence` says; safe on every way out."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq.channel import Channel
from daq.clock import Clock
from daq.log.reader import Origin
from daq.time_base.run_clock import RunClock
from drivers.protocols.card import CardReading
from rig.derived.sink import derived_channels
from rig.files.bench import Bench
from rig.files.model_file import ModelFile
from rig.files.scenario import Scenario
from rig.live.view import LiveView
from rig.rigs import RIGS
from rig.session.acquisition import Recorded
from rig.session.deriving import derive_live
from rig.session.driven_rig import Connect, DrivenRig, connected
from rig.session.encoder_record import encoder_channel
from rig.session.frequency import HELD, FrequencyHold, FrequencySink
from rig.session.hub import Hub, Sink
from rig.session.progress import FIRST_START, Screen
from rig.session.sequence import Sequence, starts_softly
from rig.session.signals import StopRequest
from rig.session.sinks import LogSink, ViewSink
from rig.session.twin_feed import TwinFeed
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
    connect: Connect
    folder: Path
    live: bool = False
    model: ModelFile | None = None
    enough: Callable[[Recorded], bool] | None = None
    view_stays: bool = True
    path: tuple[Any, ...] = ()


def run_scenario(request: RunRequest, screen: Screen, clock: Clock) -> Path:
    """Run and return the path of the log. Whatever happens and is raised, the drive is off after it."""
    with ExitStack() as stack:
        stop, devices, notes = connected(stack, request.connect, screen)
        rig = DrivenRig(request.bench, devices, stop, screen, RunClock(clock))
        return _Run(request, rig, notes, stop).execute(stack)


class _Run:
    """The parts of one run, joined."""

    def __init__(self, request: RunRequest, rig: DrivenRig, notes: dict[str, str], stop: StopRequest) -> None:
        self._request, self._scenario = request, request.scenario
        self._rig, self._notes, self._stop = rig, notes, stop
        self._hold: FrequencyHold | None
        self._frequency: FrequencySink | None
        self._hold, self._frequency = self._frequency_watched()
        self._view: LiveView | None = None

    def execute(self, stack: ExitStack) -> Path:
        """Arm, warm up the twin, move and record, finish the prediction; returns the log's path."""
        rig, wanted, twin = self._rig, self._scenario.acquisition, self._twin()
        rig.motion.arm(starts_softly(wanted), self._request.path)
        rig.launch(stack)
        self._feed = TwinFeed(twin, rig.names, rig.sample_rate, wanted.settle, self._unseen)
        self._origins: dict[Origin, list[Channel]] = {
            "measured": list(rig.devices.card.channels),
            "predicted": self._predicted(twin),
        }
        self._derived = derive_live(self._origins, self._scenario, rig.clock)
        stack.enter_context(self._derived.worker)
        stack.enter_context(self._feed.worker)
        emulated = "daq_card" in self._request.bench.emulated  # then its start has told it
        with rig.screen.busy(f"warming up the twin{'' if emulated else f' ({FIRST_START})'}"):
            self._feed.worker.wait_ready(self._stop.check)
            self._derived.wait_ready(self._stop.check)
        run = rig.open_log(stack, self._request.folder, self._scenario.name)
        self._feed.hub = Hub(self._sinks(stack, twin))
        rig.record(
            self._feed.hub,
            self._scenario.limits,
            rig.motion.speed_rad_s,
            self._on_reading,
            self._request.enough,
        )
        rig.logbook.events.append(self._derived.events)
        self._feed.tell = rig.logbook.tell
        rig.on_stopping = self._feed.end
        self._declare(run.id)
        self._move_and_record()
        with rig.screen.busy("finishing the prediction"):
            self._feed.finish(self._stop.check)
        self._derived.finish(rig.logbook.note, self._stop.check)
        if self._view is not None:
            rig.logbook.tell("info", "view.dropped", f"{self._view.dropped} blocks were not shown")
        rig.recorder.close()
        if self._request.live and self._request.view_stays:
            rig.screen.hold("the live view stays open; Enter closes it ")
        return run.log

    def _twin(self) -> AnyTwin:
        twin, model = twin_of(self._scenario, self._rig.names), self._request.model
        return twin if model is None else with_model(twin, model, self._rig.screen.warn)

    def _unseen(self, text: str) -> None:
        look_at = "its sensor on, the speed right"
        if self._rig.motion.speed_rad_s is None:
            look_at = "the amplifier on"
        self._rig.screen.warn(f"{text}: is {look_at}?")

    def _move_and_record(self) -> None:
        with self._rig.moving():
            sequence = Sequence(
                self._scenario.acquisition, self._rig, self._feed, self._hold, self._request.path
            )
            sequence.drive_and_record()
        self._rig.tell_of_marks()
        self._rig.tell_of_encoder()
        if self._frequency is not None:
            self._verify(self._frequency)

    def _on_reading(self, reading: CardReading) -> None:
        """In the acquisition thread: what holds the frequency, and the twin's share."""
        if self._hold is not None:
            self._hold.take(reading.values[self._rig.names.index(self._hold.channel)])
        self._feed.take(reading, self._rig.acquisition)

    def _frequency_watched(self) -> tuple[FrequencyHold, FrequencySink] | tuple[None, None]:
        """What holds and verifies the frequency of a drive that is a measured sine."""
        sine = RIGS[self._scenario.rig].sine
        hertz = None if sine is None else sine.hertz(self._scenario.drive)
        if sine is None or hertz is None or sine.channel not in self._rig.names or self._request.bench.unseen:
            return None, None
        of_sine = (sine.channel, hertz, self._rig.sample_rate)
        return FrequencyHold(*of_sine), FrequencySink(*of_sine)

    def _verify(self, frequency: FrequencySink) -> None:
        """Say whether the record's drive had the frequency that the scenario asks for."""
        found = frequency.result()
        if found.code == HELD:
            self._rig.logbook.tell("info", found.code, str(found))
        else:
            self._rig.warn(found.code, str(found))

    def _sinks(self, stack: ExitStack, twin: AnyTwin) -> list[Sink]:
        sinks: list[Sink] = [LogSink(self._rig.recorder)]
        derived = derived_channels(self._origins, self._scenario)
        if self._frequency is not None:
            sinks.append(self._frequency)
        if self._request.live:
            picture = picture_of(twin)
            encoder = self._rig.devices.encoder
            beside = [] if encoder is None else [encoder_channel(encoder)]
            channels = ([*self._origins["measured"], *beside], self._origins["predicted"])
            view = stack.enter_context(LiveView(self._scenario.name, *channels, picture, derived=derived))
            self._rig.screen.say(f"live view  {view.url}")
            self._view = view
            sinks.append(ViewSink(view))
        for channel in derived:
            self._rig.recorder.declare("derived", channel)
        self._derived.deliver_to(Hub(sinks), self._rig.recorder.metadata)
        stack.callback(lambda: self._derived.finish(self._rig.logbook.note))  # however the run ends
        stack.callback(self._feed.worker.close)  # what it predicts from then on would not be derived from
        return [*sinks, self._derived]

    def _predicted(self, twin: AnyTwin) -> list[Channel]:
        return [channel for channel in predicted_channels(twin) if channel.name in self._rig.names]

    def _declare(self, run_id: str) -> None:
        rig, model = self._rig, self._request.model
        rig.declare(run_id, self._scenario.text, self._notes)
        if model is not None:
            rig.recorder.metadata("twin", twin_record(None, model))
        for channel in self._origins["predicted"]:
            rig.recorder.declare("predicted", channel)
