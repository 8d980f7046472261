"""The [drive] section of the slider-cranks: a constant speed."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, Any, Final

from pydantic.dataclasses import dataclass

from rig.files.fields import Measured
from rig.files.rigs.kind import Highest
from rig.files.section import SECTION


@dataclass(frozen=True, slots=True, config=SECTION)
class SpeedSection:
    """The crank's speed in rad/s."""

    speed: Annotated[float, Measured("rpm", 1, 3000)]


MAXIMUM_SPEED: Final = Highest("maximum_speed", "rpm", lambda inverter: inverter.maximum_speed, 30 / pi)


def revolutions_per_second(drive: Mapping[str, Any]) -> float | None:
    """Revolutions a second of the sound values of [drive]; None without a speed."""
    speed = drive.get("speed")
    return None if speed is None else float(speed) / (2 * pi)


def highest_speed(drive: SpeedSection) -> float:
    """What the drive asks of the inverter, rad/s."""
    return drive.speed
