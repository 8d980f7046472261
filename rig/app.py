"""The `rattle` command, and the one place that names concrete devices."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial

from drivers.ni_daq import CardSettings, NiDaqCard
from drivers.scpi import GeneratorSettings, ScpiGenerator
from rig.card_wiring import card_channel, chain_record
from rig.commands.cli import build
from rig.emulation import EmulatedBench
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.session.devices import Devices
from rig.session.drive import Shaker
from rig.session.progress import Screen

GENERATORS = {"scpi_33220a": ScpiGenerator}
CARDS = {"nidaqmx": NiDaqCard}


def connect(
    scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen
) -> tuple[Devices, dict[str, str]]:
    """Start what the bench emulates, make its devices (not opened yet), and note what is emulated."""
    generator, card = bench.signal_generator, bench.daq_card
    resource, grpc, notes = generator.resource, card.grpc, chain_record(bench)
    if generator.emulated or card.emulated:
        with screen.busy("starting the emulated instruments"):
            emulated = stack.enter_context(EmulatedBench(scenario, bench))
        resource = emulated.generator.address if emulated.generator else resource
        grpc = emulated.card.address if emulated.card else grpc
        notes["emulated"] = "generator " * generator.emulated + "card" * card.emulated
        notes["emulation_seed"] = str(emulated.seed)
        if emulated.drive_follows_scenario:
            screen.warn("the emulated card cannot hear the real generator: it plays the scenario's drive")
    make_generator = partial(
        GENERATORS[generator.driver],
        GeneratorSettings(str(resource), generator.maximum_amplitude / generator.force_per_volt),
    )
    driver = make_generator()
    return (
        Devices(
            driver,
            make_generator,
            lambda wait: Shaker(driver, scenario.drive, generator.force_per_volt, wait),
            CARDS[card.driver](_card_settings(scenario, bench, grpc)),
        ),
        notes,
    )


def _card_settings(scenario: Scenario, bench: Bench, grpc: str | None) -> CardSettings:
    channels = tuple(card_channel(channel) for channel in bench.daq_card.channels)
    return CardSettings(grpc, scenario.acquisition.sample_rate, bench.daq_card.buffer, channels)


def main() -> None:
    """Run the command line."""
    build(connect)()
