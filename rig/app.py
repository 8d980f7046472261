"""The devices of a run, and what its log says of the chains behind the sensors."""

from __future__ import annotations

import json
from collections import Counter
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pkgutil import resolve_name

from daq.errors import ConfigurationError, Problem
from drivers.lock import Latch
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.protocols.card import AcquisitionCard
from drivers.scpi.settings import GeneratorSettings
from rig.emulation import NOTHING_EMULATED, STARTING, Emulated, emulated_bench, first_start
from rig.files.bench import Bench
from rig.files.scenario import Scenario
from rig.instruments import INSTRUMENTS, actuator_of
from rig.rigs import RIGS
from rig.session.devices import Devices
from rig.session.pace import Work
from rig.session.progress import Screen


def connect(
    scenario: Scenario, bench: Bench, stack: ExitStack, screen: Screen
) -> tuple[Devices, dict[str, str]]:
    """Start what the bench emulates, make its devices (not opened yet), and note what is emulated."""
    emulated, notes = NOTHING_EMULATED, chain_record(bench)
    if bench.emulated:
        with screen.busy(STARTING, Work(f"start {scenario.rig}"), first_start(bench)):
            emulated = stack.enter_context(emulated_bench(scenario, bench))
        notes["emulated"] = " ".join(INSTRUMENTS[table].word for table in bench.emulated)
        notes["emulation_seed"] = str(emulated.seed)
        if emulated.drive_follows_scenario:
            deaf = " and ".join(INSTRUMENTS[table].word for table in bench.emulated)
            real = INSTRUMENTS[RIGS[bench.rig].actuator].word
            screen.warn(f"the emulated {deaf} cannot hear the real {real}: it plays the scenario's drive")
    devices: Devices = resolve_name(actuator_of(RIGS[bench.rig].actuator).devices)(scenario, bench, emulated)
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
    make_generator = partial(INSTRUMENTS["signal_generator"].driver_of(settings), settings)
    driver, off_s = make_generator(), settings.longest_off_s
    return Devices(
        driver,
        partial(make_generator, off_first=True),
        lambda wait, _: Shaker(driver, scenario.drive, generator.force_per_volt, wait, longest_stop_s=off_s),
        card_of(scenario, bench, emulated),
    )


def turned(scenario: Scenario, bench: Bench, emulated: Emulated) -> Devices:
    """The devices of a rig whose crank an inverter turns."""
    from rig.session.motor import Motor, MotorActuator

    settings = emulated.reached("inverter", bench.the(InverterSettings))
    encoder = None if bench.encoder is None else emulated.reached("encoder", bench.encoder)
    drive = INSTRUMENTS["inverter"].driver_of(settings)(settings)
    return Devices(
        MotorActuator(drive),
        None,
        lambda wait, measured_rpm: Motor(drive, scenario.drive.speed, wait, measured_rpm),
        card_of(scenario, bench, emulated),
        None if encoder is None else INSTRUMENTS["encoder"].driver_of(encoder)(encoder),
        emergency_stop=lambda: drive.emergency_stop if settings.stop_line else None,
    )


def card_of(scenario: Scenario, bench: Bench, emulated: Emulated) -> AcquisitionCard:
    """The driver of the card of a bench, emulated or not, for a scenario's rate; not opened yet."""
    settings = emulated.reached("daq_card", bench.daq_card)
    settings = replace(settings, sample_rate_hz=scenario.acquisition.sample_rate)
    driver: AcquisitionCard = INSTRUMENTS["daq_card"].driver_of(settings)(settings)
    return driver


def chain_record(bench: Bench) -> dict[str, str]:
    """What the log's `run` record keeps of chains with stages of their own, and of counters; JSON in SI."""
    record: dict[str, str] = {}
    for channel in bench.daq_card.channels:
        amplifier, low_pass, pulses = channel.amplifier, channel.anti_alias, channel.pulses
        if not (amplifier or low_pass or channel.counted):
            continue
        chain: dict[str, object] = {
            "physical": channel.physical,
            "kind": channel.kind,
            "serial": channel.serial,
            "calibrated": channel.calibrated and channel.calibrated.isoformat(),
            "amplifier": amplifier
            and {
                "serial": amplifier.serial,
                "gain_v_per_c": channel.gain,
                "corner_hz": amplifier.corner_hz,
                "output_v": amplifier.output_v,
                "state": amplifier.state,
            },
            "filter": low_pass
            and {"serial": low_pass.serial, "corner_hz": low_pass.corner_hz, "order": low_pass.order},
            "pulses": pulses
            and {
                "per_revolution": pulses.per_revolution,
                "decoding": pulses.decoding,
                "index": pulses.index,
                "initial_angle_rad": pulses.initial_angle,
            },
        }
        stated = {key: value for key, value in chain.items() if value}
        record[f"chain.{channel.name}"] = json.dumps(stated, sort_keys=True)
    return record
