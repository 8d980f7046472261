"""What the figures measure, on signals whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from rig.reproduce.beam_runs import RATE, Forces, beam, first_peaks, forces
from rig.reproduce.figures.ibs_base import remaining
from rig.reproduce.figures.ibs_rigid import history, resting_force
from rig.reproduce.figures.psc import repeating
from rig.reproduce.figures.ssc import RATE as SPATIAL_RATE
from rig.reproduce.figures.ssc import VERTICAL, Turns
from sim_twin.rigs.impact_beam.model import SineDrive


def pulses(length: int, *contacts: tuple[float, float], rate: float = RATE) -> np.ndarray:
    """A force of 10 N between times in s."""
    force = np.zeros(length)
    for begin, end in contacts:
        force[round(begin * rate) : round(end * rate)] = 10.0
    return force


def test_the_history_of_a_half_cycle() -> None:
    cycle = pulses(round(RATE / 5), (0.007, 0.0075), (0.012, 0.013), (0.021, 0.090), (0.095, 0.0985))
    times = history(np.tile(cycle, 3))
    assert len(times.touch_s) == 3
    one_sample = 1 / RATE
    assert times.touch_s == pytest.approx(0.007, abs=one_sample)
    assert times.steady_s == pytest.approx(0.021, abs=one_sample)  # the one at 95 ms is no bouncing any more
    assert times.release_s == pytest.approx(0.0985, abs=one_sample)


def test_the_resting_force_is_that_of_a_lever() -> None:
    # Moments about the pivot: the drive at 0.69 L against the stop at L and the flexure, which turns by g/L.
    # The beam's own bending turns the flexure by some 5e-4 rad more, which is 3e-4 N at the stop.
    rig = beam()
    flexure = rig.rotation_stiffness * rig.clearance / rig.beam.length**2
    assert resting_force(rig, 9.0) == pytest.approx(0.69 * 9.0 - flexure, abs=1e-3)


@pytest.mark.parametrize(
    ("clearance_mm", "frequency", "peak_n"),
    [(0.127, 5.0, 18.381), (0.508, 5.0, 45.716), (0.254, 20.0, 45.255)],
)
def test_runs_from_rest_have_the_reference_first_peak(
    clearance_mm: float, frequency: float, peak_n: float
) -> None:
    # The first contact of these cases begins between 5.6 and 11.2 ms and is the only one within 0.15 ms.
    contact = {18.381: 7.0409e-3, 45.716: 11.1582e-3, 45.255: 5.6468e-3}[peak_n]
    run = forces(beam(clearance_mm), SineDrive(9.0, frequency), contact + 0.15e-3, settle=0.0)
    # The peak lies between samples 4.9 us apart: at most 0.3 % are missed.
    assert run.upper.max() == pytest.approx(peak_n, rel=0.005)


def test_the_mean_first_peak_is_the_reference_one() -> None:
    peaks = first_peaks(beam(), 5.0, 20.0)
    # 23.07 N has a standard error of 0.05 N (1 200 half cycles with 1.6 N); peaks are missed by up to 0.3 %.
    assert peaks.mean == pytest.approx(23.07, abs=4 * float(np.hypot(peaks.error, 0.05)) + 0.003 * 23)


@pytest.mark.parametrize(("decay", "remains"), [(0.0, 1.0), (100.0, np.exp(-100 * (25e-3 - 2.5e-3)))])
def test_what_remains_of_a_base_vibration(decay: float, remains: float) -> None:
    period, cycles = 0.025, 8
    samples = round(period * RATE)
    force = pulses(samples, (0.0, 0.001))
    silent = np.zeros(samples)
    t = np.arange(samples) / RATE
    base = np.exp(-decay * t) * np.sin(2 * np.pi * 800 * t)
    lead = np.zeros(round(0.002 * RATE))
    run = Forces(
        np.concatenate([lead, *([force, silent] * cycles)]),
        np.concatenate([lead, *([silent, force] * cycles)]),
        np.concatenate([lead, *([base] * 2 * cycles)]),
    )
    # Two whole periods of 800 Hz in a window. Where in a period it begins matters by decay / omega, 2 %.
    assert remaining(run).mean == pytest.approx(remains, rel=0.02)


def test_the_share_that_repeats() -> None:
    rng = np.random.default_rng(3)
    same = np.tile(rng.normal(size=4000), (20, 1))
    noise = rng.normal(size=(20, 4000))
    assert repeating(same) == pytest.approx(100.0)
    # The mean of 20 x 4000 squares is good to 0.5 %.
    assert repeating(noise) == pytest.approx(0.0, abs=1.0)
    assert repeating(same + noise) == pytest.approx(50.0, abs=3.0)


def test_an_impact_needs_a_millisecond_of_flight() -> None:
    samples = round(0.2 * SPATIAL_RATE)
    turn = pulses(samples, (0.01, 0.02), (0.0205, 0.03), (0.05, 0.06), rate=SPATIAL_RATE)
    turns = Turns(np.tile(turn, (len(VERTICAL), 10)), samples)
    assert turns.count == 10
    # Two of the three contacts a turn; before the very first one nothing is known.
    assert turns.impacts() == pytest.approx((2 * 10 - 1) / 10)
    assert turns.peaks(0) == pytest.approx(10.0)
