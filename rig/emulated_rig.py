"""The rig behind the emulated instruments of a bench: plant, shaft, and what moves both."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Final

from daq.clock import SystemClock
from drivers.emulator_process import EmulatedInstrument, Fork
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.protocols.card import Plant
from drivers.protocols.generator import DriveSettings
from drivers.protocols.instrument import ActuatorOutput
from drivers.protocols.speed_drive import MotorOutput
from drivers.scpi.settings import GeneratorSettings
from drivers.scpi.supply_settings import SupplySettings
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.instruments import actuator_of
from rig.twin.chains import declared_by, mounted, with_chains
from rig.twin.scenario_twin import twin_of, with_effects
from sim_twin.sensors import Encoder
from sim_twin.twin import AnyTwin

if TYPE_CHECKING:
    from rig.twin.shaft import EmulatedMotor


RAMP_S: Final = 1.5
"""From 0 to 60 Hz, of the emulated inverter."""


@dataclass(frozen=True, slots=True)
class EmulatedRig:
    """A rig that was drawn.

    `start_actuator(sinks)` starts what moves it, every change of which goes to all of `sinks`;
    `scenario_output` is what the rig's instruments hear where the actuator is a real one that they cannot
    hear. `motor` turns its shaft, where it has one.
    """

    plant: Callable[[], Plant[Any]]
    start_actuator: Callable[[Sequence[Connection]], EmulatedInstrument]
    scenario_output: ActuatorOutput
    motor: EmulatedMotor | None = None


_ANGLE: Final = 2**30
"""Counts of a revolution that nobody tells from the angle."""


def _counts_otherwise(sensor: Any, other: Any) -> bool:
    return isinstance(sensor, Encoder) and sensor != other


def drawn_rig(scenario: Scenario, bench: Bench, seed: int, run_seed: int) -> EmulatedRig:
    """The rig of a scenario as it really is: with the bench's effects, drawn by the seeds."""
    twin = twin_of(scenario, (channel.name for channel in bench.daq_card.channels))
    declared = declared_by(bench, scenario.acquisition.sample_rate)
    shown = with_chains(twin, declared).sensors
    # what its card makes of it, the card does: an encoder of other counts counts the angle itself
    angles = {
        name: Encoder(_ANGLE) for name, each in twin.sensors.items() if _counts_otherwise(each, shown[name])
    }
    twin = replace(mounted(twin, declared), sensors={**twin.sensors, **angles})
    if bench.emulation.effects is not None:
        twin = with_effects(twin, bench.emulation.effects)
    rig_of = resolve_name(actuator_of(bench.actuator_table).rig)
    rig: EmulatedRig = rig_of(scenario, bench, twin, seed, run_seed)
    return rig


def shaken(scenario: Scenario, bench: Bench, twin: AnyTwin, seed: int, run_seed: int) -> EmulatedRig:
    """A rig that a generator and its shaker move."""
    from drivers.scpi.emulator.process import spoilt, start_function_generator
    from rig.twin.plant import ShakenPlant, compiled, resting_at

    drive, per_volt = scenario.drive, bench.the(GeneratorSettings).force_per_volt
    if bench.emulation.rest_offset is not None:
        twin = resting_at(twin, bench.emulation.rest_offset, seed)
    output = DriveSettings(
        on=True,
        frequency_hz=drive.frequency,
        amplitude_v=drive.amplitude / per_volt,
        offset_v=drive.offset / per_volt,
        started_s=SystemClock().monotonic_s(),
    )
    plant = partial(compiled, ShakenPlant, twin, per_volt, seed, run_seed, bench.emulation.healthy)
    setup = spoilt(bench.emulation.rehearsed("signal_generator"))
    return EmulatedRig(plant, lambda sinks: start_function_generator(next(iter(sinks), None), setup), output)


def turned(scenario: Scenario, bench: Bench, twin: AnyTwin, seed: int, run_seed: int) -> EmulatedRig:
    """A rig whose crank an inverter turns."""
    from drivers.mitsubishi_fr.emulator.process import InverterWiring, matching_setup, start_inverter

    inverter = bench.the(InverterSettings)
    setup = matching_setup(inverter, RAMP_S, bench.emulation.rehearsed("inverter"))
    return _on_a_motor(
        twin,
        inverter.rpm_per_hz,
        lambda sinks: start_inverter(InverterWiring(Fork(tuple(sinks))), setup),
        (seed, run_seed, bench.emulation.healthy),
    )


def supplied(scenario: Scenario, bench: Bench, twin: AnyTwin, seed: int, run_seed: int) -> EmulatedRig:
    """A rig whose crank a motor on a DC supply turns."""
    from drivers.scpi.emulator.process import spoilt, start_dc_supply

    setup = spoilt(bench.emulation.rehearsed("dc_supply"))
    return _on_a_motor(
        twin,
        bench.the(SupplySettings).rpm_per_volt,
        lambda sinks: start_dc_supply(Fork(tuple(sinks)), setup),
        (seed, run_seed, bench.emulation.healthy),
    )


def shaken_by_hand(scenario: Scenario, bench: Bench, twin: AnyTwin, seed: int, run_seed: int) -> EmulatedRig:
    """A rig whose shaker an emulated person sets, in newtons."""
    from drivers.manual.emulator.person import shaken as sets
    from drivers.manual.emulator.person import start_person
    from rig.twin.plant import ShakenPlant, compiled

    drive = scenario.drive
    return EmulatedRig(
        partial(compiled, ShakenPlant, twin, 1.0, seed, run_seed, bench.emulation.healthy),
        lambda sinks: start_person(sets, Fork(tuple(sinks))),
        DriveSettings(True, drive.frequency, drive.amplitude, drive.offset, SystemClock().monotonic_s()),
    )


def turned_by_hand(scenario: Scenario, bench: Bench, twin: AnyTwin, seed: int, run_seed: int) -> EmulatedRig:
    """A rig whose crank an emulated person turns, in rad/s."""
    from drivers.manual.emulator.person import start_person, turned

    rpm_per_rad_s = 60.0 / math.tau
    draw = (seed, run_seed, bench.emulation.healthy)
    return _on_a_motor(twin, rpm_per_rad_s, lambda sinks: start_person(turned, Fork(tuple(sinks))), draw)


def _on_a_motor(
    twin: AnyTwin,
    rpm_per_level: float,
    start_actuator: Callable[[Sequence[Connection]], EmulatedInstrument],
    draw: tuple[int, int, bool],
) -> EmulatedRig:
    """A rig with a shaft: `rpm_per_level` of what turns it, in Hz or V, by the bench."""
    from rig.twin.plant import CrankPlant, compiled
    from rig.twin.shaft import drawn_motor

    motor = drawn_motor(rpm_per_level, twin.drive, *draw)
    level = twin.drive.speed * 60.0 / math.tau / rpm_per_level
    output = MotorOutput(True, level, level, 0.0, SystemClock().monotonic_s())
    return EmulatedRig(partial(compiled, CrankPlant, twin, motor, *draw), start_actuator, output, motor)
