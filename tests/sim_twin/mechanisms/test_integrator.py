"""The integrator on the least mechanism: bouncing, blocks, order, failures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from sim_twin.contact import ContactLaw, hertz, lankarani_nikravesh
from sim_twin.mechanisms.run import APPROACH, END, ONSET, StepLimits
from sim_twin.mechanisms.simulation import Simulation
from sim_twin.status import Status
from tests.sim_twin.mechanisms import falling_mass
from tests.sim_twin.mechanisms.falling_mass import FallingMass

HEIGHT, GRAVITY = 0.01, 9.81
FALL = np.sqrt(2 * HEIGHT / GRAVITY)


def limits(tolerance: float = 1e-9, budget: int = 10**6) -> StepLimits:
    return StepLimits(tolerance * np.array([1e-3, 1.0, 1.0]), 1e-2, 1e-14, 1e-6, 0.01, 1e-12, budget)


def mass(law: ContactLaw, step: float, to: StepLimits) -> Simulation[FallingMass]:
    y = np.array([HEIGHT, 0.0, 0.0])
    return Simulation(falling_mass.run, FallingMass(1.0, GRAVITY, law), y, 1, 3, to, step)


def test_flight_is_exact_and_long_flights_are_not_stepped_through() -> None:
    run = mass(hertz(1e9), 1e-3, limits())
    trace = run.advance(45)
    t = 1e-3 * np.arange(45)
    np.testing.assert_allclose(trace.outputs[0], HEIGHT - GRAVITY * t**2 / 2, atol=1e-15)
    assert run.steps <= 20  # at most 10 ms a step, and the first ones grow from 1 us


def test_onset_is_where_the_overlap_begins() -> None:
    trace = mass(hertz(1e9), 0.1, limits()).advance(2)
    assert trace.episodes[0, ONSET] == pytest.approx(FALL, abs=limits().reach / (GRAVITY * FALL))
    assert trace.episodes[0, APPROACH] == pytest.approx(GRAVITY * FALL, rel=1e-9)


def test_bounces_back_for_ever_without_losses() -> None:
    trace = mass(hertz(1e9), 0.01, limits(1e-11)).advance(401)
    starts = trace.episodes[:, ONSET]
    # Period: two falls and a contact that is short against them; its length is that of every other contact.
    contact = trace.episodes[0, END] - trace.episodes[0, ONSET]
    np.testing.assert_allclose(
        np.diff(starts), 2 * FALL + contact, atol=2e-6
    )  # an end is late by up to a step
    np.testing.assert_allclose(trace.episodes[:, APPROACH], GRAVITY * FALL, rtol=1e-7)


def test_comes_to_rest_on_its_spring() -> None:
    trace = mass(lankarani_nikravesh(1e9, 0.5), 0.01, limits()).advance(201)
    depth = (GRAVITY / 1e9) ** (2 / 3)
    assert trace.outputs[0, -1] == pytest.approx(-depth, rel=1e-3)
    assert trace.outputs[2, -1] == pytest.approx(GRAVITY, rel=1e-3)


def test_blocks_are_bit_by_bit_the_run_in_one_go() -> None:
    law = lankarani_nikravesh(1e9, 0.8)
    whole = mass(law, 1e-4, limits()).advance(5000)
    run = mass(law, 1e-4, limits())
    parts = [run.advance(count) for count in (1, 443, 6, 1000, 3550)]
    np.testing.assert_array_equal(np.concatenate([part.outputs for part in parts], axis=1), whole.outputs)
    np.testing.assert_array_equal(np.concatenate([part.episodes for part in parts]), whole.episodes)


def test_a_change_that_changes_nothing_changes_nothing() -> None:
    law = lankarani_nikravesh(1e9, 0.8)
    whole = mass(law, 1e-4, limits(1e-11)).advance(1000)
    run = mass(law, 1e-4, limits(1e-11))
    first = run.advance(455)  # in the first contact
    assert first.outputs[2, -1] > 0
    run.change(run.parameters, run.present())
    second = run.advance(545)
    both = np.concatenate([first.outputs, second.outputs], axis=1)
    # The steps fall elsewhere: equal to the tolerance, summed over a hundred steps.
    np.testing.assert_allclose(both[1], whole.outputs[1], atol=1e-8)


def test_error_follows_the_tolerance() -> None:
    law = hertz(1e9)
    exact = mass(law, 0.05, limits(1e-13)).advance(11).outputs[0, 10]
    errors = [
        abs(mass(law, 0.05, limits(tol)).advance(11).outputs[0, 10] - exact) for tol in (1e-5, 1e-7, 1e-9)
    ]
    # Error per step is held, so the whole goes as tolerance^(4/5) or better; the start of a contact, where
    # the force is not smooth, has its own share.
    assert errors[1] < errors[0] / 10
    assert errors[2] < errors[1] / 10


def test_exhausted_budget_is_a_status() -> None:
    trace = mass(hertz(1e9), 1e-3, limits(budget=30)).advance(1000)
    assert trace.status is Status.STEPS_EXHAUSTED
    assert 0 < trace.outputs.shape[1] < 1000


@dataclass
class _Blown:
    law: ContactLaw
    start: float


@pytest.mark.parametrize(
    "blown", [_Blown(hertz(np.nan), -1e-6), _Blown(hertz(1e300), -1e-6), _Blown(hertz(1e9), np.nan)]
)
def test_leaving_all_bounds_is_a_status(blown: _Blown) -> None:
    y = np.array([blown.start, -1.0, 0.0])
    run = Simulation(falling_mass.run, FallingMass(1.0, 9.81, blown.law), y, 1, 3, limits(), 1e-3)
    assert run.advance(10).status is Status.DIVERGED
    again = run.advance(10)
    assert again.status is Status.DIVERGED
    assert again.outputs.shape == (3, 0)


@pytest.mark.parametrize("height", [0.0, 5e-14, 8e-14, 2e-13])
def test_a_contact_that_begins_again_right_after_it_ended_does_not_stop_the_run(height: float) -> None:
    # Nearer to the floor than the onset is located (1 pm), and leaving it: back within 0.1 us.
    y = np.array([height, 1e-7, 0.0])
    run = Simulation(
        falling_mass.run, FallingMass(1.0, GRAVITY, hertz(1e9)), y, 1, 3, limits(budget=2000), 1e-4
    )
    trace = run.advance(11)
    assert trace.status is Status.COMPLETED
    assert trace.outputs.shape[1] == 11
    # it swings about its rest in contact, (m g / K)^(2/3), and at most (5/2)^(2/3) times as deep
    assert np.abs(trace.outputs[0]).max() < 1.01 * 2.5 ** (2 / 3) * (GRAVITY / 1e9) ** (2 / 3)
