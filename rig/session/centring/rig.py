"""Centring on the rig: generator and card in place of a simulation, with all that stops a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from daq.block import BLIND, Flag, SampleBlock
from daq.clock import Clock
from daq.errors import ConfigurationError, Problem
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from daq.time_base.run_clock import RunClock
from drivers.protocols.card import CardReading
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.session.acquisition import Acquisition
from rig.session.centring.probe import CentringPlan, Probe, centre_beam
from rig.session.centring.record import CentringRecord
from rig.session.centring.search import Middle, NoCentre
from rig.session.devices import Devices
from rig.session.drive import Shaker, drive_off_after
from rig.session.hub import Hub
from rig.session.limits import LimitWatch
from rig.session.progress import Bar, Screen
from rig.session.signals import StopRequest
from rig.session.sinks import LogSink
from rig.session.supervisor import Supervisor
from rig.session.watch import Watch

Connect = Callable[[Scenario, Bench, ExitStack, Screen], tuple[Devices, dict[str, str]]]
FORCES: Final = ("contact.force_upper", "contact.force_lower")
_USUAL_PROBES: Final = 18
_LONGEST_S: Final = 3600.0


@dataclass(frozen=True, slots=True)
class Centred:
    """What was found, and the log that shows how."""

    middle: Middle
    log: Path


def find_centre(
    scenario: Scenario,
    bench: Bench,
    plan: CentringPlan,
    connect: Connect,
    screen: Screen,
    clock: Clock,
    folder: Path,
) -> Centred:
    """Find the offset in N that centres a beam, with a log in `folder`.

    Whatever is raised, the drive is off after it, and the log holds what there was.
    """
    clock = RunClock(clock)
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        devices, notes = connect(scenario, bench, stack, screen)
        stack.callback(devices.close)
        with screen.busy("connecting"):
            devices.open()
        stack.enter_context(drive_off_after(devices.actuator, devices.spare, screen))
        record = stack.enter_context(CentringRecord(folder, scenario, bench, devices, notes, clock))
        beam = _RigBeam(scenario, devices, stop, Hub([LogSink(record.recorder), _Warnings(screen)]), clock)
        with beam.acquiring(), screen.bar("centring", _USUAL_PROBES, "offsets") as bar:
            drive_off = drive_off_after(beam.shaker.generator, devices.spare, screen)
            with drive_off:
                beam.start(plan)
                middle = centre_beam(beam, plan, partial(_tried, beam, record, bar))
                beam.let_go()
        record.found(middle, plan)
    return Centred(middle, record.path)


def _tried(beam: _RigBeam, record: CentringRecord, bar: Bar, probe: Probe) -> None:
    bar.at(probe.number)
    record.note(probe, *beam.listened)


class _Warnings:
    """A sink that says what the log of a run would tell."""

    def __init__(self, screen: Screen) -> None:
        self._screen = screen

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """The log has them."""

    def impact(self, impact: Impact) -> None:
        """Impacts are counted by the search itself."""

    def event(self, event: Event) -> None:
        """Say what wants attention."""
        if event.level != "info":
            self._screen.warn(event.text)

    def shape(self, time_s: float, deflection: NDArray[np.floating]) -> None:
        """Nothing is predicted."""


class _RigBeam:
    """A `ShakenBeam` behind a generator and a card."""

    def __init__(
        self, scenario: Scenario, devices: Devices, stop: StopRequest, hub: Hub, clock: Clock
    ) -> None:
        self._devices, self._watch, self.sample_rate = devices, Watch(clock), devices.card.sample_rate
        self._rows = _rows([channel.name for channel in devices.card.channels], devices.card.address)
        motion = devices.motion(self._watch.wait, lambda: math.nan)
        if not isinstance(motion, Shaker):
            raise ConfigurationError(scenario.name, [Problem("rig", scenario.rig, "a rig with a shaker")])
        self.shaker = motion
        self._supervisor = Supervisor(devices.spare)
        limits = LimitWatch(scenario.limits, self.sample_rate)
        self._acquisition = Acquisition(devices.card, clock, hub, limits, self._on_reading)
        self._watch.checks += [self._acquisition.check, self._supervisor.check, stop.check]
        self._wanted_from: int | None = None
        self._heard_from: int | None = None
        self._heard: list[NDArray[np.float64]] = []
        self._flags = Flag.GOOD
        self._offset = 0.0
        self.listened = (0, 0)
        """The samples of the record by which the last offset was judged."""

    def acquiring(self) -> ExitStack:
        """Supervisor and acquisition, for as long as the context lasts."""
        with ExitStack() as stack:
            self._supervisor.launch()
            stack.callback(self._supervisor.close)
            stack.enter_context(self._supervisor)
            stack.enter_context(self._acquisition)
            self._began = self._acquisition.start_record(round(_LONGEST_S * self.sample_rate))
            return stack.pop_all()

    def start(self, plan: CentringPlan) -> None:
        """The least sine, without an offset."""
        generator = self.shaker.generator
        volts = plan.sine.least / self.shaker.force_per_volt
        generator.arm_sine(plan.frequency, volts, 0.0, triggered=False)
        generator.start()

    def let_go(self) -> None:
        """Take the offset back, in steps."""
        for share in np.linspace(1.0, 0.0, 9)[1:]:
            self.wait(0.025)
            self.shaker.generator.set_offset(float(share) * self._offset / self.shaker.force_per_volt)

    def shake(self, amplitude: float) -> None:
        """Set the sine's amplitude in N."""
        self.shaker.generator.set_amplitude(amplitude / self.shaker.force_per_volt)

    def push(self, offset: float) -> None:
        """Set the offset in N."""
        self._offset = offset
        self.shaker.generator.set_offset(offset / self.shaker.force_per_volt)

    def wait(self, seconds: float) -> None:
        """Wait; raises what ends a run."""
        self._watch.wait(seconds)

    def forces(self, seconds: float) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """The two contact forces of the next seconds; raises NoCentre where a sensor does not show them."""
        count = round(seconds * self.sample_rate)
        self._heard, self._heard_from, self._flags = [], None, Flag.GOOD
        self._wanted_from = self._acquisition.acquired
        self._watch.until(self._acquisition, lambda: self._collected() >= count)
        self._wanted_from = None
        if self._flags & BLIND:  # it would look as if no stop were touched, however far the beam is pushed
            raise NoCentre("a contact force is overloaded, open or not finite: see its sensor and cable")
        first = (self._heard_from or 0) - self._began
        self.listened = first, first + count
        upper, lower = np.concatenate(self._heard, axis=1)[:, :count]
        return upper, lower

    def _collected(self) -> int:
        return sum(each.shape[1] for each in self._heard)

    def _on_reading(self, reading: CardReading) -> None:
        """In the acquisition thread: a sign of life, and the forces while they are wanted."""
        if self._acquisition.tripped is None and not self._watch.hangs:
            self._supervisor.beat()
        begin = self._wanted_from
        if begin is not None and reading.first_sample >= begin:
            if self._heard_from is None:
                self._heard_from = reading.first_sample
            for row in self._rows:
                self._flags |= reading.flags[row]
            self._heard.append(reading.values[self._rows])


def _rows(names: list[str], address: str) -> list[int]:
    missing = [name for name in FORCES if name not in names]
    if missing:
        problem = Problem(
            "daq_card.channels", ", ".join(missing), "both contact forces, by which a beam is centred"
        )
        raise ConfigurationError(address, [problem])
    return [names.index(name) for name in FORCES]
