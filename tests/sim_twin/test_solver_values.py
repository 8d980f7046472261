"""Figures of the exact solver come from whole motions only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.errors import SimulationFailed
from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.lane_figures import figures
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.solver_values import solver_values
from sim_twin.status import Status
from sim_twin.switched.simulation import Simulation
from sim_twin.twin import Twin

SINE = SineDrive(9.0, 20.0)


@pytest.mark.parametrize("amplitude", [np.nan, 1e308])
def test_a_motion_that_is_not_finite_has_no_figures(
    amplitude: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No parameters within their ranges do this, so the drive is given here.
    monkeypatch.setattr(SineDrive, "phasors", lambda _: np.array([0, amplitude, 0, 0]))
    with pytest.raises(SimulationFailed, match="left all bounds") as failed:
        solver_values(Twin(nominal(), SINE), 0.0, 0.02)
    assert failed.value.status is Status.DIVERGED


def test_switches_that_found_no_room_are_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    # Room for 64 switches and nothing for each step: half a second of impacts has more.
    monkeypatch.setattr("sim_twin.switched.simulation._MOST_SWITCHES_A_STEP", 0.0)
    with pytest.raises(SimulationFailed, match="more steps were needed") as failed:
        solver_values(Twin(nominal(), SINE), 0.0, 0.5)
    assert failed.value.status is Status.STEPS_EXHAUSTED


@pytest.mark.parametrize(
    ("change", "finer"),
    [({"contact_damping": 400.0}, 64), ({"contact_stiffness": 7.5e7}, 64), ({"contact_stiffness": 3e6}, 64)],
)
def test_first_peaks_hold_at_the_ends_of_the_catalogue(change: dict[str, float], finer: int) -> None:
    twin = Twin(replace(nominal(), **change), SINE)
    simulation = Simulation(assemble(twin.rig, (1,)), 1 / (finer * 204_800))
    simulation.drive(SINE.phasors()[1:2], 2 * np.pi * SINE.frequency)
    trace = simulation.advance(round(0.006 * finer * 204_800))
    begin, end = (trace.switch_times[:2] / trace.step).astype(int)
    exact = trace.outputs[0, begin : end + 2].max()
    for found in (solver_values(twin, 0.0, 0.05), figures([twin], [0.0], 0.0, 0.05)[0].values):
        assert found["first_peak_n"] == pytest.approx(exact, rel=0.005)
