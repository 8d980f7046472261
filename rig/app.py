"""The devices of a run."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial

from drivers.ni_daq.channels import CardSettings
from drivers.protocols.card import AcquisitionCard
from drivers.protocols.encoder import PositionEncoder
from rig.card_wiring import chain_record
from rig.emulation import NOTHING_EMULATED, Emulated, EmulatedBench, starting
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.instruments import INSTRUMENTS, actuator_of
from rig.loaded_table import loaded
from rig.rigs import RIGS
from rig.session.devices import Devices
from rig.session.progress import Screen


def connect(
    scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen
) -> tuple[Devices, dict[str, str]]:
    """Start what the bench emulates, make its devices (not opened yet), and note what is emulated."""
    emulated, notes = NOTHING_EMULATED, chain_record(bench)
    if bench.emulated:
        with screen.busy(starting(bench)):
            emulated = stack.enter_context(EmulatedBench(scenario, bench))
        notes["emulated"] = " ".join(INSTRUMENTS[table].word for table in bench.emulated)
        notes["emulation_seed"] = str(emulated.seed)
        if emulated.drive_follows_scenario:
            deaf = " and ".join(INSTRUMENTS[table].word for table in bench.emulated)
            real = INSTRUMENTS[RIGS[bench.rig].actuator].word
            screen.warn(f"the emulated {deaf} cannot hear the real {real}: it plays the scenario's drive")
    devices = loaded(actuator_of(RIGS[bench.rig].actuator).devices)
    return devices(scenario, bench, emulated), notes


def shaken(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig that a generator moves."""
    from rig.session.drive import Shaker

    generator = bench.signal_generator
    settings = emulated.reached("signal_generator", generator)
    make_generator = partial(INSTRUMENTS["signal_generator"].driver_of(settings), settings)
    driver = make_generator()
    return Devices(
        driver,
        make_generator,
        lambda wait, _: Shaker(driver, scenario.drive, generator.force_per_volt, wait),
        card_of(scenario, bench, emulated),
    )


def turned(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig whose crank an inverter turns."""
    from rig.session.motor import Motor, MotorActuator

    settings = emulated.reached("inverter", bench.inverter)
    drive = INSTRUMENTS["inverter"].driver_of(settings)(settings)
    return Devices(
        MotorActuator(drive),
        None,
        lambda wait, measured_rpm: Motor(drive, scenario.drive.speed, wait, measured_rpm),
        card_of(scenario, bench, emulated),
        _encoder(bench, emulated),
    )


def card_of(scenario: Scenario, bench: Bench, emulated: Emulated) -> AcquisitionCard:
    """The driver of the card of a bench, emulated or not, for a scenario's rate; not opened yet."""
    card = bench.daq_card
    grpc = emulated.address("daq_card", card.grpc)
    settings = CardSettings(grpc, scenario.acquisition.sample_rate, card.buffer, card.channels)
    driver: AcquisitionCard = INSTRUMENTS["daq_card"].driver_of(card)(settings)
    return driver


def _encoder(bench: Bench, emulated: Emulated) -> PositionEncoder | None:
    if bench.encoder is None:
        return None
    settings = emulated.reached("encoder", bench.encoder)
    driver: PositionEncoder = INSTRUMENTS["encoder"].driver_of(settings)(settings)
    return driver
