"""Cycles of a record: phase and frequency as well as noise lets anyone know them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.rigs.crank_drive import marker_voltage
from sim_twin.rigs.cycles import Cycles, angle_cycles, mark_cycles, sine_cycles

Array = NDArray[np.float64]
RATE, NOMINAL, SECONDS = 25_600.0, 20.0, 2.0
COUNT = round(RATE * SECONDS)
COUNTED = 2 * np.pi / 4096


def turned(angle: Array | float) -> Array:
    """Into half a turn to either side."""
    return np.asarray((np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)


def phases(frequency: float, phase: float, count: int = COUNT) -> Array:
    return np.asarray(phase + 2 * np.pi * frequency / RATE * np.arange(count))


def drive(frequency: float, phase: float, noise: float, seed: int) -> Array:
    p = phases(frequency, phase)
    scatter = noise * np.random.default_rng(seed).standard_normal(COUNT)
    return np.asarray(9 * (np.sin(p) + 0.2 * np.sin(2 * p) + 0.2 * np.sin(3 * p)) + scatter)


def test_a_sine_with_harmonics_is_followed_nearly_as_well_as_can_be() -> None:
    noise, rng = 0.5, np.random.default_rng(1)
    errors = []
    for seed in range(40):
        frequency, phase = NOMINAL * rng.uniform(0.999, 1.001), rng.uniform(0, 2 * np.pi)
        found = sine_cycles(drive(frequency, phase, noise, seed), RATE, NOMINAL)
        errors.append((found.frequency - frequency, float(turned(found.phase - phase))))
    hertz, radian = np.sqrt(np.mean(np.square(errors), axis=0))
    # Cramer and Rao for a sine of unknown level, phase and frequency (Kay, Estimation Theory, 3.41)
    share = (noise / 9) ** 2
    least_hertz = np.sqrt(24 * share / COUNT**3) * RATE / (2 * np.pi)
    least_radian = np.sqrt(8 * share / COUNT)
    # Hann windows over two halves lose a factor of 1.4; 40 cases know their rms to 11 %
    assert hertz < 1.4 * 1.35 * least_hertz
    assert radian < 1.4 * 1.35 * least_radian


def test_without_noise_harmonics_and_offset_do_not_matter() -> None:
    found = sine_cycles(drive(20.013, 4.0, 0.0, 0) + 3.0, RATE, NOMINAL)
    # a Hann window's side lobes at the harmonics of twenty cycles: 1e-5 of a fifth
    assert found.frequency == pytest.approx(20.013, abs=1e-5)
    assert found.phase == pytest.approx(4.0, abs=1e-4)


@pytest.mark.parametrize("phase", [0.0, 0.5 * np.pi, 3.0, 5.5])
def test_phase_is_that_of_the_rising_zero(phase: float) -> None:
    found = sine_cycles(drive(NOMINAL, phase, 0.0, 0), RATE, NOMINAL)
    assert turned(found.phase - phase) == pytest.approx(0.0, abs=1e-4)


def test_a_drive_of_five_minutes_is_followed_within_the_tolerance_of_its_frequency() -> None:
    frequency = NOMINAL * 1.0005  # of 0.1 % that a twin follows
    found = sine_cycles(np.sin(phases(frequency, 1.0, round(300 * RATE))), RATE, NOMINAL)
    assert found.frequency == pytest.approx(frequency, rel=1e-6)


@pytest.mark.parametrize("frequency", [10.0, 19.0, 21.0, 25.0, 40.0])
def test_a_sine_of_another_frequency_is_refused(frequency: float) -> None:
    with pytest.raises(ValueError, match="no sine of that frequency"):
        sine_cycles(drive(frequency, 1.0, 0.1, 3), RATE, NOMINAL)


def test_noise_silence_and_an_offset_are_no_sine() -> None:
    for values in (np.random.default_rng(2).standard_normal(COUNT), np.zeros(COUNT), np.full(COUNT, 4.0)):
        with np.errstate(invalid="ignore"), pytest.raises(ValueError, match="no sine of that frequency"):
            sine_cycles(values, RATE, NOMINAL)


def test_an_encoder_s_cycles_are_known_to_one_count() -> None:
    exact = phases(3.3337, 2.0)
    counted = np.floor(exact / COUNTED) * COUNTED
    found = angle_cycles(counted, RATE, 0.0)
    assert found.phase == pytest.approx(2.0, abs=COUNTED)
    # counts are even over the record; a slope through them is off by a count at its ends at most
    assert found.frequency == pytest.approx(3.3337, abs=COUNTED / (2 * np.pi * SECONDS))
    assert angle_cycles(exact, RATE, 0.0).frequency == pytest.approx(3.3337, rel=1e-9)


def test_a_speed_that_fluctuates_every_revolution_leaves_the_mean_line() -> None:
    angle = phases(4.0, 1.0)
    found = angle_cycles(angle + 0.02 * np.sin(angle), RATE, 0.0)
    # 8 whole revolutions: a sine's projection on a line through them, 6 / (pi 8) of its amplitude
    assert found.phase == pytest.approx(1.0, abs=0.02)
    assert found.frequency == pytest.approx(4.0, rel=1e-3)


def test_marks_tell_where_revolutions_start() -> None:
    angle = phases(3.3337, 2.0)
    volts = marker_voltage(angle) + 0.02 * np.random.default_rng(3).standard_normal(COUNT)
    found = mark_cycles(volts, RATE, 3.3333)
    one_sample = 2 * np.pi * 3.3337 / RATE
    assert turned(found.phase - 2.0) == pytest.approx(0.0, abs=one_sample)
    # a sample at each end of six revolutions
    assert found.frequency == pytest.approx(3.3337, rel=2 / COUNT)


def test_a_lost_mark_does_not_slow_the_flywheel() -> None:
    angle = phases(3.3337, 2.0)
    volts = marker_voltage(angle)
    third = (angle // (2 * np.pi)).astype(int) == 2
    found = mark_cycles(np.where(third, 0.0, volts), RATE, 3.3333)
    assert found.frequency == pytest.approx(3.3337, rel=2 / COUNT)


def test_one_mark_tells_no_speed() -> None:
    with pytest.raises(ValueError, match="no marks"):
        mark_cycles(marker_voltage(phases(0.4, 5.0)), RATE, 0.0)
    with pytest.raises(ValueError, match="no marks"):
        mark_cycles(np.zeros(COUNT), RATE, 0.0)


@pytest.mark.parametrize("phase", [0.0, 1.0, 6.2, -40.0])
def test_starts_are_every_rising_zero_with_a_cycle_and_a_half_behind_it(phase: float) -> None:
    cycles = Cycles(19.97, phase, RATE)
    starts = cycles.starts(COUNT)
    half_a_sample = np.pi * 19.97 / RATE
    assert np.abs(turned(phases(19.97, phase)[starts])).max() < half_a_sample * 1.001
    assert np.all(np.abs(np.diff(starts) - RATE / 19.97) < 1)
    assert starts[0] >= 0
    assert starts[-1] + 1.5 * cycles.length <= COUNT
    # none is left out: 39.94 cycles, less what a cycle and a half need at the end and a part at the start
    assert len(starts) in (38, 39)
    assert cycles.length == 1281


def test_a_record_shorter_than_a_cycle_has_no_starts() -> None:
    assert len(Cycles(20.0, 0.5, RATE).starts(1000)) == 0


def drifting(share: float) -> Array:
    """Angle of a crank at 4 turns a second that gains a share of its speed over the record."""
    times = np.arange(COUNT) / RATE
    return np.asarray(1.0 + 2 * np.pi * 4.0 * times * (1 + 0.5 * share * (times / SECONDS - 1)))


@pytest.mark.parametrize("share", [0.0, 0.03, -0.03])
def test_cycles_of_a_speed_that_drifts_are_cut_where_they_begin(share: float) -> None:
    angle = drifting(share)
    swinging = np.floor((angle + 0.02 * np.sin(angle)) / COUNTED) * COUNTED
    marked = mark_cycles(marker_voltage(angle), RATE, 4.0)
    for found in (angle_cycles(swinging, RATE, 0.0), marked):
        starts = found.starts(COUNT)
        assert len(starts) == len(angle_cycles(angle, RATE, 0.0).starts(COUNT))
        # a straight line is 0.1 rad off at the ends
        assert np.abs(turned(angle[starts])).max() < 0.01
        # beyond the first and the last mark nobody knows
        assert np.abs(turned(found.phases(COUNT) - angle)[6400:-6400]).max() < 0.01
