"""Crank angle and speed from encoder and marker; the truth is known because it is made here."""

from __future__ import annotations

import numpy as np
import pytest

from rig.twin.alignment import align_angle, align_marker
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after

RATE, COUNTS = 25_600.0, 4096
COUNT = 2 * np.pi / COUNTS


NOMINAL = SpeedDrive(200 * 2 * np.pi / 60)


def angle(phase: float, factor: float, samples: np.ndarray, fluctuation: float = 0.0) -> np.ndarray:
    turned = phase + NOMINAL.mean_speed * factor * samples / RATE
    return turned + fluctuation * np.sin(turned)


def encoder(true: np.ndarray) -> np.ndarray:
    return np.floor(true / COUNT) * COUNT


def marker(true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return 5.0 * (np.degrees(true) % 360 < 5) + 0.02 * rng.standard_normal(len(true))


@pytest.mark.parametrize("first", [0, -30_000, 100_000])
@pytest.mark.parametrize("factor", [1.0, 1.0004, 0.9992])
def test_encoder_gives_angle_and_speed(first: int, factor: float) -> None:
    samples = first + np.arange(round(2 * RATE))
    found = align_angle(encoder(angle(1.234, factor, samples)), RATE, first, NOMINAL)
    assert found.trusted
    assert found.onset is None
    assert found.frequency == pytest.approx(NOMINAL.mean_speed * factor / (2 * np.pi), rel=1e-6)
    assert found.phase == pytest.approx(1.234, abs=0.1 * COUNT)


def test_marker_gives_the_same() -> None:
    rng, samples = np.random.default_rng(4), np.arange(round(2 * RATE))
    found = align_marker(marker(angle(1.234, 1.0003, samples), rng), RATE, 0, NOMINAL)
    assert found.trusted
    # a mark is seen to a fraction of a sample: 0.8 mrad of crank angle
    assert found.frequency == pytest.approx(NOMINAL.mean_speed * 1.0003 / (2 * np.pi), rel=1e-5)
    assert found.phase == pytest.approx(1.234, abs=8e-4)


def test_a_speed_that_fluctuates_within_a_turn_is_taken_as_its_mean() -> None:
    samples = np.arange(round(3.0 * RATE))  # ten whole turns
    found = align_angle(encoder(angle(0.5, 1.0, samples, fluctuation=0.03)), RATE, 0, NOMINAL)
    assert found.frequency == pytest.approx(NOMINAL.mean_speed / (2 * np.pi), rel=2e-4)
    assert found.phase == pytest.approx(0.5, abs=0.03)


def test_a_speed_far_from_the_scenarios_is_not_followed() -> None:
    samples = np.arange(round(RATE))
    found = align_angle(encoder(angle(0.5, 1.02, samples)), RATE, 0, NOMINAL)
    assert not found.trusted
    assert found.frequency == pytest.approx(NOMINAL.mean_speed * 1.001 / (2 * np.pi), rel=1e-12)


def test_a_crank_that_stands_still_is_not_believed() -> None:
    still = align_angle(np.full(1000, 0.7), RATE, 0, NOMINAL)
    silent = align_marker(0.02 * np.random.default_rng(1).standard_normal(1000), RATE, 0, NOMINAL)
    for found in (still, silent):
        assert not found.trusted
        assert found.frequency == pytest.approx(NOMINAL.mean_speed / (2 * np.pi))


def test_samples_that_are_missing_do_not_count() -> None:
    samples = np.arange(round(RATE))
    seen = encoder(angle(0.9, 1.0, samples))
    seen[1000:2000] = np.nan
    assert align_angle(seen, RATE, 0, NOMINAL).phase == pytest.approx(0.9, abs=0.1 * COUNT)


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("phase", [0.0, 2.0])
def test_a_twin_that_fluctuates_like_its_rig_turns_with_it(order: int, phase: float) -> None:
    true = SpeedDrive(NOMINAL.mean_speed, 0.05, order, phase)
    start = 0.7
    samples = np.arange(round(3.0 * RATE))
    angles = np.array([angle_after(true, start, k / RATE) for k in samples])
    twin = SpeedDrive(NOMINAL.mean_speed * (1 + 2e-4), 0.05, order, phase)  # as far off as a healthy rig is
    alignment = align_angle(encoder(angles), RATE, 0, twin)
    drive = twin.at_cycle_hz(alignment.frequency)
    predicted = np.array(
        [drive.phase_after(alignment.phase, alignment.frequency, k / RATE) for k in samples[::5000]]
    )
    assert alignment.trusted
    # a tenth of the swing of 0.05 rad, which a line fitted over ten turns cannot quite tell from its slope
    assert predicted == pytest.approx(angles[::5000], abs=5e-3)
