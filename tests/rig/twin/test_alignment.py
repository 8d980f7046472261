"""Phase and frequency of the drive, and nothing else of it, from a measurement that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.files.scenario import parse_scenario
from rig.twin.alignment import align, force_shown
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.model import SineDrive
from tests.sim_twin.impact_beam.test_stinger_gauge import moved

RATE = 51_200.0
DRIVE = SineDrive(9.0, 20.0)
NOISE_N = 0.02


def sine(frequency: float, phase: float, seconds: float = 1.0, amplitude: float = 9.0) -> NDArray[np.float64]:
    times = np.arange(round(seconds * RATE)) / RATE
    noise = np.random.default_rng(2).normal(scale=NOISE_N, size=len(times))
    return amplitude * np.sin(2 * np.pi * frequency * times + phase) + noise


def difference(one: float, other: float) -> float:
    return (one - other + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize("phase", [0.0, 0.04, 1.0, 3.0, 6.2])
@pytest.mark.parametrize("frequency", [20.0, 20.004, 19.992])
def test_phase_and_frequency_of_a_running_drive(phase: float, frequency: float) -> None:
    found = align(sine(frequency, phase), RATE, 0, DRIVE)
    assert found.trusted
    assert found.onset is None
    # 0.02 N of noise on 9 N over 51 200 samples: 3e-5 rad and 2e-5 Hz; five sigma and rounding.
    assert found.frequency == pytest.approx(frequency, abs=2e-4)
    assert difference(found.phase, phase) == pytest.approx(0.0, abs=5e-4)


def test_phase_is_that_of_sample_0_of_the_run() -> None:
    first = -12_345
    found = align(sine(20.0, 1.0), RATE, first, DRIVE)
    at_sample_0 = 1.0 - 2 * np.pi * 20.0 * first / RATE
    assert difference(found.phase, at_sample_0) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("real", "taken"), [(20.1, 20.02), (19.5, 19.98)])
def test_frequency_is_followed_by_a_tenth_of_a_percent_only(real: float, taken: float) -> None:
    assert align(sine(real, 0.3), RATE, 0, DRIVE).frequency == pytest.approx(taken, rel=1e-12)


def test_amplitude_and_distortion_do_not_reach_the_twin() -> None:
    times = np.arange(round(RATE)) / RATE
    plain = align(sine(20.0, 0.5), RATE, 0, DRIVE)
    distorted = sine(20.0, 0.5, amplitude=7.0) + 1.4 * np.sin(2 * (2 * np.pi * 20 * times + 0.5))
    found = align(distorted, RATE, 0, DRIVE)
    # A fifth of a second harmonic pulls the frequency's estimate a little: half a degree over a second.
    assert difference(found.phase, plain.phase) == pytest.approx(0.0, abs=0.015)
    assert found.onset is None


@pytest.mark.parametrize("frequency", [1.0, 2.0, 5.0, 20.0, 200.0])
@pytest.mark.parametrize("silent", [2560, 4000])  # a run from rest records 0.05 s of rest, or more
def test_a_drive_that_begins_within_the_record_has_an_onset(frequency: float, silent: int) -> None:
    drive = SineDrive(9.0, frequency)
    rest = np.random.default_rng(3).normal(scale=NOISE_N, size=silent)
    found = align(np.concatenate([rest, sine(frequency, 0.0, 2.0)]), RATE, 0, drive)
    assert found.onset == pytest.approx(silent, abs=0.5 + 1e-4 * RATE / frequency)


def test_an_onset_counts_from_sample_0_of_the_run() -> None:
    force = np.concatenate([np.zeros(2560), sine(20.0, 0.0)])
    found = align(force, RATE, 5120, DRIVE)
    assert found.onset == pytest.approx(5120 + 2560, abs=1)


@pytest.mark.parametrize(
    "force", [np.zeros(51_200), np.zeros(0), np.full(51_200, np.nan), sine(20.0, 0.0, amplitude=4.0)]
)
def test_without_a_usable_drive_the_scenario_stands(force: NDArray[np.float64]) -> None:
    found = align(force, RATE, 0, DRIVE)
    assert not found.trusted
    assert (found.frequency, found.phase, found.onset) == (20.0, 0.0, None)


def test_an_offset_is_no_phase() -> None:
    drive = SineDrive(9.0, 20.0, offset=3.0)
    found = align(sine(20.0, 1.0) + 3.0, RATE, 0, drive)
    assert difference(found.phase, 1.0) == pytest.approx(0.0, abs=5e-4)


@pytest.mark.long
@pytest.mark.parametrize(("frequency", "offset", "seconds"), [(20.0, 9e-4, 60.0), (200.0, -9e-4, 20.0)])
def test_a_long_record_is_followed_within_the_whole_tolerance(
    frequency: float, offset: float, seconds: float
) -> None:
    # Fitted in one go it would start a cycle and more from the truth and end in a wrong minimum.
    true = frequency * (1 + offset)
    found = align(sine(true, 1.0, seconds), RATE, 0, SineDrive(9.0, frequency))
    assert found.frequency == pytest.approx(true, rel=1e-7)
    assert difference(found.phase, 1.0) == pytest.approx(0.0, abs=5e-4)


GAUGED = """
name = "gauged"
rig = "impact_beam"
[model]
clearance = "{clearance}"
shaker_mass = "80 g"
shaker_stiffness = "3 kN/m"
shaker_damping = "25 N s/m"
[drive]
frequency = "20 Hz"
amplitude = "4 N"
[acquisition]
sample_rate = "51.2 kHz"
duration = "1 s"
"""


def test_what_a_gauge_in_the_stinger_shows_of_an_order() -> None:
    free = twin_of(parse_scenario(GAUGED.format(clearance="10 mm")), ["drive.force"])
    assert [force_shown(free, 12.0)(force) for force in (0.0, 3.0)] == [0.0, 3.0]  # the coil's own
    gauge = replace(free, rig=replace(free.rig, stinger_gauge=True))
    bare = replace(free.rig, shaker_mass=0.0, shaker_stiffness=0.0, shaker_damping=0.0)
    share = abs(moved(free.rig, 20.0) / moved(bare, 20.0))
    assert share < 0.9
    shown = force_shown(gauge, 12.0)
    assert [shown(force) / force for force in (0.25, 0.5)] == pytest.approx([share] * 2, rel=0.03)
    # where the stops hold the beam, hardly anything is left for what moves with the coil
    tight = twin_of(parse_scenario(GAUGED.format(clearance="0.127 mm")), ["drive.force"])
    held = force_shown(replace(tight, rig=replace(tight.rig, stinger_gauge=True)), 12.0)
    assert held(4.0) / 4.0 > 0.9
