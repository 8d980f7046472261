"""The energy that the crank pin gives is found in motion, in the contacts' springs or in what they lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_twin.contact import contact_forces
from sim_twin.mechanisms.run import ONSET
from sim_twin.rigs.planar_slider_crank import kernel
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.motion import eccentricity, numbers
from tests.sim_twin.planar_slider_crank.cranks import DRIVE, RIG, run

LOSSLESS = replace(RIG, restitution=1.0, friction=0.0)
LOSSY = replace(RIG, restitution=0.6, friction=0.2, guide_friction=0.3)


def energies(rig: PlanarSliderCrank, y: np.ndarray) -> np.ndarray:
    """Kinetic, potential and stored, less the crank pin's work, plus what was lost, J."""
    at, p = eccentricity(rig, y, DRIVE.speed), numbers(rig, DRIVE)
    d = np.hypot(at.x, at.y) - [rig.clearance_1, rig.clearance_2]
    rod = rig.rod_mass * (y[kernel.VX] ** 2 + y[kernel.VY] ** 2) + rig.rod_inertia * y[kernel.W] ** 2
    kinetic = 0.5 * (rod + rig.piston_mass * y[kernel.VS] ** 2)
    stored = sum(
        contact_forces(joint.law, x, 0.0, 1.0)[1] * x / (joint.law.exponent + 1.0)
        for joint, x in zip((p.joint_1, p.joint_2), d, strict=True)
    )
    potential = rig.rod_mass * rig.gravity * y[kernel.Y]
    return np.array([kinetic, potential, stored, -y[kernel.WORK], y[kernel.LOST]])


@pytest.mark.parametrize("rig", [LOSSLESS, LOSSY])
def test_balance_of_a_run(rig: PlanarSliderCrank) -> None:
    # Nearly a revolution, some ten impacts and the sliding between them, at the tightest setting.
    motion = run(rig, tolerance=1e-11, step=2e-4)
    history = []
    for _ in range(1200):
        history.append(energies(rig, motion.present()))
        motion.advance(1)
    table = np.array(history)
    total = table.sum(axis=1)
    assert abs(total - total[0]).max() < 1e-6 * abs(table).max()
    if rig is LOSSLESS:
        assert (table[:, 4] == 0).all()
    else:
        assert table[-1, 4] > 0.1


@pytest.mark.parametrize("rig", [LOSSLESS, RIG])
def test_balance_over_each_of_the_first_impacts(rig: PlanarSliderCrank) -> None:
    episodes = run(rig, tolerance=1e-10, step=1e-4).advance(120).episodes
    motion = run(rig, tolerance=1e-10, step=1e-5)
    totals = {}
    for k in range(1200):
        totals[k] = energies(rig, motion.present())
        motion.advance(1)
    for episode in episodes[:4]:
        before = totals[int(episode[ONSET] / 1e-5)]
        after = totals[int(episode[-1] / 1e-5) + 1]
        assert abs(after.sum() - before.sum()) < 1e-6 * abs(before).max()
