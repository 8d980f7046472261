"""The first impacts of a run against another program: own elements, scipy, the law as it is written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_twin.effects import BaseMass
from sim_twin.rigs.impact_beam.model import FLEXURE_TRANSLATION, ImpactBeam, SineDrive, nominal
from tests.sim_twin.reference import ALUMINIUM, Rig, simulate, with_regularised_friction
from tests.sim_twin.solver import solve

STEEL = nominal()
END = 0.010
SINE = SineDrive(9.0, 20.0)

CASES: dict[str, tuple[Rig, ImpactBeam, SineDrive]] = {
    "nominal": (Rig(), STEEL, SINE),
    "base_flexibility": (
        Rig(yoke=(400.0, 2.0, 0.01)), replace(STEEL, base=BaseMass(400.0, 2.0, 0.01)), SINE,
    ),
    "shaker_suspension": (
        Rig(suspension=(3e3, 20.0)), replace(STEEL, shaker_stiffness=3e3, shaker_damping=20.0), SINE,
    ),
    "shaker_mass": (Rig(moving_mass=0.1), replace(STEEL, shaker_mass=0.1), SINE),
    "pivot_compliance": (Rig(pivot_spring=1e6), replace(STEEL, pivot_stiffness=1e6), SINE),
    "contact_damping": (Rig(c=200.0), replace(STEEL, contact_damping=200.0), SINE),
    "drive_distortion": (
        Rig(harmonics={1: 1.0, 2: 0.1, 3: 0.05}), STEEL, replace(SINE, second=0.1, third=0.05),
    ),
    "rest_offset": (Rig(offset=3e-5), replace(STEEL, rest_offset=3e-5), SINE),
    "aluminium": (ALUMINIUM, nominal("aluminium"), SINE),
    "flexure_translation": (
        Rig(pivot_spring=1.258e5), replace(STEEL, pivot_stiffness=FLEXURE_TRANSLATION), SINE,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_first_impacts_are_those_of_an_independent_integrator(name: str) -> None:
    reference, rig, drive = CASES[name]
    motion, trace = simulate(reference, END), solve(rig, drive, END)
    onsets = trace.switch_times[trace.switch_regimes != 0]
    assert len(onsets) >= 4
    # A tick is 0.3 ns; what one is late delays the next ones about as much.
    assert onsets == pytest.approx(motion.onsets, abs=1e-9)
    times = np.arange(trace.outputs.shape[1]) * trace.step
    # A tick's worth of the steepest slope, k v = 1.5e7 N/m x 0.3 m/s, is 1.4e-3 N.
    assert trace.outputs[:2] == pytest.approx(motion.forces(times)[:2], abs=1.5e-3)


def test_without_clearance_the_stops_hold_the_tip_and_nothing_strikes() -> None:
    """A beam on a pin and a stop: F x_drive / L, and what rings at 189 Hz since the sine began, a tenth."""
    held = 9.0 * STEEL.drive_position
    forces = solve(replace(STEEL, clearance=0.0), SINE, 0.1).outputs[:2]
    assert forces.max(axis=1) == pytest.approx([held, held], rel=0.15)
    assert np.mean(forces.max(axis=0) > 0.0) > 0.99  # one of the stops at any time
    free = solve(STEEL, SINE, 0.1).outputs[:2]
    assert free.max() > 4.0 * held
    assert np.mean(free.max(axis=0) > 0.0) < 0.9  # it takes 4 ms from one to the other, of 25


def test_acceleration_of_a_flexible_base() -> None:
    reference, rig, drive = CASES["base_flexibility"]
    motion, trace = simulate(reference, END), solve(rig, drive, END)
    times = np.arange(trace.outputs.shape[1]) * trace.step
    accelerations = motion.forces(times)[2]
    assert np.abs(accelerations).max() > 10.0
    # As for the forces, over the yoke's 2 kg.
    assert trace.outputs[2] == pytest.approx(accelerations, abs=1e-3)


def test_hertzian_contact() -> None:
    motion = simulate(Rig(hertz=1e10), 0.0075)
    trace = solve(replace(STEEL, hertz=1e10), SINE, 0.0075)
    onsets = trace.switch_times[trace.switch_regimes != 0]
    # Second order in steps of 4.9 us, see test_hertz: 0.3 % of the peak and 0.1 us by the fourth impact.
    assert onsets == pytest.approx(motion.onsets, abs=1e-7)
    times = np.arange(trace.outputs.shape[1]) * trace.step
    expected = motion.forces(times)[0]
    assert trace.outputs[0] == pytest.approx(expected, abs=3e-3 * expected.max())


@pytest.mark.long
def test_pivot_friction_sticks_and_slips() -> None:
    times = np.arange(round(0.0065 * 204_800)) / 204_800
    trace = solve(replace(STEEL, pivot_friction=0.1), SINE, 0.0065)
    assert set(trace.switch_regimes // 3) == {0, 1, 2}  # slips either way, and sticks again
    assert trace.switch_times[0] > 1e-3  # stuck until the drive's moment has grown to the friction
    deviations = []
    for slope in (1e-4, 1e-5):
        forces = with_regularised_friction(Rig(friction=0.1), 0.0065, slope, times)
        deviations.append(np.abs(forces - trace.outputs[:2]).max())
    # The regularised law creeps with its slope, so the difference goes to zero in proportion to it.
    assert deviations[1] == pytest.approx(deviations[0] / 10, rel=0.1)
    assert deviations[1] < 1e-3 * trace.outputs[0].max()


def test_a_pivot_that_never_slips_holds_the_beam_still() -> None:
    trace = solve(replace(STEEL, pivot_friction=10.0, stations=(100,)), SineDrive(1.0, 5.0), 0.05)
    assert trace.switches == 0
    # Clamped by friction the tip bends by F a^2 (3 L - a) / (6 EI) = 3e-5 m and follows the drive.
    assert np.abs(trace.outputs[3]).max() < 10.0
