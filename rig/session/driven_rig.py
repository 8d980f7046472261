"""A rig that moves while it is recorded: its instruments, what ends it, and the way to rest."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from daq.errors import RecorderFailed
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from daq.time_base.run_clock import RunClock
from drivers.protocols.card import CardReading
from rig.files.bench import Bench
from rig.files.scenario import Limit
from rig.session.acquisition import Acquisition, Recorded
from rig.session.devices import Devices
from rig.session.drive import drive_off_after
from rig.session.encoder_record import EncoderRecord, encoder_channel
from rig.session.hub import Hub
from rig.session.limits import LimitWatch
from rig.session.logbook import Logbook
from rig.session.progress import Screen
from rig.session.provenance import Run, new_run, run_record
from rig.session.shaft_watch import ShaftWatch
from rig.session.signals import StopRequest
from rig.session.supervisor import SILENCE_S, Supervisor
from rig.session.watch import Watch

Connect = Callable[[ExitStack, Screen], tuple[Devices, dict[str, str]]]


def connected(
    stack: ExitStack, connect: Connect, screen: Screen
) -> tuple[StopRequest, Devices, dict[str, str]]:
    """The rig's devices, open, for as long as `stack` lasts, and the notes that `connect` made for the log.

    Whatever is raised from then on, the drive is off after it.
    """
    stop = stack.enter_context(StopRequest())
    devices, notes = connect(stack, screen)
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
    stop.check()
    return stop, devices, notes


class DrivenRig:
    """What a run and other recordings of a moving rig have in common.

    In the order of their use: `launch`, `open_log`, `record`, `declare`, `moving`, and within that `start`,
    `start_record`, `end_record` and `ramp_down`. `check_pair` has to have allowed scenario and bench.
    """

    def __init__(
        self, bench: Bench, devices: Devices, stop: StopRequest, screen: Screen, clock: RunClock
    ) -> None:
        self.devices, self.screen, self.clock = devices, screen, clock
        self._bench, self._stop = bench, stop
        self.sample_rate = devices.card.sample_rate
        self.names = [channel.name for channel in devices.card.channels]
        self.watch = Watch(clock)
        self.shaft = ShaftWatch(devices.card.channels, self.sample_rate, clock)
        self.motion = devices.motion(self.watch.wait, self.shaft.rpm)
        self._supervisor = Supervisor(devices.spare)
        self.recorder: Recorder
        self.hub: Hub
        self.logbook: Logbook
        self.acquisition: Acquisition
        self.encoder: EncoderRecord | None = None
        self.on_stopping: Callable[[], None] = lambda: None
        self._rests = False

    def launch(self, stack: ExitStack) -> None:
        """Start the supervisor's process, which takes seconds."""
        self._supervisor.launch()
        stack.callback(self._supervisor.close)

    def open_log(self, stack: ExitStack, folder: Path, name: str) -> Run:
        """A new log that `recorder` writes; where the stack unwinds by an error its path is said."""
        run = new_run(folder, name, self.clock)
        stack.push(partial(self._tell_of_partial, run.log))
        self.recorder = stack.enter_context(Recorder(LogWriter(run.log), self.clock))
        return run

    def record(
        self,
        hub: Hub,
        limits: Sequence[Limit],
        fastest_rad_s: float | None,
        on_reading: Callable[[CardReading], None] = lambda _: None,
        enough: Callable[[Recorded], bool] | None = None,
    ) -> None:
        """Make what records card and encoder through `hub`; nothing is started yet.

        `on_reading` is called in the acquisition thread; the shaft is to turn at `fastest_rad_s` at most.
        """
        self.hub, self.logbook = hub, Logbook(self.clock, self.recorder, hub, self.screen)
        card, watched = self.devices.card, LimitWatch(limits, self.sample_rate)
        look = partial(self._look, on_reading)
        self.acquisition = Acquisition(card, self.clock, hub, watched, look, enough)
        if self.devices.encoder is not None:
            self.encoder = self.shaft.recording(
                self.devices.encoder, self.acquisition, hub, self.recorder.gap, fastest_rad_s
            )
        self._follow()

    def declare(self, run_id: str, scenario: str, notes: dict[str, str]) -> None:
        """Write what was run (`scenario`, TOML) and on what, and the measured channels."""
        self.recorder.metadata("scenario", {"toml": scenario})
        self.recorder.metadata("run", run_record(self._bench, self.devices, notes, run_id, self.clock))
        for channel in self.devices.card.channels:
            self.recorder.declare("measured", channel)
        if self.devices.encoder is not None:
            self.recorder.declare("measured", encoder_channel(self.devices.encoder))
        for warning in self.devices.card.warnings:
            self.warn("card.warning", warning)

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Supervised, acquiring and with its logbook open; the drive is off on every way out."""
        with ExitStack() as running:
            for each in (self._supervisor, self.logbook, self.acquisition, self.encoder):
                if each is not None:
                    running.enter_context(each)
            running.enter_context(drive_off_after(self, self.devices.spare, self.screen))
            yield

    def start(self, soft: bool, path: Sequence[Any] = ()) -> None:
        """Let it move, unless something speaks against it by now; returns once it is as wanted."""
        self.watch.check()
        self.motion.start(soft, path)
        if self.motion.speed_rad_s is not None:
            self.shaft.arm(self.motion.speed_rad_s)

    def start_record(self, count: int) -> int:
        """Record the next `count` samples of the card, and the encoder with it; returns the first."""
        begin = self.acquisition.start_record(count)
        if self.encoder is not None:
            self.encoder.begin(begin / self.sample_rate)
        return begin

    def end_record(self) -> None:
        """Wait until everything of the record has come."""
        self.watch.until(self.acquisition, lambda: self.recorded)
        encoder, until = self.encoder, self.acquisition.record_until
        if encoder is not None and until is not None:
            encoder.end(until / self.sample_rate)
            self.watch.until(self.acquisition, lambda: encoder.ended)

    @property
    def recorded(self) -> bool:
        """Whether the record is complete; what asks for less may have brought its end nearer."""
        until = self.acquisition.record_until
        return until is not None and self.acquisition.acquired >= until

    def ramp_down(self) -> None:
        """Bring the drive softly to rest."""
        self._bring_to_rest(self.motion.ramp_down)
        self._rests = True
        self.logbook.tell("info", "drive.off", "drive ramped down and off")

    def off(self) -> None:
        """The safe state, on whatever way out; before its time, `on_stopping` and the log hear of it."""
        try:
            if not self._rests:
                self.on_stopping()
                self._tell_of_stopping()
        finally:  # nothing that goes wrong with a log may keep the drive on
            self._bring_to_rest(self.motion.off)

    def warn(self, code: str, text: str) -> None:
        """Tell a warning to log and screen."""
        self.logbook.tell("warning", code, text)
        self.screen.warn(text)

    def tell_of_marks(self) -> None:
        """Tell what was wrong with the recorded marks."""
        for code, text in self.shaft.faults(self.acquisition):
            self.warn(code, text)

    def tell_of_encoder(self) -> None:
        """Tell how an encoder stands against the marks."""
        if self.encoder is not None:
            for code, text in self.shaft.encoder_at_mark(self.encoder):
                self.logbook.tell("info", code, text)

    def _tell_of_stopping(self) -> None:
        text = "stopping before its time: what is recorded from here on has no prediction"
        with suppress(RecorderFailed):  # a log that takes nothing more may be why it stops
            self.logbook.tell("warning", "drive.stopping", text)

    def _bring_to_rest(self, stop: Callable[[], None]) -> None:
        """Stop the drive; the supervisor waits as long as that may take."""
        self.shaft.disarm()
        if self.motion.longest_stop_s > 0.0:
            self._supervisor.beat(self.motion.longest_stop_s + SILENCE_S)
        stop()

    def _follow(self) -> None:
        """Say what is looked at while somebody waits, and what the log gets of it."""
        acquisition, logbook, motion = self.acquisition, self.logbook, self.motion
        self.watch.checks += [acquisition.check, self.shaft.check, motion.check, self._supervisor.check]
        actuator = self.devices.actuator.name
        logbook.events.append(lambda: logbook.stamped(actuator, motion.take_notices()))
        logbook.clocks += [acquisition.base.refit, lambda _: motion.clocks(acquisition.base)]
        if self.encoder is not None:
            self.watch.checks.append(self.encoder.check)
            logbook.events.append(self.encoder.events)
            logbook.clocks.append(self.encoder.clocks)
        self.watch.checks += [logbook.look, self._heed_stop]

    def _look(self, on_reading: Callable[[CardReading], None], reading: CardReading) -> None:
        """In the acquisition thread: the shaft, a sign of life, and whatever else wants the reading."""
        for event in self.shaft.take(reading, self.acquisition):
            self.hub.event(event)
        if self.acquisition.tripped is None and not self.shaft.tripped and not self.watch.hangs:
            self._supervisor.beat()
        on_reading(reading)

    def _heed_stop(self) -> None:
        if self._stop.wanted:
            self.logbook.tell("warning", "run.interrupted", "stopped by a person")
        self._stop.check()

    def _tell_of_partial(
        self, log: Path, kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> None:
        if kind is not None:
            self.screen.say(f"log so far {log}")
