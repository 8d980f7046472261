"""The `rattle` command, and the one place that names concrete devices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from typing import Final

from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.mitsubishi_fr.inverter import FrInverter
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.channels import CardSettings
from drivers.protocols.card import AcquisitionCard
from drivers.protocols.encoder import PositionEncoder
from drivers.scpi.generator import ScpiGenerator
from rig.card_wiring import card_channel, chain_record
from rig.commands.cli import build
from rig.emulation import NOTHING_EMULATED, Emulated, EmulatedBench, starting
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.rigs import RIGS
from rig.session.devices import Devices
from rig.session.drive import Shaker
from rig.session.motor import Motor, MotorActuator
from rig.session.progress import Screen

GENERATORS = {"scpi_33220a": ScpiGenerator}
INVERTERS = {"mitsubishi_fr": FrInverter}
CARDS = {"nidaqmx": NiDaqCard}
ENCODERS = {"canopen_cia406": CanopenEncoder}
_WORDS: Final = {
    "signal_generator": "generator",
    "inverter": "inverter",
    "daq_card": "card",
    "encoder": "encoder",
}


def connect(
    scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen
) -> tuple[Devices, dict[str, str]]:
    """Start what the bench emulates, make its devices (not opened yet), and note what is emulated."""
    emulated, notes = NOTHING_EMULATED, chain_record(bench)
    if bench.emulated:
        with screen.busy(starting(bench)):
            emulated = stack.enter_context(EmulatedBench(scenario, bench))
        notes["emulated"] = " ".join(_WORDS[table] for table in bench.emulated)
        notes["emulation_seed"] = str(emulated.seed)
        if emulated.drive_follows_scenario:
            deaf = " and ".join(_WORDS[table] for table in bench.emulated)
            real = _WORDS[RIGS[bench.rig].actuator]
            screen.warn(f"the emulated {deaf} cannot hear the real {real}: it plays the scenario's drive")
    return _DEVICES[RIGS[bench.rig].actuator](scenario, bench, emulated), notes


def _shaken(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    generator = bench.signal_generator
    make_generator = partial(GENERATORS[generator.driver], emulated.reached("signal_generator", generator))
    driver = make_generator()
    return Devices(
        driver,
        make_generator,
        lambda wait, _: Shaker(driver, scenario.drive, generator.force_per_volt, wait),
        _card(scenario, bench, emulated),
    )


def _turned(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    inverter = bench.inverter
    drive = INVERTERS[inverter.driver](emulated.reached("inverter", inverter))
    return Devices(
        MotorActuator(drive),
        None,
        lambda wait, measured_rpm: Motor(drive, scenario.drive.speed, wait, measured_rpm),
        _card(scenario, bench, emulated),
        _encoder(bench, emulated),
    )


_DEVICES: Final[Mapping[str, Callable[[Scenario, Bench, Emulated], Devices]]] = {
    "signal_generator": _shaken,
    "inverter": _turned,
}
"""By actuator."""


def _card(scenario: Scenario, bench: Bench, emulated: Emulated) -> AcquisitionCard:
    card = bench.daq_card
    grpc = emulated.address("daq_card", card.grpc)
    channels = tuple(card_channel(channel) for channel in card.channels)
    settings = CardSettings(grpc, scenario.acquisition.sample_rate, card.buffer, channels)
    return CARDS[card.driver](settings)


def _encoder(bench: Bench, emulated: Emulated) -> PositionEncoder | None:
    if bench.encoder is None:
        return None
    return ENCODERS[bench.encoder.driver](emulated.reached("encoder", bench.encoder))


def main() -> None:
    """Run the command line."""
    build(connect)()
