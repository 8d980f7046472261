"""The kinds of channel a data acquisition card can have, and what a sensitivity means for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from rig.files.fields import Measured

FORCE: Final = "N"
ACCELERATION: Final = "m/s2"
# what an input can resolve and take: below a millivolt lies its noise, above 10 V its range
LOWEST_FULL_SCALE_V: Final = 1e-3
HIGHEST_FULL_SCALE_V: Final = 10.0


@dataclass(frozen=True, slots=True)
class SensorKind:
    """An analog channel kind: the channel units it can measure, and what it gives per such unit.

    `output` is "V", or "C" where a charge amplifier with a gain of its own makes volts of it.
    """

    units: tuple[str, ...]
    output: str
    example: str

    def sensitivity(self, unit: str) -> Measured:
        """The sensitivity's unit and the range that any sensor's lies in."""
        if self.output == "C":
            return Measured(f"pC/({unit})" if "/" in unit else f"pC/{unit}", 0, 1e6, above=True)
        return Measured(f"mV/({unit})" if "/" in unit else f"mV/{unit}", 0, 1e9, above=True)


SENSOR_KINDS: Mapping[str, SensorKind] = MappingProxyType(
    {
        "voltage": SensorKind((FORCE, ACCELERATION), "V", "100 mV/N"),
        "charge_amplifier": SensorKind((FORCE, ACCELERATION), "C", "4 pC/N"),
        "force_iepe": SensorKind((FORCE,), "V", "22.4 mV/N"),
        "acceleration_iepe": SensorKind((ACCELERATION,), "V", "100 mV/g"),
    }
)
LATER_KINDS: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(
        ("encoder", "marker", "tachometer"),
        "this version drives the impact beam, whose channels are analog",
    )
)
GAIN: Final = Measured("mV/pC", 0, 1e6, above=True)
RANGES: Mapping[str, Measured] = MappingProxyType(
    {FORCE: Measured("N", 0, 1e6, above=True), ACCELERATION: Measured("m/s2", 0, 1e6, above=True)}
)
