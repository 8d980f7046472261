"""The channels of the card in a bench file: which sensor, on which input, with which chain behind it."""

from __future__ import annotations

import dataclasses
import datetime
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic.dataclasses import dataclass

from rig.files.faults import Faults, dotted
from rig.files.fields import Day, FieldError, Measured, Raw, Text, Word
from rig.files.rigs import channel_names, unit_of
from rig.files.section import SECTION, Check, read_section, sound_values
from rig.files.sensing import (
    GAIN,
    HIGHEST_FULL_SCALE_V,
    LATER_KINDS,
    LOWEST_FULL_SCALE_V,
    RANGES,
    SENSOR_KINDS,
)

_INPUT = Text('an input of the card, such as "cDAQ1Mod1/ai0"', r"[A-Za-z0-9_.-]+/(?i:ai)\d{1,3}")
Kind = Literal["voltage", "charge_amplifier", "force_iepe", "acceleration_iepe"]


@dataclass(frozen=True, slots=True, config=SECTION)
class _ChannelSection:
    name: Annotated[str, Text("a channel of the rig", r"[a-z0-9_.]+")]
    physical: Annotated[str, _INPUT]
    kind: Annotated[Kind, Word(tuple(SENSOR_KINDS), LATER_KINDS)]
    sensitivity: Annotated[str | float, Raw('a sensitivity, such as "100 mV/N"')]
    range: Annotated[str | float, Raw('the full scale, such as "100 N"')]
    gain: Annotated[float | None, GAIN] = None
    serial: Annotated[str, Text("the sensor's serial number")] = ""
    calibrated: Annotated[datetime.date | None, Day()] = None
    valid_until: Annotated[datetime.date | None, Day()] = None


@dataclasses.dataclass(frozen=True, slots=True)
class BenchChannel:
    """One analog input in SI.

    `sensitivity` is in V per `unit`, or C per `unit` for a charge amplifier, whose `gain` is in V/C (None for
    the others); `range` is the full scale in `unit`, to either side.
    """

    name: str
    unit: str
    physical: str
    kind: Kind
    sensitivity: float
    gain: float | None
    range: float
    serial: str
    calibrated: datetime.date | None
    valid_until: datetime.date | None

    @property
    def volts_per_unit(self) -> float:
        """What the card sees for one `unit`, in V."""
        return self.sensitivity * (1.0 if self.gain is None else self.gain)

    @property
    def full_scale_v(self) -> float:
        """What the card sees at full scale, in V."""
        return self.range * self.volts_per_unit


def read_channels(tables: object, key: str, faults: Faults) -> tuple[BenchChannel, ...]:
    """Return the channels that are sound and note every fault of the others."""
    if not isinstance(tables, list) or not tables:
        faults.add(key, tables, f"at least one table [[{key}]]")
        return ()
    _note_twice(tables, key, "name", faults)
    _note_twice(tables, key, "physical", faults)
    read = (_channel(table, _key_of(table, index, key), faults) for index, table in enumerate(tables))
    return tuple(channel for channel in read if channel is not None)


def _key_of(table: Any, index: int, key: str) -> str:
    """`daq_card.channels."yoke.force"`, or the table's number (from 1) where it has no name."""
    name = table.get("name") if isinstance(table, dict) else None
    return dotted(key, name) if isinstance(name, str) and name else f"{key}[{index + 1}]"


def _note_twice(tables: list[Any], key: str, field: str, faults: Faults) -> None:
    given = [str(table[field]) for table in tables if isinstance(table, dict) and field in table]
    # NI's names do not tell upper from lower case
    for value, count in Counter(value.lower() for value in given).items():
        if count > 1:
            shown = next(name for name in given if name.lower() == value)
            faults.add(f"{key}.{field}", shown, f"each {field} once ({count} channels have it)")


def _channel(table: object, key: str, faults: Faults) -> BenchChannel | None:
    section = read_section(_ChannelSection, table, key, faults, _CHECKS)
    name = sound_values(_ChannelSection, table).get("name")
    unit = None if name is None else unit_of(name)
    if name is not None and unit is None:
        faults.unknown(f"{key}.name", name, name, channel_names())
    return None if section is None or unit is None else _in_si(section, unit, key, faults)


def _measures_unit(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    unit = unit_of(channel["name"])
    if unit is not None and unit not in SENSOR_KINDS[channel["kind"]].units:
        yield "kind", f"a kind that measures {unit}"


def _has_gain(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    charge = SENSOR_KINDS[channel["kind"]].output == "C"
    if charge and channel["gain"] is None:
        yield "gain", f"the charge amplifier's gain, {GAIN.allowed}"
    if not charge and channel["gain"] is not None:
        yield "gain", "none: only a charge_amplifier has a gain"


def _calibrated_before(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    first, last = channel["calibrated"], channel["valid_until"]
    if first and last and first >= last:
        yield "valid_until", f"a day after calibrated, {first}"


_CHECKS = (
    Check(("name", "kind"), _measures_unit),
    Check(("kind", "gain"), _has_gain),
    Check(("calibrated", "valid_until"), _calibrated_before),
)


def _in_si(section: _ChannelSection, unit: str, key: str, faults: Faults) -> BenchChannel | None:
    sensor = SENSOR_KINDS[section.kind]
    sensitivity = _quantity(sensor.sensitivity(unit), section.sensitivity, f"{key}.sensitivity", faults)
    full_scale = _quantity(RANGES[unit], section.range, f"{key}.range", faults)
    if sensitivity is None or full_scale is None:
        return None
    channel = BenchChannel(
        section.name,
        unit,
        section.physical,
        section.kind,
        sensitivity,
        section.gain,
        full_scale,
        section.serial,
        section.calibrated,
        section.valid_until,
    )
    if not LOWEST_FULL_SCALE_V <= channel.full_scale_v <= HIGHEST_FULL_SCALE_V * (1 + 1e-9):
        faults.add(f"{key}.sensitivity", section.sensitivity, _arithmetic(channel))
        return None
    return channel


def _quantity(field: Measured, value: str | float, key: str, faults: Faults) -> float | None:
    try:
        return field.read(value)
    except FieldError as error:
        faults.add(key, value, str(error))
        return None


def _arithmetic(channel: BenchChannel) -> str:
    """Why a full scale is refused: a sensitivity in mV where the sensor gives V is a thousand times off."""
    return (
        "a full scale of 1 mV to 10 V at the card, but range x sensitivity ="
        f" {channel.range:g} {channel.unit} x {channel.volts_per_unit:g} V per {channel.unit}"
        f" = {channel.full_scale_v:g} V; check both units"
    )
