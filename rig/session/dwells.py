"""Dwells: the shaft at one speed after the other, recorded in one log; no twin runs beside it.

Two speeds on one start of the card tell an encoder's lag from its mounting angle (`rattle skew`): how each
start joins the encoder's clock to the card's is then the same for both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from daq.clock import Clock
from daq.errors import ConfigurationError, Problem
from daq.log import LogWriter
from daq.recorder import Recorder
from daq.time_base import RunClock
from drivers.protocols import CardReading
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.session.acquisition import Acquisition
from rig.session.devices import Devices
from rig.session.drive import drive_off_after
from rig.session.encoder_record import EncoderRecord, encoder_channel
from rig.session.hub import Hub
from rig.session.limits import LimitWatch
from rig.session.logbook import Logbook
from rig.session.motor import OVERSPEED, Motor
from rig.session.progress import Screen
from rig.session.provenance import new_run, run_record
from rig.session.shaft_speed import ShaftSpeed
from rig.session.signals import StopRequest
from rig.session.sinks import LogSink
from rig.session.speed_guard import guards_of_shaft
from rig.session.supervisor import SILENCE_S, Supervisor
from rig.session.watch import Watch
from rig.twin.overlay import DWELLS

_RPM_PER_RAD_S = 60.0 / math.tau
_LONGEST_S = 3600.0
"""A record has a length before it begins; this one ends with its last dwell."""


@dataclass(frozen=True, slots=True)
class DwellRequest:
    """What to record: `scenarios`, checked, differ in their speed alone; `dwell_s` is spent at each.

    `connect` makes the devices of the first.
    """

    scenarios: Sequence[Scenario]
    bench: Bench
    dwell_s: float
    connect: Callable[[ExitStack, Screen], tuple[Devices, dict[str, str]]]
    folder: Path

    @property
    def speeds_rad_s(self) -> list[float]:
        """One for each dwell."""
        return [float(scenario.drive.speed) for scenario in self.scenarios]

    @property
    def what(self) -> str:
        """The dwells in words."""
        rpm = ", ".join(f"{speed * _RPM_PER_RAD_S:g}" for speed in self.speeds_rad_s)
        return f"{rpm} rpm, {self.dwell_s:g} s each"


def record_dwells(request: DwellRequest, screen: Screen, clock: Clock) -> Path:
    """Record and return the path of the log. Whatever happens and is raised, the motor is off after it."""
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        devices, notes = request.connect(stack, screen)
        stack.callback(devices.close)
        with screen.busy("connecting"):
            devices.open()
        stack.enter_context(drive_off_after(devices.actuator, devices.spare, screen))
        return _Dwells(request, devices, notes, stop, screen, RunClock(clock)).execute(stack)


class _Dwells:
    def __init__(
        self,
        request: DwellRequest,
        devices: Devices,
        notes: dict[str, str],
        stop: StopRequest,
        screen: Screen,
        clock: RunClock,
    ) -> None:
        self._request, self._devices, self._screen, self._clock = request, devices, screen, clock
        self._notes = {**notes, DWELLS: request.what}
        card = devices.card
        self._rate = card.sample_rate
        self._watch = Watch(clock)
        self._watch.checks.append(stop.check)
        self._shaft = ShaftSpeed(card.channels, self._rate, clock)
        self._guards = self._guard, self._encoder_guard = guards_of_shaft(clock)
        self._row = _row(self._shaft.channel, devices)
        self._supervisor = Supervisor(devices.spare)
        self._ended = False

    def execute(self, stack: ExitStack) -> Path:
        """Move, record and stop; returns the log's path."""
        motor = self._motor()
        motor.arm(soft=True)
        self._supervisor.launch()
        stack.callback(self._supervisor.close)
        run = new_run(self._request.folder, self._request.scenarios[0].name, self._clock)
        recorder = stack.enter_context(Recorder(LogWriter(run.log), self._clock))
        self._declare(recorder, run.id)
        self._hub = Hub([LogSink(recorder)])
        logbook = Logbook(self._clock, recorder, self._hub, self._screen)
        limits = LimitWatch(self._request.scenarios[0].limits, self._rate)
        card = self._devices.card
        self._acquisition = Acquisition(
            card, self._clock, self._hub, limits, self._on_reading, lambda _: self._ended
        )
        encoder = self._encoder(recorder)
        self._follow(motor, encoder, logbook)
        with ExitStack() as running:
            for each in (self._supervisor, logbook, self._acquisition):
                running.enter_context(each)
            if encoder is not None:
                running.enter_context(encoder)
            running.enter_context(drive_off_after(motor, self._devices.spare, self._screen))
            self._dwell(motor, encoder, logbook)
            self._disarm()
            self._supervisor.beat(motor.longest_stop_s + SILENCE_S)
            motor.ramp_down()
            logbook.tell("info", "drive.off", "drive ramped down and off")
        recorder.close()
        return run.log

    def _motor(self) -> Motor:
        motion = self._devices.motion(self._watch.wait, self._shaft.rpm)
        if not isinstance(motion, Motor):
            scenario = self._request.scenarios[0]
            raise ConfigurationError(scenario.name, [Problem("rig", scenario.rig, "a slider-crank")])
        return motion

    def _encoder(self, recorder: Recorder) -> EncoderRecord | None:
        if self._devices.encoder is None:
            return None
        fastest_rad_s = OVERSPEED * max(self._request.speeds_rad_s)
        base, gap, guard = self._acquisition.base, recorder.gap, self._encoder_guard
        return EncoderRecord(self._devices.encoder, base, self._hub, gap, fastest_rad_s, guard)

    def _follow(self, motor: Motor, encoder: EncoderRecord | None, logbook: Logbook) -> None:
        """Say what is looked at while the motor turns, and what the log gets of it."""
        acquisition = self._acquisition
        self._watch.checks += [acquisition.check, *(guard.check for guard in self._guards)]
        self._watch.checks += [motor.check, self._supervisor.check]
        logbook.events.append(motor.events)
        logbook.clocks += [acquisition.base.refit, lambda _: motor.clocks(acquisition.base)]
        if encoder is not None:
            self._watch.checks.append(encoder.check)
            logbook.events.append(encoder.events)
            logbook.clocks.append(encoder.clocks)
        self._watch.checks.append(logbook.look)

    def _dwell(self, motor: Motor, encoder: EncoderRecord | None, logbook: Logbook) -> None:
        """From speed to speed; the record begins with the first dwell and ends with the last."""
        acquisition, speeds = self._acquisition, self._request.speeds_rad_s
        for number, speed in enumerate(speeds, start=1):
            self._disarm()
            if number == 1:
                motor.start(soft=True)
                begin = acquisition.start_record(round(_LONGEST_S * self._rate))
                if encoder is not None:
                    encoder.begin(begin / self._rate)
            else:
                motor.go_to(speed)
            for guard in self._guards:
                guard.arm(speed)
            logbook.tell("info", "dwell.start", motor.what)
            self._stay(f"dwell {number} of {len(speeds)}")
            logbook.tell("info", "dwell.end", motor.what)
        self._end(encoder)

    def _disarm(self) -> None:
        for guard in self._guards:
            guard.disarm()

    def _stay(self, what: str) -> None:
        acquisition, wanted_s = self._acquisition, self._request.dwell_s
        begin = acquisition.acquired

        def stayed_s() -> float:
            return (acquisition.acquired - begin) / self._rate

        with self._screen.bar(what, wanted_s) as bar:
            self._watch.until(acquisition, lambda: stayed_s() >= wanted_s, lambda: bar.at(stayed_s()))

    def _end(self, encoder: EncoderRecord | None) -> None:
        acquisition = self._acquisition
        self._ended = True
        self._watch.until(acquisition, lambda: acquisition.acquired >= (acquisition.record_until or 0))
        if encoder is not None:
            encoder.end((acquisition.record_until or 0) / self._rate)
            self._watch.until(acquisition, lambda: encoder.ended)

    def _on_reading(self, reading: CardReading) -> None:
        """In the acquisition thread: the shaft's speed, and a sign of life."""
        acquisition = self._acquisition
        self._shaft.take(reading.first_sample, reading.values[self._row])
        for event in self._guard.look(self._shaft.shown, acquisition.acquired / self._rate):
            self._hub.event(event)
        tripped = any(each.tripped is not None for each in (acquisition, *self._guards))
        if not tripped and not self._watch.hangs:
            self._supervisor.beat()

    def _declare(self, recorder: Recorder, run_id: str) -> None:
        recorder.metadata("scenario", {"toml": self._request.scenarios[0].text})
        record = run_record(self._request.bench, self._devices, self._notes, run_id, self._clock)
        recorder.metadata("run", record)
        for channel in self._devices.card.channels:
            recorder.declare("measured", channel)
        if self._devices.encoder is not None:
            recorder.declare("measured", encoder_channel(self._devices.encoder))


def _row(shown_by: str | None, devices: Devices) -> int:
    """Row of the channel that shows the shaft; raises ConfigurationError where none does."""
    names = [channel.name for channel in devices.card.channels]
    if shown_by is None:
        allowed = "one that shows the crank turn: its angle on a counter, or its marker"
        problem = Problem("daq_card.channels", ", ".join(names), allowed)
        raise ConfigurationError(devices.card.address, [problem])
    return names.index(shown_by)
