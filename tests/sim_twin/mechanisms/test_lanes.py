"""Runs side by side against the same runs one by one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi, tau
from typing import Any

import numpy as np
import pytest

from sim_twin.contact import ContactLaw, hertz, lankarani_nikravesh, linear
from sim_twin.effects import BaseMass
from sim_twin.ensembles.clean_samples import OneByOne
from sim_twin.mechanisms.lanes import Lane, LaneSimulation
from sim_twin.mechanisms.run import StepLimits
from sim_twin.mechanisms.simulation import Simulation
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.model import RodBending
from sim_twin.rigs.planar_slider_crank.model import nominal as planar
from sim_twin.rigs.spatial_slider_crank.model import nominal as spatial
from sim_twin.status import Status
from sim_twin.twin import AnyTwin, Twin
from tests.sim_twin.mechanisms import falling_mass
from tests.sim_twin.mechanisms.falling_mass import FallingMass

HEIGHT, GRAVITY, STEP = 0.01, 9.81, 1e-3
LIMITS = StepLimits(1e-9 * np.array([1e-3, 1.0, 1.0]), 1e-2, 1e-14, 1e-6, 0.01, 1e-12, 10**6)
LAWS = (hertz(1e9), linear(1e6, 20.0), lankarani_nikravesh(1e9, 0.5), ContactLaw(1e7, 1.2, 0.1, 5.0))
"""Of Hertz and linear alike: the exponent of a law may differ from lane to lane."""


def falling(number: int, law: ContactLaw | None = None, limits: StepLimits = LIMITS) -> Lane:
    mass = FallingMass(1.0 + 0.1 * number, GRAVITY, law or LAWS[number % len(LAWS)])
    return Lane(mass, np.array([HEIGHT * (1 + number), 0.0, 0.0]), limits)


def side_by_side(*lanes: Lane) -> LaneSimulation:
    return LaneSimulation(falling_mass.SIDE_BY_SIDE, lanes, STEP)


@pytest.mark.long
@pytest.mark.parametrize("number", range(4))
def test_a_lane_goes_as_a_run_of_its_own(number: int) -> None:
    lane = falling(number)
    own = Simulation(falling_mass.run, lane.parameters, lane.y, 1, 3, LIMITS, STEP).advance(300).outputs
    together = side_by_side(*(falling(k) for k in range(6))).advance(300)[number]
    assert np.count_nonzero(own[2]) > 0  # it has met the floor
    np.testing.assert_allclose(together[0], own[0], atol=1e-8)  # a step may err by 1e-12 m; some bounces on
    assert together[2].max() == pytest.approx(own[2].max(), rel=1e-5)


def test_no_lane_hangs_on_its_company_nor_on_how_many_samples_are_asked_for() -> None:
    several = side_by_side(*(falling(k) for k in range(11)))
    in_parts = np.concatenate([np.array(several.advance(count)) for count in (1, 99, 7, 193)], axis=2)
    for number in (0, 3, 9):
        assert np.array_equal(side_by_side(falling(number)).advance(300)[0], in_parts[number])


def test_a_lane_that_fails_takes_no_other_along() -> None:
    nowhere = replace(falling(2), y=np.array([np.nan, 0.0, 0.0]))
    heavy = replace(falling(2), parameters=FallingMass(np.nan, GRAVITY, LAWS[0]))
    runs = side_by_side(nowhere, falling(0), heavy)
    assert runs.statuses[0] is Status.DIVERGED  # from the start
    found = np.concatenate([np.array(runs.advance(count)) for count in (100, 200)], axis=2)
    assert runs.statuses == (Status.DIVERGED, Status.COMPLETED, Status.DIVERGED)
    assert not found[0].any()
    assert not found[2, :, -200:].any()
    assert np.array_equal(found[1], side_by_side(falling(0)).advance(300)[0])


def test_a_lane_that_takes_too_many_steps_is_told() -> None:
    runs = side_by_side(falling(1), falling(0, limits=LIMITS._replace(budget=12)))
    found = runs.advance(100)[1]
    assert runs.statuses == (Status.COMPLETED, Status.STEPS_EXHAUSTED)
    own = Simulation(falling_mass.run, falling(0).parameters, falling(0).y, 1, 3, LIMITS, STEP).advance(100)
    reached = np.count_nonzero(found[0])
    assert 0 < reached < 45  # in flight, which it does not get to the end of
    np.testing.assert_allclose(found[:, :reached], own.outputs[:, :reached], atol=1e-12)
    assert not found[:, reached:].any()


@cache
def cranks(name: str) -> tuple[AnyTwin, ...]:
    """Healthy rigs, one with more states than the others, one that does not turn evenly."""
    drive = SpeedDrive(200 * pi / 30)
    uneven = SpeedDrive(drive.speed, 0.05, 2, 1.0)
    if name == "planar":
        rig: Any = planar()
        other: Any = replace(rig, bending=RodBending(40.0, 0.02), guide_friction=0.2)
    else:
        rig = spatial()
        other = replace(rig, base=BaseMass(25.0, 4.0, 0.05))
    rng = np.random.default_rng(1)
    nominal: AnyTwin = Twin(rig, drive)
    healthy = [nominal.model.draw_healthy(nominal, rng, rng) for _ in range(3)]
    return (*healthy, replace(nominal, rig=other), replace(nominal, drive=uneven))


STEPS = {"planar": 1500, "spatial": 640}
"""Of 51.2 kHz: to the first strikes of a joint, before the motions have parted."""
PHASES, RATE = np.linspace(0.0, tau, 5).tolist(), 51_200.0


@pytest.mark.parametrize("name", STEPS)
def test_no_crank_hangs_on_its_company(name: str) -> None:
    twins, steps = cranks(name), STEPS[name]
    model = twins[0].model
    assert model.side_by_side is not None
    all_of_them = model.side_by_side.truths(twins, PHASES, RATE)
    together = np.concatenate(
        [all_of_them.advance(part) for part in (1, steps // 3, steps - 1 - steps // 3)], 2
    )
    for number, twin in enumerate(twins):
        alone = model.side_by_side.truths([twin], [PHASES[number]], RATE)
        assert np.array_equal(alone.advance(steps)[0], together[number]), number


@pytest.mark.parametrize("name", STEPS)
def test_rigs_side_by_side_strike_as_they_do_one_by_one(name: str) -> None:
    twins, phases, rate, steps = cranks(name), PHASES, RATE, STEPS[name]
    model = twins[0].model
    assert model.side_by_side is not None
    alone = [model.truth(twin, rate, False) for twin in twins]
    for truth, twin, phase in zip(alone, twins, phases, strict=True):
        truth.change_drive(twin.drive, phase, 0.0)
    own = OneByOne(alone).advance(steps)
    truths = model.side_by_side.truths(twins, phases, rate)
    together = truths.advance(steps)
    sizes = np.abs(own).max(axis=2)
    # in every run what nothing shakes but strikes
    assert np.all((sizes[:, 2] if name == "planar" else sizes[:, :9].max(axis=1)) > 0.0)
    # by then the tolerances of the steps, 1e-6 and less, have grown to some 1e-5
    assert np.all(np.abs(together - own).max(axis=2) <= 1e-3 * sizes)
    assert set(truths.statuses) == {Status.COMPLETED}
