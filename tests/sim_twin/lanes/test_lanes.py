"""Lanes keep to themselves: company, order and chunks change no bit; statistics are those of single runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.signals.impacts import half_cycles
from sim_twin.effects import BaseMass
from sim_twin.lanes.lanes import Harmonics, Lane, Lanes, Stops
from sim_twin.rigs.impact_beam.lanes import beam_lanes, lane_of
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.status import Status
from sim_twin.twin import Twin
from tests.sim_twin.solver import RATE

STEEL, SINE = nominal(), SineDrive(9.0, 20.0)
STEPS = 4096


def variants(count: int) -> list[Twin]:
    """Twins of every kind that the kernel tells apart, all different."""
    rng = np.random.default_rng(5)
    kinds: list[dict[str, object]] = [
        {},
        {"hertz": 1e10},
        {"pivot_friction": 0.05},
        {"base": BaseMass(400.0, 2.0, 0.01)},
        {"shaker_stiffness": 3e3, "shaker_damping": 20.0},
    ]
    return [
        Twin(
            replace(STEEL, clearance=rng.uniform(1e-4, 2e-4), **kinds[k % len(kinds)]),  # type: ignore[arg-type]
            replace(SINE, second=0.1 * (k % 2)),
        )
        for k in range(count)
    ]


def test_company_changes_no_bit() -> None:
    twins = variants(45)
    together = beam_lanes(twins, RATE).advance(STEPS)
    assert np.abs(together).max(axis=(1, 2)).min() > 1.0
    for k in (0, 1, 2, 3, 4, 17, 44):
        alone = beam_lanes([twins[k]], RATE).advance(STEPS)
        assert np.array_equal(alone[0], together[k])


def test_order_changes_no_bit() -> None:
    twins = variants(45)
    order = np.random.default_rng(1).permutation(45)
    together = beam_lanes(twins, RATE).advance(STEPS)
    shuffled = beam_lanes([twins[k] for k in order], RATE).advance(STEPS)
    assert np.array_equal(shuffled, together[order])


@pytest.mark.parametrize("chunks", [[1] * 20 + [300], [7, 64, 249], [31, 33, 256]])
def test_the_size_of_the_chunks_changes_no_bit(chunks: list[int]) -> None:
    twins = variants(11)
    whole = beam_lanes(twins, RATE / 4).advance(sum(chunks))
    lanes = beam_lanes(twins, RATE / 4)
    parts = [lanes.advance(count) for count in chunks]
    assert np.abs(whole[:, :, 310:]).max() > 1.0
    assert np.array_equal(np.concatenate(parts, axis=2), whole)


def test_recording_accelerations_changes_no_force() -> None:
    twins = [Twin(replace(each.rig, stations=(50,)), each.drive) for each in variants(10)]
    plain = beam_lanes(twins, RATE).advance(STEPS)
    assert np.array_equal(beam_lanes(twins, RATE, accelerations=True).advance(STEPS)[:, 0], plain[:, 0])


@pytest.mark.parametrize(("frequency", "first", "largest"), [(5, 23.07, 29.51), (20, 34.86, 39.57)])
def test_means_over_half_cycles(frequency: float, first: float, largest: float) -> None:
    phases = np.random.default_rng(2).uniform(0, 2 * np.pi, 32)
    lanes = beam_lanes([Twin(STEEL, SineDrive(9.0, frequency))] * 32, RATE, list(phases))
    lanes.advance(round(RATE))
    force = lanes.advance(round(40 / 2 / frequency * RATE))[:, 0]
    cycles = [half_cycles(np.maximum(each, 0), np.maximum(-each, 0), RATE) for each in force]
    # 1,200 half cycles: standard errors of 0.6 % at most, and the table's 0.5 %.
    assert sum(len(each) for each in cycles) > 1100
    assert np.concatenate([each.first_n for each in cycles]).mean() == pytest.approx(first, rel=0.025)
    assert np.concatenate([each.max_n for each in cycles]).mean() == pytest.approx(largest, rel=0.025)


def oscillator(damping: float, start: list[float]) -> Lane:
    """A mass of 1 kg on 1e4 N/m between far stops, without a drive."""
    one = np.ones(1)
    K, C = np.array([[1e4]]), np.array([[damping]])
    still = Harmonics(np.zeros(2, complex), 1.0)
    return Lane(K, C, one, one, 0 * one, Stops(1e7, 0.0, 0.01), still, start=np.array(start))


def test_a_bouncing_mass_keeps_its_energy() -> None:
    lanes = Lanes([oscillator(0.0, [0.0, 2.0])], 1e-6)
    force = lanes.advance(400_000)[0, 0]
    peaks = half_cycles(np.maximum(force, 0), np.maximum(-force, 0), 1e6).max_n
    assert len(peaks) > 20
    # The greatest depth d is where all of 2 J is in both springs: 1e4 (0.01 + d)^2 + 1e7 d^2 = 4.
    deepest = max(np.roots([1e7 + 1e4, 2e4 * 0.01, 1e4 * 0.01**2 - 4]))
    # 17 steps from onset to the peak: what they lose or gain at 35 stops does not add up to more than this.
    assert peaks == pytest.approx(np.full(len(peaks), 1e7 * deepest), rel=1e-4)


def test_a_lane_that_diverges_says_so_and_leaves_the_others_alone() -> None:
    good, bad = oscillator(0.0, [0.0, 2.0]), oscillator(-2000.0, [1e-3, 0.0])
    lanes, alone = Lanes([good, bad, good], 1e-5), Lanes([good], 1e-5)
    assert lanes.statuses == (Status.COMPLETED,) * 3
    for _ in range(3):
        force, expected = lanes.advance(2000), alone.advance(2000)
    assert lanes.statuses == (Status.COMPLETED, Status.DIVERGED, Status.COMPLETED)
    assert np.isnan(force[1]).all()
    assert np.array_equal(force[[0, 2]], expected[[0, 0]])


def test_a_lane_that_diverges_within_one_long_call_says_so() -> None:
    good, bad = oscillator(0.0, [0.0, 2.0]), oscillator(-2000.0, [1e-3, 0.0])
    lanes = Lanes([good, bad], 1e-5)
    force = lanes.advance(409_600)
    assert lanes.statuses == (Status.COMPLETED, Status.DIVERGED)
    assert np.isnan(force[1]).all()


def test_a_drive_that_is_no_number_does_not_fade_to_rest() -> None:
    good = oscillator(0.0, [0.0, 2.0])
    bad = replace(good, harmonics=Harmonics(np.array([0, np.nan], complex), 1.0))
    lanes = Lanes([bad, good], 1e-5)
    force = lanes.advance(STEPS)
    assert lanes.statuses == (Status.DIVERGED, Status.COMPLETED)
    assert np.isnan(force[0]).all()


def test_a_mode_that_the_gap_does_not_show_is_recorded_all_the_same() -> None:
    K, C = np.diag([1e4, 4e4]), np.zeros((2, 2))
    seen, hidden = np.eye(2)
    still = Harmonics(np.zeros(2, complex), 1.0)
    start = np.array([0.0, 1e-3, 0.0, 0.0])
    lane = Lane(K, C, seen, seen, 0 * seen, Stops(1e7, 0.0, 0.1), still, 0.0, hidden[None, :], start)
    _, acceleration = Lanes([lane], 1e-4).advance(1000)[0]
    exact = -4e4 * 1e-3 * np.cos(200.0 * 1e-4 * np.arange(1000))
    assert acceleration == pytest.approx(exact, abs=1e-9 * 40)


def test_a_drive_keeps_its_amplitude_over_many_cycles() -> None:
    twin = Twin(replace(STEEL, clearance=1.0, stations=(100,)), SINE)
    lanes = beam_lanes([twin], RATE / 16, accelerations=True)
    lanes.advance(round(70 * RATE / 16))  # the pendulum's start, at 0.05 1/s, has died out to 3 %
    lanes.advance(round(130 * RATE / 16))
    _, _, tip = lanes.advance(round(RATE / 16))[0]
    K, C = lane_of(twin).K, lane_of(twin).C
    omega, lane = 2 * np.pi * 20.0, lane_of(twin, accelerations=True)
    assert lane.accelerations is not None
    answer = np.linalg.solve(K - omega**2 * np.eye(len(K)) + 1j * omega * C, lane.drive)
    amplitude = 9.0 * omega**2 * abs(lane.accelerations[1] @ answer)
    # Over 200 s the pendulum has died to 5e-5 of its start.
    assert np.std(tip) * np.sqrt(2) == pytest.approx(amplitude, rel=1e-4)


def test_a_critically_damped_mode_whose_two_rates_coincide() -> None:
    # C = 2 sqrt(K): the matrix of the motion has one eigenvector only.
    start, omega = 1e-3, 100.0
    still = Harmonics(np.zeros(2, complex), 1.0)
    one = np.ones(1)
    K, C = np.array([[omega**2]]), np.array([[2 * omega]])
    stops, begin = Stops(1e7, 0.0, 0.1), np.array([start, 0.0])
    lane = Lane(K, C, one, one, 0 * one, stops, still, 0.0, np.eye(1), begin)
    _, acceleration = Lanes([lane], 1e-4).advance(1000)[0]
    t = 1e-4 * np.arange(1000)
    exact = start * omega**2 * (omega * t - 1) * np.exp(-omega * t)
    # The damping is moved by 1e-7 of itself to tell the two rates apart.
    assert acceleration == pytest.approx(exact, abs=1e-5 * np.abs(exact).max())
