"""The one place that names concrete devices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pkgutil import resolve_name
from typing import Final

from drivers.canopen_cia406.settings import EncoderSettings
from drivers.ni_daq.channels import CardSettings
from drivers.protocols.card import AcquisitionCard
from drivers.protocols.encoder import PositionEncoder
from rig.card_wiring import card_channel, chain_record
from rig.emulation import NOTHING_EMULATED, Emulated, EmulatedBench, starting
from rig.files.bench import Bench
from rig.files.rigs import RIGS
from rig.files.scenario import Scenario
from rig.session.devices import Devices
from rig.session.progress import Screen

# Drivers by name: a rig has one actuator, and a bus or a card that is not there need not be loaded.
GENERATORS: Final = {"scpi_33220a": "drivers.scpi.generator:ScpiGenerator"}
INVERTERS: Final = {"mitsubishi_fr": "drivers.mitsubishi_fr.inverter:FrInverter"}
CARDS: Final = {"nidaqmx": "drivers.ni_daq.card:NiDaqCard"}
ENCODERS: Final = {"canopen_cia406": "drivers.canopen_cia406.encoder:CanopenEncoder"}
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
    from drivers.scpi.generator import GeneratorSettings
    from rig.session.drive import Shaker

    generator = bench.signal_generator
    resource = emulated.address("signal_generator", generator.resource)
    make_generator = partial(
        resolve_name(GENERATORS[generator.driver]),
        GeneratorSettings(str(resource), generator.maximum_amplitude / generator.force_per_volt),
    )
    driver = make_generator()
    return Devices(
        driver,
        make_generator,
        lambda wait, _: Shaker(driver, scenario.drive, generator.force_per_volt, wait),
        _card(scenario, bench, emulated),
    )


def _turned(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    from rig.session.motor import Motor, MotorActuator
    from rig.shaft_wiring import inverter_settings

    inverter = bench.inverter
    port = emulated.address("inverter", inverter.port)
    drive = resolve_name(INVERTERS[inverter.driver])(inverter_settings(inverter, port))
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
    make: Callable[[CardSettings], AcquisitionCard] = resolve_name(CARDS[card.driver])
    return make(CardSettings(grpc, scenario.acquisition.sample_rate, card.buffer, channels))


def _encoder(bench: Bench, emulated: Emulated) -> PositionEncoder | None:
    if bench.encoder is None:
        return None
    from rig.shaft_wiring import encoder_settings

    make: Callable[[EncoderSettings], PositionEncoder] = resolve_name(ENCODERS[bench.encoder.driver])
    return make(encoder_settings(bench.encoder, emulated.address("encoder")))
