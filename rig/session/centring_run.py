"""Centring on the rig: generator and card in place of a simulation, with all that stops a run."""

from __future__ import annotations

import dataclasses
import json
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from daq.block import BLIND, Flag
from daq.clock import Clock
from daq.errors import ConfigurationError, Problem, RattleError, RecorderFailed
from daq.log.records import Event
from daq.time_base.run_clock import RunClock
from drivers.protocols.card import CardReading
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.rigs import RIGS
from rig.session.centring import CentringPlan, Middle, NoCentre, Probe, centre_beam, load_contact_scan
from rig.session.devices import Connect, connected
from rig.session.drive import Shaker
from rig.session.driven_rig import DrivenRig
from rig.session.progress import Screen
from rig.session.signals import StopRequest
from rig.stream import Record
from rig.twin.chains import declared_by
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.channels import LOWER, UPPER

FORCES: Final = UPPER.name, LOWER.name
_USUAL_PROBES: Final = 18
_LONGEST_S: Final = 3600.0

RECORD: Final = "centring"
"""The metadata record with the offsets and the result, each JSON."""


def find_centre(
    scenario: Scenario,
    bench: Bench,
    plan: CentringPlan,
    connect: Connect,
    screen: Screen,
    clock: Clock,
    folder: Path,
) -> tuple[Middle, Path]:
    """Find the offset in N that centres a beam, and return it with the log in `folder` that shows how.

    Whatever is raised, the drive is off after it, and the log holds what there was.
    """
    load_contact_scan()
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        devices, notes = connected(stack, connect, scenario, bench, screen, stop)
        rig = DrivenRig(bench, devices, stop, screen, RunClock(clock))
        if (shown := RIGS[scenario.rig].channels.drive) in rig.names:
            twin = twin_of(scenario, rig.names, declared_by(bench, rig.sample_rate))
            sine = replace(twin.drive, frequency=plan.frequency, amplitude=plan.sine.amplitude)
            rig.hold_force(shown, plan.frequency, replace(twin, drive=sine))
        beam = RigBeam(rig, scenario, plan)
        rig.launch(stack)
        rig.motion.arm(soft=True)
        log = rig.open_log(stack, folder, f"{scenario.name} centring")

        def say(record: Record) -> None:
            # what else is told of a rig says itself on the screen
            if isinstance(record, Event) and record.source == "acquisition" and record.level != "info":
                screen.warn(record.text)

        rig.stream.append(say)
        rig.record(scenario.limits, None, [beam.take])
        rig.declare(log.stem, scenario.text, notes)
        with CentringRecord(rig) as record:
            with rig.moving(), screen.bar("centring", _USUAL_PROBES, "offsets") as bar:

                def told(probe: Probe) -> None:
                    bar(probe.number)
                    record.note(probe, *beam.listened)

                beam.start()
                middle = centre_beam(beam, plan, told)
                rig.ramp_down()
            record.found(middle, plan)
        rig.recorder.close()
    return middle, log


class RigBeam:
    """A `ShakenBeam` behind a generator and a card: those of a driven rig that is not recording yet."""

    def __init__(self, rig: DrivenRig, scenario: Scenario, plan: CentringPlan) -> None:
        card = rig.devices.card
        missing = [name for name in FORCES if name not in rig.names]
        if missing:
            allowed = "both contact forces, by which a beam is centred"
            raise ConfigurationError(
                card.address, [Problem("daq_card.channels", ", ".join(missing), allowed)]
            )
        if not isinstance(rig.motion, Shaker):
            raise ConfigurationError(scenario.name, [Problem("rig", scenario.rig, "a rig with a shaker")])
        self._rig, self.sample_rate = rig, rig.sample_rate
        least = replace(rig.motion.drive, frequency=plan.frequency, amplitude=plan.sine.least, offset=0.0)
        rig.motion = self._shaker = rig.motion.with_drive(least)
        self._rows = [rig.names.index(name) for name in FORCES]
        self._began = 0
        self._wanted_from: int | None = None
        self._heard_from: int | None = None
        self._heard: list[NDArray[np.float64]] = []
        self._flags = Flag.GOOD
        self.listened = (0, 0)
        """The samples of the record by which the last offset was judged."""

    def start(self) -> None:
        self._began = self._rig.start_record(round(_LONGEST_S * self.sample_rate))
        self._rig.start(soft=True)

    def shake(self, amplitude: float) -> None:
        self._rig.motion = self._shaker = self._shaker.shake(amplitude)

    def push(self, offset: float) -> None:
        self._rig.motion = self._shaker = self._shaker.push(offset)

    def wait(self, seconds: float) -> None:
        self._rig.watch.wait(seconds)

    def forces(self, seconds: float) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """The two contact forces of the next seconds; raises NoCentre where a sensor does not show them."""
        count, acquisition = round(seconds * self.sample_rate), self._rig.acquisition
        self._heard, self._heard_from, self._flags = [], None, Flag.GOOD
        self._wanted_from = acquisition.acquired
        self._rig.watch.until(acquisition, lambda: sum(each.shape[1] for each in self._heard) >= count)
        self._wanted_from = None
        if self._flags & BLIND:  # it would look as if no stop were touched, however far the beam is pushed
            raise NoCentre("a contact force is overloaded, open or not finite: see its sensor and cable")
        first = (self._heard_from or 0) - self._began
        self.listened = first, first + count
        upper, lower = np.concatenate(self._heard, axis=1)[:, :count]
        return upper, lower

    def take(self, reading: CardReading) -> None:
        """In the acquisition thread: keep the forces while they are wanted."""
        begin = self._wanted_from
        if begin is not None and reading.first_sample >= begin:
            if self._heard_from is None:
                self._heard_from = reading.first_sample
            for row in self._rows:
                self._flags |= reading.flags[row]
            self._heard.append(reading.values[self._rows])


class CentringRecord:
    """What the log of `rig` gets of a centring besides its samples.

    What is raised within stands in it as an event.
    """

    def __init__(self, rig: DrivenRig) -> None:
        self._rig = rig
        self._probes: list[dict[str, object]] = []

    def __enter__(self) -> CentringRecord:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None:
            return
        text = str(error) or "interrupted"
        if not isinstance(error, RattleError | KeyboardInterrupt):
            text = f"{type(error).__name__}: {error}"
        with suppress(RecorderFailed):  # what ended the search is raised, not that the log takes no more
            self._rig.logbook.tell("error", "centring.ended", text)
            self._rig.recorder.metadata(RECORD, {"offsets": json.dumps(self._probes)})

    def note(self, probe: Probe, first_sample: int, end_sample: int) -> None:
        """Note an offset; what it touched was read from these samples of the record."""
        where = {"first_sample": first_sample, "end_sample": end_sample}
        self._probes.append(dataclasses.asdict(probe) | where)
        text = f"{probe}, by samples {first_sample} to {end_sample}"
        self._rig.logbook.tell("info", "centring.offset", text)

    def found(self, middle: Middle, plan: CentringPlan) -> None:
        result = dataclasses.asdict(middle) | {
            "rest_offset_m": plan.rest_offset(middle),
            "sine_hz": plan.frequency,
        }
        offsets = {"offsets": json.dumps(self._probes), "result": json.dumps(result)}
        self._rig.recorder.metadata(RECORD, offsets)
        text = f"the middle is at {middle.offset:+.4f} N +- {middle.uncertainty:.4f} N"
        self._rig.logbook.tell("info", "centring.found", text)
