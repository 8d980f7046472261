"""What the slider-cranks share: a motor that keeps its speed, the angle it reaches, the mark on its shaft."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan, pi, sin, sqrt, tan
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from daq.quantity import Bound, Quantity
from sim_twin.effects import Effect, Parameter, set_to
from sim_twin.ranges import require_bounds
from sim_twin.sensors import MARK_V

_MARK = np.deg2rad(5.0)
_POINTS = 720


@dataclass(frozen=True, slots=True)
class SpeedDrive:
    """The motor: omega = `speed` (1 + `fluctuation` sin(`order` theta + `phase`)), in rad/s and rad."""

    speed: Annotated[float, Quantity("rpm", 1, 3000, usual=200), Bound("rad/s", 0.0)]
    fluctuation: Annotated[float, Bound("", 0.0, 0.5)] = 0.0
    order: Annotated[float, Bound("", 0.0, 100.0, above=True)] = 1.0
    phase: Annotated[float, Bound("rad", -1e3, 1e3)] = 0.0

    def __post_init__(self) -> None:
        require_bounds("drive", self)

    @property
    def mean_speed(self) -> float:
        """Revolutions over time, rad/s: less than `speed`, since a turn lingers where it is slow."""
        return self.speed * sqrt(1 - self.fluctuation**2)

    @property
    def cycle_hz(self) -> float:
        """Revolutions a second."""
        return self.mean_speed / (2 * pi)

    @property
    def peak(self) -> float:
        """What it asks of the motor, rad/s."""
        return self.speed

    def at_cycle_hz(self, cycle_hz: float) -> SpeedDrive:
        return replace(self, speed=2 * pi * cycle_hz / sqrt(1 - self.fluctuation**2))

    def phase_after(self, phase: float, cycle_hz: float, time: float) -> float:
        """Crank angle in rad at `time` s since sample 0.

        Its mean line is at `phase` in sample 0 and rises by `cycle_hz` turns a second, which this drive keeps
        already. A speed that fluctuates makes the angle swing about that line.
        """
        swing = 1 / (cycle_hz * self.order)
        times = swing * np.arange(_POINTS) / _POINTS
        mean_line = [angle_after(self, 0.0, t) - 2 * pi * cycle_hz * t for t in times]
        late = (phase - float(np.mean(mean_line))) / (2 * pi * cycle_hz)
        return angle_after(self, 0.0, late + time)


def speed_at(drive: SpeedDrive, angle: float) -> float:
    """Crank speed in rad/s at crank `angle` rad."""
    return drive.speed * (1 + drive.fluctuation * sin(drive.order * angle + drive.phase))


def angle_after(drive: SpeedDrive, angle: float, elapsed: float) -> float:
    """Crank angle in rad `elapsed` s (either sign) after it was `angle`.

    For x = order theta + phase, x' = order omega_0 (1 + a sin x), whose flow is known: with the angle u
    given by tan(x/2) = sqrt(1 - a^2) tan(u) - a, u' is constant.
    """
    a, order = drive.fluctuation, drive.order
    if a == 0.0:
        return angle + drive.speed * elapsed
    root = sqrt(1 - a**2)
    x = order * angle + drive.phase
    turns = round(x / (2 * pi))
    u = atan((tan(x / 2 - pi * turns) + a) / root) + pi * turns
    u += 0.5 * order * drive.mean_speed * elapsed
    turns = round(u / pi)
    x = 2 * atan(root * tan(u - pi * turns) - a) + 2 * pi * turns
    return (x - drive.phase) / order


def marker_voltage(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """5 V from 0 to 5 degrees of crank angle (rad), else 0; same shape."""
    return np.where(np.mod(angle, 2 * pi) < _MARK, MARK_V, 0.0)


def fluctuation_coordinates(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of amplitude, order (1 to 4) and phase, shape (n, 3): the sine and cosine of each order, (n, 8).

    The angle swings in proportion to them.
    """
    amplitude, order, phase = values.T
    waves = amplitude[:, None] * np.column_stack([np.cos(phase), np.sin(phase)])
    return np.concatenate([waves * (order == k)[:, None] for k in range(1, 5)], axis=1)


def speed_fluctuation(any_phase: float = 2 * pi) -> Effect:
    """The effect of a motor that does not keep its speed, with a phase up to `any_phase` rad either way."""
    numbers = {
        "drive.fluctuation": Parameter("amplitude", "", ((0.005, 0.05),)),
        "drive.order": Parameter("order", "", ((1.0, 4.0),), whole=True),
        "drive.phase": Parameter("phase_rad", "rad", ((-any_phase, any_phase),)),
    }
    return replace(set_to("speed_fluctuation", "drive", numbers), coordinates=fluctuation_coordinates)
