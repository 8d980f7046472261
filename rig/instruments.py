"""The instruments that a bench may have, by their tables in a bench file: a line each in the one table, or an
entry point of another package in the group `rattle.instruments`.

What stands elsewhere is named by its place (module:name) and imported when it is used: reading a bench file
needs no driver, and driving real instruments no emulator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from pkgutil import resolve_name
from typing import Any, Final

from daq.plugins import OpenTable


@dataclass(frozen=True, slots=True)
class Actuator:
    """What is asked of an instrument that moves the rig.

    It gives the `drive` of a scenario (module:class) to any rig that has such a one; without it, to the rigs
    that name it. A bench bounds it by the setting `highest`, of which the operator sees `per_si` times as
    many `unit`. One that is set `by_hand` is asked to stop, and cannot be made to.
    `beyond(scenario, bench)` yields what is more than a bench allows, `hurried(scenario)` what comes too soon
    on any. `rig(scenario, bench, twin, seed, run_seed)` is the emulated rig that it moves,
    `devices(scenario, bench, emulated)` are the devices of a run.
    """

    highest: str
    unit: str
    beyond: str
    hurried: str
    rig: str
    devices: str
    per_si: float = 1.0
    drive: str = ""
    by_hand: bool = False


@dataclass(frozen=True, slots=True)
class Instrument:
    """One table of a bench; `word` names the instrument for people.

    `settings` is the class that the table is read into, by `reader(table, key, faults)` where there is more
    to it than its keys; `left_open` is what the table of an emulated one may leave open. `drivers` make a
    device of the settings, by the key `driver`. Where it shows what the rig does,
    `emulator(bench, rig, seed, heard)` starts an emulated one. `logs`: its driver is a
    `drivers.protocols.instrument.Logger`, which any rig's bench may have beside the card.
    """

    word: str
    settings: str
    drivers: Mapping[str, str]
    actuator: Actuator | None = None
    emulator: str = ""
    reader: str = ""
    left_open: Mapping[str, Any] = field(default_factory=dict)
    logs: bool = False

    def driver_of(self, settings: Any) -> Any:
        return resolve_name(self.drivers[settings.driver])


_SINE: Final = "sim_twin.rigs.impact_beam.model:SineDrive"
_SPEED: Final = "sim_twin.rigs.crank_drive:SpeedDrive"
_MANUAL: Final = {"manual": "drivers.manual.actuator:ManualActuator"}
_OWN: Final = {
    "signal_generator": Instrument(
        "generator",
        "drivers.scpi.settings:GeneratorSettings",
        {"scpi_33220a": "drivers.scpi.generator:ScpiGenerator"},
        Actuator(
            "maximum_amplitude",
            "N",
            "rig.files.pairing:too_strong",
            "rig.files.pairing:no_soft_start",
            "rig.emulated_rig:shaken",
            "rig.app:shaken",
            drive=_SINE,
        ),
    ),
    "inverter": Instrument(
        "inverter",
        "drivers.mitsubishi_fr.settings:InverterSettings",
        {"mitsubishi_fr": "drivers.mitsubishi_fr.inverter:FrInverter"},
        Actuator(
            "maximum_speed",
            "rpm",
            "rig.files.pairing:too_fast",
            "rig.files.pairing:no_ramp",
            "rig.emulated_rig:turned",
            "rig.app:turned",
            30 / pi,
            _SPEED,
        ),
    ),
    "dc_supply": Instrument(
        "DC supply",
        "drivers.scpi.supply_settings:SupplySettings",
        {"scpi_n6900": "drivers.scpi.supply:ScpiSupply"},
        Actuator(
            "maximum_speed",
            "rpm",
            "rig.files.pairing:too_fast",
            "rig.files.pairing:no_ramp",
            "rig.emulated_rig:supplied",
            "rig.app:supplied",
            30 / pi,
            _SPEED,
        ),
        left_open={"rpm_per_volt": 5.0, "maximum_speed": "350 rpm", "maximum_current": "3 A"},
    ),
    "manual_shaker": Instrument(
        "drive set by hand",
        "drivers.manual.settings:ManualShakerSettings",
        _MANUAL,
        Actuator(
            "maximum_amplitude",
            "N",
            "rig.files.pairing:unseen_or_too_strong",
            "rig.files.pairing:no_time_for_hands",
            "rig.emulated_rig:shaken_by_hand",
            "rig.app:shaken_by_hand",
            drive=_SINE,
            by_hand=True,
        ),
        left_open={"maximum_amplitude": "60 N"},
    ),
    "manual_motor": Instrument(
        "motor set by hand",
        "drivers.manual.settings:ManualMotorSettings",
        _MANUAL,
        Actuator(
            "maximum_speed",
            "rpm",
            "rig.files.pairing:too_fast",
            "rig.files.pairing:no_ramp",
            "rig.emulated_rig:turned_by_hand",
            "rig.app:turned_by_hand",
            30 / pi,
            _SPEED,
            by_hand=True,
        ),
        left_open={"maximum_speed": "350 rpm"},
    ),
    "daq_card": Instrument(
        "card",
        "drivers.ni_daq.channels:CardSettings",
        {"nidaqmx": "drivers.ni_daq.card:NiDaqCard"},
        emulator="rig.emulation:card",
        reader="rig.files.instrument_tables:read_card",
    ),
    "encoder": Instrument(
        "encoder",
        "drivers.canopen_cia406.settings:EncoderSettings",
        {"canopen_cia406": "drivers.canopen_cia406.encoder:CanopenEncoder"},
        emulator="rig.emulation:encoder",
        reader="rig.files.instrument_tables:read_encoder",
        left_open={"interface": "socketcand", "channel": "can0", "node": 7},
    ),
}
INSTRUMENTS: Final = OpenTable(_OWN, "rattle.instruments", Instrument)


def actuator_of(table: str) -> Actuator:
    """What is asked of the instrument of a table that moves a rig; LookupError for any other instrument."""
    asked = INSTRUMENTS[table].actuator
    if asked is None:
        raise LookupError(f"[{table}] moves no rig")
    return asked
