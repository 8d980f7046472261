"""Which keys of a bench file a channel of the card has, by its kind and its input."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

from daq.quantity import Check, Quantity, rule
from drivers.ni_daq.sensors import SENSORS, Sensor, units_of

# what an input can resolve and take: below a millivolt lies its noise, above 10 V its range
LOWEST_FULL_SCALE_V: Final = 1e-3
HIGHEST_FULL_SCALE_V: Final = 10.0
INPUT_WORDS: Mapping[str, str] = MappingProxyType(
    {"ai": 'an analog input, such as "cDAQ1Mod1/ai0"', "ctr": 'a counter, such as "cDAQ1Mod3/ctr0"'}
)
GAIN: Final = Quantity("mV/pC", 0, 1e6, above=True)  # 1 mV/pC is 1e9 V/C
MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "sensitivity": 'a sensitivity, such as "100 mV/N"',
        "range": 'the full scale, such as "100 N"',
        "gain": f"the charge amplifier's gain, {GAIN}",
        "pulses_per_revolution": "the pulses of one track for each revolution, a whole number",
    }
)
"""What a key that is missing should hold."""


def sort_of_input(physical: str) -> str:
    """Return `ai` or `ctr` for an input of the card, whatever its case."""
    return physical.rpartition("/")[2].lstrip("_").rstrip("0123456789").lower()


def keys_of(sensor: Sensor) -> tuple[str, ...]:
    """Every key that a kind may have beside those of all channels."""
    return (*sensor.needs, *sensor.takes)


def _sensors() -> Iterator[tuple[str, str, Sensor]]:
    """Each kind with each sort of input that it can be on."""
    for name, kind in SENSORS.items():
        for sort in INPUT_WORDS:
            if (sensor := kind.on(sort)) is not None:
                yield name, sort, sensor


def _sensor(channel: Mapping[str, Any]) -> Sensor | None:
    return SENSORS[channel["kind"]].on(sort_of_input(channel["physical"]))


def _units(channel: Mapping[str, Any]) -> Mapping[str, Quantity | None]:
    sensor = _sensor(channel)
    return {} if sensor is None else units_of(sensor, channel["unit"], channel.get("modelled", True))


def _fits_input(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if _sensor(channel) is None:
        sort = sort_of_input(channel["physical"])
        kinds = " or ".join(f'"{kind}"' for kind, input_sort, _ in _sensors() if input_sort == sort)
        yield "kind", f"{kinds} on {INPUT_WORDS[sort]}"


def _has_its_keys(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    sensor = _sensor(channel)
    if sensor is None:
        return
    owners: dict[str, dict[str, None]] = {}
    for kind, _, other in _sensors():
        for key in keys_of(other):
            owners.setdefault(key, {})[kind] = None
    for key, kinds in owners.items():
        if key not in channel:
            continue  # what stands there is wrong, which is told already
        if key in sensor.needs and channel[key] is None:
            yield key, MEANINGS[key]
        if key not in keys_of(sensor) and channel[key] is not None:
            yield key, f"none: only a {' or '.join(kinds)} has one"


SENSING_CHECKS: Final = (
    Check(("kind", "physical"), _fits_input),
    rule(
        ("unit", "kind", "physical"),
        lambda channel: _sensor(channel) is None or channel["unit"] in _units(channel),
        "kind",
        "a kind that measures {unit}",
    ),
    Check(("kind", "physical"), _has_its_keys),
)
"""Of a channel's table together with the `unit` that its rig declares."""


def sensitivity_of(channel: Mapping[str, Any]) -> Quantity | None:
    """What a channel's sensitivity may be; None where its kind and unit are not known, or it has none.

    For volts it is a divider's ratio; with a gain the sensor gives charge.
    """
    sensor = _sensor(channel) if channel.keys() >= {"kind", "physical", "unit"} else None
    if sensor is None:
        return None
    unit = channel["unit"]
    per = unit if unit.isalpha() else f"({unit})"
    if unit == "V":
        return Quantity("", 0, 1000, above=True)
    if "gain" in sensor.needs:
        return Quantity(f"pC/{per}", 0, 1e6, above=True)
    return Quantity(f"mV/{per}", 0, 1e9, above=True)  # as sensors' sheets state it


def range_of(channel: Mapping[str, Any]) -> Quantity | None:
    """What a channel's full scale may be; None where it has no end."""
    return _units(channel).get(channel["unit"]) if channel.keys() >= {"kind", "physical", "unit"} else None
