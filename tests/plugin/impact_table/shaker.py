"""The table's shaker as an instrument of a bench: a generator with its amplifier, bounded in newtons."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from daq.errors import Problem
from daq.quantity import Key, Quantity, Text
from drivers.scpi.generator import ScpiGenerator
from drivers.scpi.settings import GeneratorSettings
from rig.instruments import Actuator, Instrument

if TYPE_CHECKING:
    from rig.emulated_rig import EmulatedRig
    from rig.emulation import Emulated
    from rig.files.bench import Bench
    from rig.files.scenario import Scenario
    from rig.session.devices import Devices
    from sim_twin.twin import AnyTwin

TABLE = "table_shaker"


@dataclass(frozen=True, slots=True)
class ShakerSettings:
    """The table [table_shaker]: `gain` in N/V is what a volt makes at the table, `highest` N bounds it."""

    gain: Annotated[float, Quantity("N/V", 0.01, 100)]
    highest: Annotated[float, Quantity("N", 0, 200, above=True)]
    driver: Annotated[Literal["scpi_shaker"], Key()] = "scpi_shaker"
    resource: Annotated[str, Text("a VISA address", r"TCPIP.+::SOCKET|ASRL.+::INSTR")] = ""
    emulated: Annotated[bool, Key()] = False

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"resource": address}

    def at(self, address: str) -> ShakerSettings:
        return replace(self, resource=address)


class ShakerDriver(ScpiGenerator):
    """The generator of the shaker."""

    def __init__(self, settings: ShakerSettings) -> None:
        super().__init__(GeneratorSettings(settings.gain, settings.highest, resource=settings.resource))


def too_strong(scenario: Scenario, bench: Bench) -> Iterator[Problem]:
    settings: Any = bench.actuator
    if scenario.drive.peak > settings.highest:
        allowed = f"up to {settings.highest:g} N ({TABLE}.highest)"
        yield Problem("drive.amplitude", f"{scenario.drive.peak:g} N", allowed)


def hurried(scenario: Scenario) -> Iterator[Problem]:
    """Nothing comes too soon."""
    yield from ()


def emulated_rig(scenario: Scenario, bench: Bench, twin: AnyTwin, seed: int, run_seed: int) -> EmulatedRig:
    from daq.clock import SystemClock
    from drivers.protocols.generator import DriveSettings
    from drivers.scpi.emulator.process import start_function_generator
    from rig.emulated_rig import EmulatedRig
    from rig.twin.plant import ShakenPlant, compiled

    settings: Any = bench.actuator
    plant = partial(compiled, ShakenPlant, twin, settings.gain, seed, run_seed, bench.emulation.healthy)
    drive, gain = scenario.drive, settings.gain
    # what a rig beside a real shaker, which it cannot hear, is driven by
    output = DriveSettings(
        True, drive.frequency, drive.amplitude / gain, drive.offset / gain, SystemClock().monotonic_s()
    )
    return EmulatedRig(plant, lambda sinks: start_function_generator(next(iter(sinks), None)), output)


def devices(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    from rig.app import card_of
    from rig.session.devices import Devices
    from rig.session.drive import Shaker

    settings: Any = emulated.reached(TABLE, bench.actuator)
    driver = ShakerDriver(settings)
    return Devices(
        driver,
        partial(ShakerDriver, settings),
        lambda wait, _: Shaker(driver, scenario.drive, settings.gain, wait),
        card_of(scenario, bench, emulated),
    )


_HERE = "impact_table.shaker"
INSTRUMENT = Instrument(
    "shaker",
    f"{_HERE}:ShakerSettings",
    {"scpi_shaker": f"{_HERE}:ShakerDriver"},
    Actuator(
        "highest",
        "N",
        f"{_HERE}:too_strong",
        f"{_HERE}:hurried",
        f"{_HERE}:emulated_rig",
        f"{_HERE}:devices",
    ),
)
