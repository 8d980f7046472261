"""First impacts of the rigid mechanism against absolute coordinates with multipliers, by DOP853."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.motion import PRECISION, simulation, step_limits
from tests.sim_twin.spatial_slider_crank.maximal import RigidMechanism

SPEED = 230 * 2 * pi / 60
RIGID = SpatialSliderCrank(rod_modes=0)
SPATIAL = replace(RIGID, axis_angle=1.2, slider=replace(RIGID.slider, pin=(-0.004, 0.002, 0.003)))


def impacts(rig: SpatialSliderCrank, precision: float, seconds: float = 0.03) -> np.ndarray:
    motion = simulation(rig, SpeedDrive(SPEED), 0.0, seconds, step_limits(rig, precision))
    return motion.advance(2).episodes


@pytest.mark.parametrize("rig", [RIGID, SPATIAL])
def test_first_impacts(rig: SpatialSliderCrank) -> None:
    expected = np.array(RigidMechanism(rig, SPEED).impacts(4, 0.03))
    found = impacts(rig, 1e-12)[: len(expected)]
    assert len(expected) == 4
    assert list(found[:, 1]) == list(expected[:, 1])
    # Rounding of places to 1e-12 m at speeds of 0.1 m/s; each impact multiplies it by ten or so.
    assert found[:, 0] == pytest.approx(expected[:, 0], abs=1e-6)
    assert found[:, 3] == pytest.approx(expected[:, 2], rel=1e-3)


@pytest.mark.parametrize("modes", [0, 8])
def test_usual_precision_gives_first_peaks_to_two_thousandths(modes: int) -> None:
    rig = replace(SPATIAL, rod_modes=modes)
    usual, fine = impacts(rig, PRECISION), impacts(rig, 1e-12)
    for contact in (0, 2, 8):
        first = [run[run[:, 1] == contact][0] for run in (usual, fine)]
        assert first[0][3] == pytest.approx(first[1][3], rel=2e-3)
