"""A drive is followed for any length of time, whatever its clock does and however its samples are cut."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest

from daq.angle.cycles import DriveCycles

RATE, HZ = 5120.0, 20.0


def drive(seconds: float, hz: float, phase: float = 0.0, noise: float = 0.002) -> np.ndarray:
    times = np.arange(round(seconds * RATE)) / RATE
    random = np.random.default_rng(3)
    return (
        9.0 * np.sin(2 * np.pi * hz * times + phase) + random.normal(scale=9 * noise, size=len(times))
    ).astype(np.float32)


def followed(values: np.ndarray, cuts: Iterable[int], hz: float = HZ, phase: float = 0.0) -> DriveCycles:
    cycles = DriveCycles(RATE, hz, phase)
    for first, end in pairwise([0, *cuts, len(values)]):
        cycles.add(first, values[first:end])
    return cycles


def begins_of(cycles: DriveCycles, end: int) -> tuple[list[int], list[int]]:
    found = cycles.begins.between(0, end)
    return found.offset.tolist(), found.number


def test_cycles_begin_at_the_rising_zeros_of_the_sine() -> None:
    cycles = followed(drive(3.0, HZ, 1.0), [], phase=1.0)
    samples, numbers = begins_of(cycles, 3 * int(RATE))
    expected = np.ceil((np.arange(1, 61) - 1.0 / (2 * np.pi)) * RATE / HZ)
    assert samples == expected.astype(int).tolist()
    assert numbers == list(range(1, 61))


def test_a_drive_that_starts_in_phase_has_its_first_cycle_at_sample_0() -> None:
    samples, numbers = begins_of(followed(drive(1.0, HZ), []), 1024)
    assert (samples[0], numbers[0]) == (0, 0)


def test_a_clock_that_is_off_adds_up_to_nothing() -> None:
    seconds, off = 60.0, 50e-6  # 50 ppm off for a minute is 0.06 of a cycle without following
    cycles = followed(drive(seconds, HZ * (1 + off)), [])
    last = int(seconds * RATE) - 1
    truth = last / RATE * HZ * (1 + off)
    # The phase is from the middle of the second but one before: 2.5 s of 50 ppm of 20 Hz are 0.0025.
    assert cycles.turns_at(last) == pytest.approx(truth, abs=0.003)
    assert abs(last / RATE * HZ - truth) > 0.05


def test_cuts_leave_no_trace() -> None:
    values = drive(8.0, HZ * 1.0001)
    whole = followed(values, [])
    cut = followed(values, range(777, len(values), 777))
    assert begins_of(cut, len(values)) == begins_of(whole, len(values))
    assert [cut.turns_at(at) for at in range(0, len(values), 99)] == [
        whole.turns_at(at) for at in range(0, len(values), 99)
    ]


def test_begins_are_known_a_second_ahead_and_to_the_end_after_it() -> None:
    values = drive(2.5, HZ)
    cycles = followed(values, [])
    assert cycles.begins.until >= len(values)
    cycles.finish()
    assert cycles.begins.until > 1 << 60


def test_a_gap_or_a_drive_that_is_off_leaves_the_phase_as_it_was() -> None:
    values = drive(6.0, HZ)
    values[: 2 * int(RATE)] = 0.0
    cycles = DriveCycles(RATE, HZ, 0.0)
    cycles.add(0, values[: int(3.2 * RATE)])
    cycles.add(int(3.4 * RATE), values[int(3.4 * RATE) :])
    samples, numbers = begins_of(cycles, len(values))
    # Where a rising zero lies on a sample, noise makes it that one or the next.
    assert np.abs(np.array(samples) - np.arange(120) * RATE / HZ).max() <= 1
    assert numbers == list(range(120))
