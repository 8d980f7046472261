"""A gauge between shaker and beam: what of the coil's force reaches the beam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_twin.rigs.impact_beam.base.model import flexible_base
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive, nominal
from sim_twin.rigs.impact_beam.structure import structure_of
from sim_twin.rigs.impact_beam.truth import BeamTruth
from sim_twin.twin import Twin

RATE = 51_200.0
SHAKER = {"shaker_mass": 0.08, "shaker_stiffness": 3000.0, "shaker_damping": 25.0}


def moved(rig: ImpactBeam, frequency: float) -> complex:
    """The drive point's motion in m for each newton there, nothing touching."""
    s, omega = structure_of(rig), 2 * np.pi * frequency
    dynamic = s.K - omega**2 * np.eye(len(s.K)) + 1j * omega * s.C
    return complex(s.drive @ np.linalg.solve(dynamic, s.drive))


@pytest.mark.parametrize("frequency", [20.0, 90.0])
def test_it_shows_what_moves_the_bare_beam(frequency: float) -> None:
    rig = replace(nominal(), clearance=10e-3, **SHAKER, stinger_gauge=True)
    drive = SineDrive(1.0, frequency)
    truth = BeamTruth(Twin(rig, drive), RATE)
    truth.change_drive(drive, 0.0, 0.0)
    truth.advance(round(4 * RATE))
    times = 4 + np.arange(round(RATE)) / RATE
    shown = complex(2j * np.mean(truth.advance(len(times))[0] * np.exp(-2j * np.pi * frequency * times)))
    bare = replace(nominal(), clearance=10e-3)
    assert shown == pytest.approx(
        moved(rig, frequency) / moved(bare, frequency), rel=0.03
    )  # modes are damped anew
    assert abs(shown - 1.0) > 0.05


def test_without_shaker_it_is_the_coils_force() -> None:
    for rig in (nominal(), replace(nominal(), base=flexible_base())):
        drive = SineDrive(9.0, 20.0)
        both = []
        for gauge in (False, True):
            truth = BeamTruth(Twin(replace(rig, stinger_gauge=gauge), drive), RATE)
            truth.change_drive(drive, 0.0, 0.0)
            both.append(truth.advance(4096))
        assert both[1] == pytest.approx(both[0], abs=1e-5)
