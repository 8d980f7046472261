"""A record ends with its fifteenth impact: no bounce, noise or faint touch counts as one."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import SampleBlock
from rig.derived.derivation import Derivation
from rig.files.scenario import parse_scenario
from rig.stream import Block
from rig.sweep.execute import ImpactCount
from tests.rig.derived.spatial_run import SOCKET, SPATIAL, spatial_blocks
from tests.rig.session.fakes import Kept

RATE = 51_200.0
HERTZ = 20.0
CYCLE_S = 1 / HERTZ
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


def take(count: ImpactCount, first: int, values: dict[str, NDArray[np.float32]]) -> bool:
    """Whether there are enough after the next samples of each channel, from the `first` on."""
    for name, row in values.items():
        count(Block("measured", SampleBlock(name, first, 0, RATE, row)))
    return count.enough()


def ends_at(count: ImpactCount, record: dict[str, NDArray[np.float32]], block: int) -> int | None:
    """The sample at whose block's end there were enough; None if never."""
    length = len(record[UPPER])
    for first in range(0, length, block):
        if take(count, first, {name: values[first : first + block] for name, values in record.items()}):
            return min(first + block, length)
    return None


@pytest.mark.parametrize("block", [512, 5120, 1_000_000])
def test_the_fifteenth_impact_ends_the_record_whatever_the_blocks(block: int) -> None:
    record = forces([30.0] * 40)
    count = ImpactCount((UPPER, LOWER), 15, HERTZ)
    end = ends_at(count, record, block)
    assert end is not None
    if block < len(record[UPPER]):
        # the 15th begins at 14 half cycles, its last bounce ends 6.5 ms later, then 12.5 ms without one
        over = (14 * CYCLE_S / 2 + 0.002 + 0.0065 + CYCLE_S / 4) * RATE
        assert over <= end <= over + block + 2
        # at 15 or 16: the next half cycle's may be over within the same block
        assert 15 <= count.count <= 15 + block / (CYCLE_S / 2 * RATE) + 1


def test_what_it_counts_with_is_loaded_before_the_first_reading() -> None:
    """In the acquisition's thread that takes most of a second, in which no reading is fetched."""
    code = (
        "from daq.signals import running_figures\n"
        "from rig.sweep.execute import ImpactCount\n"
        "ImpactCount(('contact.force_upper',), 15, 20.0)\n"
        "assert running_figures._scan.signatures"
    )
    subprocess.run([sys.executable, "-c", code], check=True)  # noqa: S603 - our own


def test_one_side_alone_counts_its_own() -> None:
    count = ImpactCount((UPPER,), 100, HERTZ)
    assert ends_at(count, forces([30.0] * 20), 5120) is None
    assert count.count == 10


def test_what_is_faint_beside_the_others_is_no_impact_even_if_it_came_first() -> None:
    count = ImpactCount((UPPER, LOWER), 100, HERTZ)
    peaks = [2.0, 2.0, *[30.0] * 5, 2.0, 30.0, 30.0]
    ends_at(count, forces(peaks, bounces=((0.0, 1.0),)), 512)
    assert count.count == 7


@pytest.mark.parametrize(("above", "expected"), [(5.0, 3), (25.0, 2), (60.0, 0)])
def test_a_given_level_is_what_counts(above: float, expected: int) -> None:
    count = ImpactCount((UPPER, LOWER), 100, HERTZ, above)
    ends_at(count, forces([2.0, 30.0, 10.0, 50.0, 4.0]), 512)
    assert count.count == expected


def test_noise_holds_no_impact() -> None:
    """A minute of it: ten times its rms is passed once in 1e23 samples."""
    count = ImpactCount((UPPER,), 1, HERTZ)
    rng = np.random.default_rng(8)
    for second in range(60):
        assert not take(
            count, 51_200 * second, {UPPER: (0.05 * rng.standard_normal(51_200)).astype(np.float32)}
        )


def test_a_preloaded_joint_is_counted_as_in_its_log() -> None:
    scenario, blocks, kept = parse_scenario(SPATIAL), spatial_blocks(), Kept()
    derivation = Derivation(kept, {"measured": tuple(blocks[0])}, scenario)
    count = ImpactCount((SOCKET,), 10, scenario.drive.cycle_hz)
    ended = None
    for number, together in enumerate(blocks):
        for block in together.values():
            derivation(Block("measured", block))
            count(Block("measured", block))
        if ended is None and count.enough():
            ended = number
    derivation.finish()
    in_log = Counter(each.channel for each in kept.impacts)[SOCKET]
    assert in_log - 1 <= count.count <= in_log  # of the last one a bounce might still have come
    # some 7 a revolution of a quarter of a second: three revolutions, which the rule takes, hold the tenth
    assert ended is not None
    assert 0.75 < (ended + 1) * 0.1 < 0.95
