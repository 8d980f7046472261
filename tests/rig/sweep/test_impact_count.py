"""A record ends with its fifteenth impact: no bounce, noise or faint touch counts as one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import SampleBlock
from rig.stream import Block
from rig.sweep.execute import ImpactCount

RATE = 51_200.0
CYCLE_S = 0.05
UPPER, LOWER = "contact.force_upper", "contact.force_lower"
BOUNCES = ((0.0, 1.0), (0.003, 0.6), (0.006, 0.3))
"""Seconds after the first touch, and share of its peak."""


def forces(
    peaks: list[float], bounces: tuple[tuple[float, float], ...] = BOUNCES
) -> dict[str, NDArray[np.float32]]:
    """An impact every half cycle, upper side first, with these largest peaks; noise of 0.05 N."""
    rng = np.random.default_rng(4)
    count = round((len(peaks) + 1) * CYCLE_S / 2 * RATE)
    found = {name: 0.05 * rng.standard_normal(count) for name in (UPPER, LOWER)}
    pulse = np.sin(np.linspace(0, np.pi, 26))  # half a millisecond
    for number, peak in enumerate(peaks):
        for after_s, share in bounces:
            first = round((number * CYCLE_S / 2 + 0.002 + after_s) * RATE)
            found[(UPPER, LOWER)[number % 2]][first : first + len(pulse)] += share * peak * pulse
    return {name: values.astype(np.float32) for name, values in found.items()}


def take(count: ImpactCount, values: dict[str, NDArray[np.float32]]) -> bool:
    """Whether there are enough after the next samples of each channel."""
    for name, row in values.items():
        count(Block("measured", SampleBlock(name, 0, 0, RATE, row)))
    return count.enough()


def ends_at(count: ImpactCount, record: dict[str, NDArray[np.float32]], block: int) -> int | None:
    """The sample at whose block's end there were enough; None if never."""
    length = len(record[UPPER])
    for first in range(0, length, block):
        if take(count, {name: values[first : first + block] for name, values in record.items()}):
            return min(first + block, length)
    return None


@pytest.mark.parametrize("block", [512, 5120, 1_000_000])
def test_the_fifteenth_impact_ends_the_record_whatever_the_blocks(block: int) -> None:
    record = forces([30.0] * 40)
    count = ImpactCount((UPPER, LOWER), 15, RATE, CYCLE_S)
    end = ends_at(count, record, block)
    assert end is not None
    if block < len(record[UPPER]):
        # the 15th begins at 14 half cycles, its last bounce ends 6.5 ms later, then 12.5 ms without one
        over = (14 * CYCLE_S / 2 + 0.002 + 0.0065 + CYCLE_S / 4) * RATE
        assert over <= end <= over + block + 2
        # at 15 or 16: the next half cycle's may be over within the same block
        assert 15 <= count.count <= 15 + block / (CYCLE_S / 2 * RATE) + 1


def test_one_side_alone_counts_its_own() -> None:
    count = ImpactCount((UPPER,), 100, RATE, CYCLE_S)
    assert ends_at(count, forces([30.0] * 20), 5120) is None
    assert count.count == 10


def test_what_is_under_a_tenth_of_the_largest_is_no_impact_even_if_it_came_first() -> None:
    count = ImpactCount((UPPER, LOWER), 100, RATE, CYCLE_S)
    ends_at(count, forces([2.0, 2.0, 30.0, 30.0, 30.0, 2.0, 30.0], bounces=((0.0, 1.0),)), 512)
    assert count.count == 4


@pytest.mark.parametrize(("above", "expected"), [(5.0, 3), (25.0, 2), (60.0, 0)])
def test_a_given_level_is_what_counts(above: float, expected: int) -> None:
    count = ImpactCount((UPPER, LOWER), 100, RATE, CYCLE_S, above)
    ends_at(count, forces([2.0, 30.0, 10.0, 50.0, 4.0]), 512)
    assert count.count == expected


def test_noise_holds_no_impact() -> None:
    """A minute of it: ten times its rms is passed once in 1e23 samples."""
    count = ImpactCount((UPPER,), 1, RATE, CYCLE_S)
    rng = np.random.default_rng(8)
    for _ in range(60):
        assert not take(count, {UPPER: (0.05 * rng.standard_normal(51_200)).astype(np.float32)})
