"""Dwells: the shaft at one speed after the other, recorded in one log; no twin runs beside it.

Two speeds on one start of the card tell an encoder's lag from its mounting angle (`rattle skew`): how each
start joins the encoder's clock to the card's is then the same for both.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from daq.clock import Clock
from daq.errors import ConfigurationError, Problem
from daq.time_base.run_clock import RunClock
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.session.devices import Connect, connected
from rig.session.driven_rig import DrivenRig
from rig.session.motor import Motor
from rig.session.progress import Screen
from rig.session.shaft_speed import RPM_PER_RAD_S
from rig.session.signals import StopRequest
from rig.twin.logged import DWELLS

_WITHOUT_END = 2**62
"""Samples of a record that ends with its last dwell."""


@dataclass(frozen=True, slots=True)
class DwellRequest:
    """What to record: `scenarios`, checked, differ in their speed alone; `dwell_s` is spent at each.

    `connect` makes the devices of the first.
    """

    scenarios: Sequence[Scenario]
    bench: Bench
    dwell_s: float
    connect: Connect
    folder: Path

    @property
    def speeds_rad_s(self) -> list[float]:
        return [float(scenario.drive.speed) for scenario in self.scenarios]

    @property
    def what(self) -> str:
        rpm = ", ".join(f"{speed * RPM_PER_RAD_S:g}" for speed in self.speeds_rad_s)
        return f"{rpm} rpm, {self.dwell_s:g} s each"


def record_dwells(request: DwellRequest, screen: Screen, clock: Clock) -> Path:
    """Record and return the path of the log. Whatever happens and is raised, the motor is off after it."""
    first = request.scenarios[0]
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        devices, notes = connected(stack, request.connect, first, request.bench, screen, stop)
        rig = DrivenRig(request.bench, devices, stop, screen, RunClock(clock))
        if not isinstance(rig.motion, Motor):
            raise ConfigurationError(first.name, [Problem("rig", first.rig, "a crank that rattle turns")])
        ended = threading.Event()  # the last dwell, and the record with it
        rig.launch(stack)
        rig.motion.arm(soft=True)
        log = rig.open_log(stack, request.folder, f"{first.name} dwells")
        rig.record(first.limits, max(request.speeds_rad_s), enough=ended.is_set)
        rig.declare(log.stem, first.text, {**notes, DWELLS: request.what})
        with rig.moving():
            rig.start(soft=True)
            rig.start_record(_WITHOUT_END)
            for number, speed_rad_s in enumerate(request.speeds_rad_s, start=1):
                if number > 1:
                    rig.shaft.disarm()
                    rig.motion.go_to(speed_rad_s)
                    rig.shaft.arm(speed_rad_s)
                rig.logbook.tell("info", "dwell.start", rig.motion.what)
                _stay(rig, request.dwell_s, f"dwell {number} of {len(request.scenarios)}")
                rig.logbook.tell("info", "dwell.end", rig.motion.what)
            ended.set()
            rig.end_record()
            rig.ramp_down()
        rig.tell_of_marks()
        rig.recorder.close()
        return log


def _stay(rig: DrivenRig, seconds: float, what: str) -> None:
    begin = rig.acquisition.acquired

    def stayed_s() -> float:
        return (rig.acquisition.acquired - begin) / rig.sample_rate

    with rig.screen.bar(what, seconds) as bar:
        rig.watch.until(rig.acquisition, lambda: stayed_s() >= seconds, lambda: bar(stayed_s()))
