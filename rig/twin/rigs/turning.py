"""What the twins of both slider-cranks share: keeping step with a crank that turns."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sqrt

import numpy as np

from rig.twin.alignment import Alignment
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after

_POINTS = 720


def in_step(drive: SpeedDrive, alignment: Alignment) -> SpeedDrive:
    """The drive at the measured mean speed."""
    return replace(drive, speed=2 * pi * alignment.frequency / sqrt(1 - drive.fluctuation**2))


def angle_at(drive: SpeedDrive, alignment: Alignment, time: float) -> float:
    """Crank angle in rad at `time` s since sample 0, so that its mean line is the measured one.

    `drive` is in step already. A speed that fluctuates makes the angle swing about that line.
    """
    swing = 1 / (alignment.frequency * drive.order)
    times = swing * np.arange(_POINTS) / _POINTS
    mean_line = [angle_after(drive, 0.0, t) - 2 * pi * alignment.frequency * t for t in times]
    late = (alignment.phase - float(np.mean(mean_line))) / (2 * pi * alignment.frequency)
    return angle_after(drive, 0.0, late + time)
