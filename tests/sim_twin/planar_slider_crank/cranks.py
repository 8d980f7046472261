"""The nominal crank at 200 rpm, and runs of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.mechanisms.run import CONTACT
from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.kernel import CrankNumbers
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank, nominal
from sim_twin.rigs.planar_slider_crank.motion import CrankTwin, simulation, step_limits
from sim_twin.twin import Twin

RPM = np.pi / 30
DRIVE = SpeedDrive(200 * RPM)
RIG = nominal()


def twin(rig: PlanarSliderCrank = RIG, drive: SpeedDrive = DRIVE) -> CrankTwin:
    return Twin(rig, drive)


def run(
    rig: PlanarSliderCrank = RIG, tolerance: float = 1e-6, step: float = 1e-4, angle: float = 0.0,
    drive: SpeedDrive = DRIVE,
) -> Simulation[CrankNumbers]:  # fmt: skip
    return simulation(rig, drive, angle, step, step_limits(rig, tolerance))


def of_joint(episodes: NDArray[np.float64], joint: int) -> NDArray[np.float64]:
    return episodes[episodes[:, CONTACT] == joint]
