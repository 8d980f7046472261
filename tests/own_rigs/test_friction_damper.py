"""Truths of the damper's twin, and what the diagnosis makes of the measured one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.own_rigs import needs_measured_sets
from tests.own_rigs.conftest import Answer
from tests.own_rigs.friction_damper import Damper, FrictionDamper

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

RATE = 256.0
AMPLITUDE = 0.025
X = AMPLITUDE * np.sin(2 * np.pi * 0.5 * np.arange(2048) / RATE)
LAST = slice(1024, 1537)
"""The last of these samples is the first one again, two seconds later."""


def _loop(damper: Damper) -> NDArray[np.float64]:
    return damper.force(X, RATE, np.zeros(len(X)))[LAST]


def test_rigid_damper_dissipates_four_amplitudes_of_sliding_force() -> None:
    work = np.trapezoid(_loop(Damper()), X[LAST])
    # the force turns between two samples; there, it is taken as a slope
    assert work == pytest.approx(4 * AMPLITUDE, rel=1e-3)


@pytest.mark.parametrize(("play", "give"), [(0.004, 0.0), (0.0, 0.003), (0.004, 0.003)])
def test_play_and_elastic_parts_take_work_from_a_loop(play: float, give: float) -> None:
    work = np.trapezoid(_loop(Damper(play=play, give=give)), X[LAST])
    # twice a cycle the play is passed without force, and the spring gives back what it took
    assert work == pytest.approx(4 * AMPLITUDE - 2 * play - 4 * give, rel=2e-3)


def test_there_is_no_force_while_the_play_is_passed() -> None:
    loop = _loop(Damper(play=0.004, contact_give=0.002))
    free = np.abs(np.diff(X[LAST]))[np.abs(loop[:-1]) < 1e-9].sum()
    # twice a cycle; a sample is 0.3 mm away from the next one at most
    assert free == pytest.approx(2 * 0.004, abs=4 * 0.3e-3)


def test_both_springs_together_bear_the_force_that_bends_them() -> None:
    loop = _loop(Damper(give=0.002, contact_give=0.003))
    turning = int(np.argmax(X[LAST]))
    unloading = slice(turning, turning + 40)  # 4 of 5 mm
    way, force = X[LAST][turning] - X[LAST][unloading], loop[unloading]
    given = 0.002 * (1 - force) + 0.003 * (1 - force ** (2 / 3))
    assert given == pytest.approx(way, abs=2e-6)  # the rigid damper's own give is 1 um


def test_fingerprint_knows_no_unit() -> None:
    force = Damper(play=0.004).force(X, RATE, np.zeros(len(X)))
    subject = FrictionDamper((X,))
    assert subject.fingerprints([4448.0 * force]) == pytest.approx(subject.fingerprints([force]), abs=1e-6)


@needs_measured_sets
def test_measured_damper_has_backlash(answer: Answer) -> None:
    found = answer("friction damper")
    assert found.selected == ("backlash",)
    assert set(found.alike) <= {"backlash", "series_stiffness"}
