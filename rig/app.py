"""The devices of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pkgutil import resolve_name
from typing import TYPE_CHECKING

from daq.errors import ConfigurationError, Problem
from drivers.lock import Latch
from drivers.manual.settings import ManualMotorSettings, ManualSettings
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.protocols.card import AcquisitionCard
from drivers.protocols.encoder import PositionEncoder
from drivers.protocols.instrument import by_number
from drivers.scpi.language import takes_several
from drivers.scpi.settings import GeneratorSettings
from drivers.scpi.supply_settings import SupplySettings
from rig.emulation import NOTHING_EMULATED, STARTING, Emulated, emulated_bench, first_start
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.instruments import INSTRUMENTS, actuator_of
from rig.session.devices import Devices
from rig.session.pace import Work
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.session.by_hand import ShaftSeen
    from rig.session.monitor import Instruments


def connect(
    scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen
) -> tuple[Devices, dict[str, str]]:
    """Start what the bench emulates, make its devices (not opened yet), and note what is emulated."""
    emulated, notes = NOTHING_EMULATED, dict[str, str]()
    if bench.emulated:
        with screen.busy(STARTING, Work(f"start {scenario.rig}"), first_start(bench)):
            emulated = stack.enter_context(emulated_bench(scenario, bench))
        notes["emulated"] = " ".join(INSTRUMENTS[table].word for table in bench.emulated)
        notes["emulation_seed"] = str(emulated.seed)
        if emulated.drive_follows_scenario:
            deaf = " and ".join(INSTRUMENTS[table].word for table in bench.emulated)
            real = INSTRUMENTS[bench.actuator_table].word
            screen.warn(f"the emulated {deaf} cannot hear the real {real}: it plays the scenario's drive")
    devices: Devices = resolve_name(actuator_of(bench.actuator_table).devices)(scenario, bench, emulated)
    logging = {name: emulated.reached(name, bench.instruments[name]) for name in bench.loggers}
    loggers = {name: INSTRUMENTS[name].driver_of(each)(each) for name, each in logging.items()}
    card = emulated.reached("daq_card", bench.daq_card)
    if card.stop_line is not None:
        from drivers.ni_daq.stop_line import CardLine

        devices = replace(devices, line=partial(CardLine, card))
    moves = devices.actuator
    latch = None if bench.actuator.emulated else Latch(moves.name, moves.address)
    devices = replace(devices, loggers=loggers, latch=latch)
    check_names(devices, bench.source)
    return devices, notes


def sensing(scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen) -> Instruments:
    """What measures on a bench, of which what is emulated hears an actuator that nobody switches on.

    The driver of the bench's own actuator is not even made.
    """
    from rig.session.monitor import Instruments

    emulated = NOTHING_EMULATED
    if any(INSTRUMENTS[table].emulator for table in bench.emulated):
        idle = {bench.actuator_table: replace(bench.actuator, emulated=True)}
        with screen.busy(STARTING, Work(f"start {scenario.rig}"), first_start(bench)):
            beside = replace(bench, instruments={**bench.instruments, **idle})
            emulated = stack.enter_context(emulated_bench(scenario, beside))
    logging = {name: emulated.reached(name, bench.instruments[name]) for name in bench.loggers}
    loggers = {name: INSTRUMENTS[name].driver_of(each)(each) for name, each in logging.items()}
    return Instruments(card_of(scenario, bench, emulated), encoder_of(bench, emulated), loggers)


def check_names(devices: Devices, source: str) -> None:
    """Raise ConfigurationError where two instruments record one name."""
    names = Counter(channel.name for channel in (*devices.card.channels, *devices.logged))
    if twice := [Problem(name, "(twice)", "a name of its own") for name in names if names[name] > 1]:
        raise ConfigurationError(source, twice)


def shaken(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig that a generator moves."""
    from rig.session.drive import Shaker

    generator = bench.the(GeneratorSettings)
    settings = emulated.reached("signal_generator", generator)
    make_generator = INSTRUMENTS["signal_generator"].driver_of(settings)
    driver, off_s = make_generator(settings), settings.longest_off_s
    return Devices(
        driver,
        partial(make_generator, settings.at(by_number(settings.resource)), off_first=True),
        lambda wait, _: Shaker(driver, scenario.drive, generator.force_per_volt, wait, longest_stop_s=off_s),
        card_of(scenario, bench, emulated),
        spare_beside=takes_several(settings.resource),
    )


def turned(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig whose crank an inverter turns."""
    from rig.session.motor import Motor, MotorActuator

    settings = emulated.reached("inverter", bench.the(InverterSettings))
    drive = INSTRUMENTS["inverter"].driver_of(settings)(settings)
    return Devices(
        MotorActuator(drive),
        None,
        lambda wait, measured_rpm: Motor(drive, scenario.drive.speed, wait, measured_rpm),
        card_of(scenario, bench, emulated),
        encoder_of(bench, emulated),
        emergency_stop=lambda: drive.emergency_stop if settings.stop_line else None,
    )


def supplied(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig whose crank a motor on a DC supply turns."""
    from rig.session.motor import Motor

    settings = emulated.reached("dc_supply", bench.the(SupplySettings))
    make_supply = INSTRUMENTS["dc_supply"].driver_of(settings)
    supply = make_supply(settings)
    return Devices(
        supply,
        partial(make_supply, settings.at(by_number(settings.resource)), off_first=True),
        lambda wait, measured_rpm: Motor(supply, scenario.drive.speed, wait, measured_rpm, proves=True),
        card_of(scenario, bench, emulated),
        encoder_of(bench, emulated),
        spare_beside=takes_several(settings.resource),
    )


def shaken_by_hand(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig whose shaker a person sets; what shows that is known once it is recorded."""
    return _by_hand(scenario, bench, emulated, lambda measured_rpm: None)


def turned_by_hand(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig whose crank a person turns."""
    from rig.session.by_hand import ShaftSeen

    highest_rpm = bench.the(ManualMotorSettings).maximum_speed_rpm
    return _by_hand(scenario, bench, emulated, lambda measured_rpm: ShaftSeen(measured_rpm, highest_rpm))


def _by_hand(
    scenario: Scenario,
    bench: Bench,
    emulated: Emulated,
    seen: Callable[[Callable[[], float]], ShaftSeen | None],
) -> Devices:
    from rig.session.by_hand import ByHand

    settings = emulated.reached(bench.actuator_table, bench.the(ManualSettings))
    make_person = partial(INSTRUMENTS[bench.actuator_table].driver_of(settings), settings)
    person = make_person()
    return Devices(
        person,
        partial(make_person, off_first=True),
        lambda wait, measured_rpm: ByHand(person, scenario.drive, wait, seen(measured_rpm)),
        card_of(scenario, bench, emulated),
        encoder_of(bench, emulated),
    )


def encoder_of(bench: Bench, emulated: Emulated) -> PositionEncoder | None:
    """The encoder of a bench that has one."""
    if bench.encoder is None:
        return None
    settings = emulated.reached("encoder", bench.encoder)
    encoder: PositionEncoder = INSTRUMENTS["encoder"].driver_of(settings)(settings)
    return encoder


def card_of(scenario: Scenario, bench: Bench, emulated: Emulated) -> AcquisitionCard:
    """The driver of the card of a bench, emulated or not, for a scenario's rate; not opened yet."""
    settings = emulated.reached("daq_card", bench.daq_card)
    settings = replace(settings, sample_rate_hz=scenario.acquisition.sample_rate)
    driver: AcquisitionCard = INSTRUMENTS["daq_card"].driver_of(settings)(settings)
    return driver
