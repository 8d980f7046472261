"""The kinds of channel a data acquisition card can have, and which keys of a bench file each one has."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from daq.quantity import Check, Quantity

FORCE: Final = "N"
ACCELERATION: Final = "m/s2"
ANGLE: Final = "rad"
SPEED: Final = "rad/s"
VOLTAGE: Final = "V"
# what an input can resolve and take: below a millivolt lies its noise, above 10 V its range
LOWEST_FULL_SCALE_V: Final = 1e-3
HIGHEST_FULL_SCALE_V: Final = 10.0
_VOLTS_EACH: Final = ("sensitivity", "range")


@dataclass(frozen=True, slots=True)
class Sensing:
    """A channel kind on one sort of input: the channel units it can measure, and its keys.

    `output` is what the sensor gives, "V", or "C" where a charge amplifier makes volts of it; empty on a
    counter. A channel must have the keys `needs` and may have the keys `takes`.
    """

    units: tuple[str, ...]
    output: str
    needs: tuple[str, ...]
    takes: tuple[str, ...] = ()

    def sensitivity(self, unit: str) -> Quantity:
        """The sensitivity's unit and the range that any sensor's lies in; for volts a divider's ratio."""
        if unit == VOLTAGE:
            return Quantity("", 0, 1000, above=True)
        per = f"({unit})" if "/" in unit else unit
        if self.output == "C":
            return Quantity(f"pC/{per}", 0, 1e6, above=True)
        return Quantity(f"mV/{per}", 0, 1e9, above=True)


SENSINGS: Mapping[tuple[str, str], Sensing] = MappingProxyType(
    {
        ("voltage", "ai"): Sensing((FORCE, ACCELERATION), "V", _VOLTS_EACH, ("filter",)),
        ("charge_amplifier", "ai"): Sensing(
            (FORCE, ACCELERATION), "C", (*_VOLTS_EACH, "gain"), ("amplifier", "filter")
        ),
        ("force_iepe", "ai"): Sensing((FORCE,), "V", _VOLTS_EACH),
        ("acceleration_iepe", "ai"): Sensing((ACCELERATION,), "V", _VOLTS_EACH),
        ("encoder", "ctr"): Sensing(
            (ANGLE,), "", ("pulses_per_revolution",), ("decoding", "index", "initial_angle")
        ),
        ("marker", "ai"): Sensing((VOLTAGE,), "V", ("range",), ("sensitivity", "filter")),
        ("marker", "ctr"): Sensing((VOLTAGE,), "", ("range",)),
        ("tachometer", "ai"): Sensing((SPEED,), "V", _VOLTS_EACH, ("filter",)),
        ("tachometer", "ctr"): Sensing((SPEED,), "", ("pulses_per_revolution", "range")),
    }
)
"""By kind and sort of input: `ai` analog, `ctr` counter."""
KINDS: Final = tuple(dict.fromkeys(kind for kind, _ in SENSINGS))
INPUT_WORDS: Mapping[str, str] = MappingProxyType(
    {"ai": 'an analog input, such as "cDAQ1Mod1/ai0"', "ctr": 'a counter, such as "cDAQ1Mod3/ctr0"'}
)
GAIN: Final = Quantity("mV/pC", 0, 1e6, above=True)
RANGES: Mapping[str, Quantity] = MappingProxyType(
    {
        FORCE: Quantity("N", 0, 1e6, above=True),
        ACCELERATION: Quantity("m/s2", 0, 1e6, above=True),
        VOLTAGE: Quantity("V", 0, 1e3, above=True),
        SPEED: Quantity("rad/s", 0, 1e5, above=True),
    }
)
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


def owners(key: str) -> str:
    """Name the kinds that have a key, for a message."""
    return " or ".join(
        dict.fromkeys(kind for (kind, _), sensing in SENSINGS.items() if key in keys_of(sensing))
    )


def keys_of(sensing: Sensing) -> tuple[str, ...]:
    """Every key that a kind may have beside those of all channels."""
    return (*sensing.needs, *sensing.takes)


_OPTIONAL: Final = tuple(dict.fromkeys(key for sensing in SENSINGS.values() for key in keys_of(sensing)))


def _sensing(channel: Mapping[str, Any]) -> Sensing | None:
    return SENSINGS.get((channel["kind"], sort_of_input(channel["physical"])))


def _fits_input(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if _sensing(channel) is None:
        sort = sort_of_input(channel["physical"])
        kinds = " or ".join(f'"{kind}"' for kind, input_sort in SENSINGS if input_sort == sort)
        yield "kind", f"{kinds} on {INPUT_WORDS[sort]}"


def _measures_unit(channel: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    sensing = _sensing(channel)
    if sensing is not None and channel["unit"] not in sensing.units:
        yield "kind", f"a kind that measures {channel['unit']}"


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


SENSING_CHECKS: Final = (
    Check(("kind", "physical"), _fits_input),
    Check(("unit", "kind", "physical"), _measures_unit),
    Check(("kind", "physical"), _has_its_keys),
)
"""Of a channel's table together with the `unit` that its rig declares."""


def sensitivity_of(channel: Mapping[str, Any]) -> Quantity | None:
    """What a channel's sensitivity may be; None where its kind and unit are not known, or it has none."""
    sensing = _sensing(channel) if channel.keys() >= {"kind", "physical", "unit"} else None
    return None if sensing is None else sensing.sensitivity(channel["unit"])


def range_of(channel: Mapping[str, Any]) -> Quantity | None:
    """What a channel's full scale may be; None where it has no end."""
    return RANGES.get(channel.get("unit", ""))
