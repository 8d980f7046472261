"""The order of the step that carries what is not linear in the contact law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from tests.sim_twin.reference import Rig, simulate
from tests.sim_twin.solver import solve

COMMON_RATE = 51_200
BEGIN, END = 230, 250  # 4.49 to 4.88 ms, within the first contact


def test_force_within_a_hertzian_contact_converges_with_the_second_power_of_the_step() -> None:
    times = np.arange(BEGIN, END) / COMMON_RATE
    exact = simulate(Rig(hertz=1e10), 0.0052).forces(times)[0]
    assert exact.min() > 0.5
    factors = np.array([4, 8, 16, 32])
    errors = []
    for factor in factors:
        trace = solve(replace(nominal(), hertz=1e10), SineDrive(9.0, 20.0), 0.0052, COMMON_RATE * factor)
        errors.append(np.sqrt(np.mean((trace.outputs[0, ::factor][BEGIN:END] - exact) ** 2)))
    order = -np.polyfit(np.log(factors), np.log(errors), 1)[0]
    assert order == pytest.approx(2.0, abs=0.1)
