"""The channels of the card in a bench file: which sensor, on which input, with which chain behind it."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from daq.quantity import Check, Key, Quantity, Text, Whole, settings_of
from rig.files.faults import Faults, dotted
from rig.files.sensing import (
    GAIN,
    HIGHEST_FULL_SCALE_V,
    INPUTS,
    LOWEST_FULL_SCALE_V,
    MEANINGS,
    RANGES,
    SENSINGS,
    Sensing,
    keys_of,
    owners,
    sort_of_input,
)
from rig.files.stages import AMPLIFIER_CHECKS, CALIBRATION, FILTER_CHECKS, AmplifierStage, FilterStage
from rig.files.table import FieldError, quantity_field, read_table, sound_values
from rig.rigs import channel_names, unit_of

_INPUT: Final = Text(
    f"an input of the card: {' or '.join(INPUTS.values())}", r"[A-Za-z0-9_.-]+/(?i:ai|_?ctr)\d{1,3}"
)
_DECODINGS: Final = {"x1": 1, "x2": 2, "x4": 4}
Kind = Literal[
    "voltage", "charge_amplifier", "force_iepe", "acceleration_iepe", "encoder", "marker", "tachometer"
]


@dataclass(frozen=True, slots=True)
class _ChannelSection:
    name: Annotated[str, Text("a channel of the rig", r"[a-z0-9_.]+")]
    physical: Annotated[str, _INPUT]
    kind: Annotated[Kind, Key()]
    sensitivity: Annotated[str | float | None, Text(MEANINGS["sensitivity"])] = None
    range: Annotated[str | float | None, Text(MEANINGS["range"])] = None
    gain: Annotated[float | None, GAIN] = None
    pulses_per_revolution: Annotated[int | None, Whole(1, 10_000_000)] = None
    decoding: Annotated[Literal["x1", "x2", "x4"] | None, Key()] = None
    index: Annotated[bool | None, Key()] = None
    initial_angle: Annotated[float | None, Quantity("deg", 0, 359.999)] = None
    amplifier: Annotated[dict[str, Any] | None, Text("a table [daq_card.channels.amplifier]")] = None
    filter: Annotated[dict[str, Any] | None, Text("a table [daq_card.channels.filter]")] = None
    serial: Annotated[str, Text("the sensor's serial number")] = ""
    calibrated: Annotated[datetime.date | None, Key()] = None
    valid_until: Annotated[datetime.date | None, Key()] = None


_OPTIONAL: Final = tuple(dict.fromkeys(key for sensing in SENSINGS.values() for key in keys_of(sensing)))


@dataclasses.dataclass(frozen=True, slots=True)
class PulseSource:
    """What a counter sees: `per_revolution` pulses of one track, counted `decoding` times each.

    `initial_angle` in rad is where the shaft stands when sampling starts, or where the index mark sits that
    with `index` sets the angle anew once a revolution.
    """

    per_revolution: int
    decoding: int
    index: bool
    initial_angle: float


@dataclasses.dataclass(frozen=True, slots=True)
class BenchChannel:
    """One input in SI.

    `sensitivity` is in V per `unit`, or C per `unit` for a charge amplifier, whose `gain` is in V/C (None for
    the others); `range` is the full scale in `unit`, to either side. On a counter the sensitivity is 1 and
    without meaning; `pulses` are what it counts, None for edges alone. An encoder's range has no end.
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
    pulses: PulseSource | None = None
    amplifier: AmplifierStage | None = None
    filter: FilterStage | None = None

    @property
    def counted(self) -> bool:
        """Whether it is on a counter."""
        return sort_of_input(self.physical) == "ctr"

    @property
    def volts_per_unit(self) -> float:
        """What the card sees for one `unit`, in V."""
        return self.sensitivity * (1.0 if self.gain is None else self.gain)

    @property
    def full_scale_v(self) -> float:
        """What the card sees at full scale, in V."""
        return self.range * self.volts_per_unit

    @property
    def expiries(self) -> dict[str, datetime.date]:
        """By key, until when the sensor and the stages behind it are calibrated, as far as the file says."""
        parts = (("", self), ("amplifier.", self.amplifier), ("filter.", self.filter))
        days = ((key, None if part is None else part.valid_until) for key, part in parts)
        return {f"{key}valid_until": day for key, day in days if day is not None}


def read_channels(tables: object, key: str, faults: Faults) -> tuple[BenchChannel, ...]:
    """Return the channels that are sound and note every fault of the others."""
    if not isinstance(tables, list) or not tables:
        faults.add(key, tables, f"at least one table [[{key}]]")
        return ()
    _note_twice(tables, key, "name", faults)
    _note_twice(tables, key, "physical", faults)
    _note_clockless(tables, key, faults)
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


def _note_clockless(tables: list[Any], key: str, faults: Faults) -> None:
    given = [table.get("physical") for table in tables if isinstance(table, dict)]
    if given and all(isinstance(name, str) and sort_of_input(name) == "ctr" for name in given):
        faults.add(f"{key}.physical", given[0], f"{INPUTS['ai']} too, whose clock samples the counters")


def _channel(table: object, key: str, faults: Faults) -> BenchChannel | None:
    section = read_table(_ChannelSection, table, key, faults, _CHECKS)
    values = sound_values(settings_of(_ChannelSection), table)
    name = values.get("name")
    unit = None if name is None else unit_of(name)
    if name is not None and unit is None:
        faults.unknown(f"{key}.name", name, name, channel_names())
    amplifier = _stage(AmplifierStage, values.get("amplifier"), f"{key}.amplifier", faults, AMPLIFIER_CHECKS)
    low_pass = _stage(FilterStage, values.get("filter"), f"{key}.filter", faults, FILTER_CHECKS)
    if section is None or unit is None:
        return None
    channel = _in_si(section, unit, key, faults)
    if channel is None or not _holds(amplifier, channel, key, faults):
        return None
    return dataclasses.replace(channel, amplifier=amplifier, filter=low_pass)


def _stage(kind: type[Any], table: object, key: str, faults: Faults, checks: tuple[Check, ...]) -> Any:
    return None if table is None else read_table(kind, table, key, faults, checks)


def _sensing(channel: Mapping[str, Any]) -> Sensing | None:
    return SENSINGS.get((channel["kind"], sort_of_input(channel["physical"])))


def _fits_input(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if _sensing(channel) is None:
        sort = sort_of_input(channel["physical"])
        kinds = " or ".join(f'"{kind}"' for kind, input_sort in SENSINGS if input_sort == sort)
        yield "kind", f"{kinds} on {INPUTS[sort]}"


def _measures_unit(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    unit, sensing = unit_of(channel["name"]), _sensing(channel)
    if unit is not None and sensing is not None and unit not in sensing.units:
        yield "kind", f"a kind that measures {unit}"


def _has_its_keys(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    sensing = _sensing(channel)
    if sensing is None:
        return
    for key in _OPTIONAL:
        if key not in channel:
            continue  # what stands there is wrong, which is told already
        if key in sensing.needs and channel[key] is None:
            yield key, MEANINGS[key]
        if key not in keys_of(sensing) and channel[key] is not None:
            yield key, f"none: only a {owners(key)} has one"


_CHECKS = (
    Check(("kind", "physical"), _fits_input),
    Check(("name", "kind", "physical"), _measures_unit),
    Check(("kind", "physical"), _has_its_keys),
    CALIBRATION,
)


def _in_si(section: _ChannelSection, unit: str, key: str, faults: Faults) -> BenchChannel | None:
    sensing = SENSINGS[section.kind, sort_of_input(section.physical)]
    asked = {
        "sensitivity": (sensing.sensitivity(unit), section.sensitivity, 1.0),
        "range": (RANGES.get(unit), section.range, math.inf),
    }
    numbers: dict[str, float] = {}
    for name, (field, value, otherwise) in asked.items():
        read = (
            otherwise if field is None or value is None else _quantity(field, value, f"{key}.{name}", faults)
        )
        if read is not None:
            numbers[name] = read
    if len(numbers) < len(asked):
        return None
    channel = BenchChannel(
        name=section.name,
        unit=unit,
        physical=section.physical,
        kind=section.kind,
        gain=section.gain,
        serial=section.serial,
        calibrated=section.calibrated,
        valid_until=section.valid_until,
        pulses=_pulses(section),
        sensitivity=numbers["sensitivity"],
        range=numbers["range"],
    )
    resolved = LOWEST_FULL_SCALE_V <= channel.full_scale_v <= HIGHEST_FULL_SCALE_V * (1 + 1e-9)
    if sensing.output and not resolved:
        faults.add(f"{key}.sensitivity", section.sensitivity, _arithmetic(channel))
        return None
    return channel


def _pulses(section: _ChannelSection) -> PulseSource | None:
    if section.pulses_per_revolution is None:
        return None
    # Of an encoder the counter sees both tracks, of a tachometer one.
    decoding = section.decoding or ("x4" if section.kind == "encoder" else "x1")
    return PulseSource(
        section.pulses_per_revolution,
        _DECODINGS[decoding],
        bool(section.index),
        section.initial_angle or 0.0,
    )


def _quantity(field: Quantity, value: str | float, key: str, faults: Faults) -> float | None:
    try:
        return float(quantity_field(field).read(value))
    except FieldError as error:
        faults.add(key, value, str(error))
        return None


def _holds(amplifier: AmplifierStage | None, channel: BenchChannel, key: str, faults: Faults) -> bool:
    if amplifier is None or amplifier.output is None or amplifier.output >= channel.full_scale_v * (1 - 1e-9):
        return True
    product = (
        f"{channel.range:g} {channel.unit} x {channel.sensitivity * 1e12:g} pC per {channel.unit}"
        f" x {(channel.gain or 1.0) * 1e-9:g} mV/pC = {channel.full_scale_v:g} V"
    )
    faults.add(
        f"{key}.amplifier.output", f"{amplifier.output:g} V", f"at least the channel's full scale, {product}"
    )
    return False


def _arithmetic(channel: BenchChannel) -> str:
    """Why a full scale is refused: a sensitivity in mV where the sensor gives V is a thousand times off."""
    return (
        "a full scale of 1 mV to 10 V at the card, but range x sensitivity ="
        f" {channel.range:g} {channel.unit} x {channel.volts_per_unit:g} V per {channel.unit}"
        f" = {channel.full_scale_v:g} V; check both units"
    )
