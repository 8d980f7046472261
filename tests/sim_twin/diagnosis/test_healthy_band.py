"""A run judged by a band of healthy rigs whose distribution is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.fingerprint import SLICES, Layout, of_cycles
from sim_twin.diagnosis.healthy_band import HealthyBand, healthy_band

CHANNELS = ("left", "right")
LAYOUT = Layout(
    tuple(
        of_cycles(0, channel, "energy", band=(100.0 * k, 100.0 * (k + 1)))
        for channel in CHANNELS
        for k in range(20)
    )
)
RIGS, BLOCKS = 48, 2


def rig(rng: np.random.Generator) -> NDArray[np.float64]:
    """Each number scatters by 1 from rig to rig and by 0.5 from block to block."""
    return 5.0 + rng.normal(size=LAYOUT.size) + 0.5 * rng.normal(size=(BLOCKS, LAYOUT.size))


@pytest.fixture(scope="module")
def band() -> HealthyBand:
    rng = np.random.default_rng(1)
    return healthy_band([rig(rng) for _ in range(RIGS)], LAYOUT)


def test_healthy_rigs_lie_within_the_band(band: HealthyBand) -> None:
    rng = np.random.default_rng(2)
    judged = [band.places(rig(rng)) for _ in range(200)]
    assert np.mean([places[0].gap for places in judged]) == pytest.approx(1.0, abs=0.02)
    # one in 49 is expected to lie beyond all of the 48; 5 % are four deviations more
    assert np.mean([any(place.beyond for place in places) for places in judged]) < 0.06


@pytest.mark.parametrize("off", [1.0, 1.5, 2.0, 3.0])
def test_a_run_as_far_off_as_one_of_the_healthy_rigs_lies_within(off: float) -> None:
    rng = np.random.default_rng(8)
    rigs = [rig(rng) for _ in range(RIGS)]
    rigs[5] += off
    places = healthy_band(rigs, LAYOUT).places(rig(np.random.default_rng(9)) + off)
    assert not any(place.beyond for place in places)


@pytest.mark.parametrize(("off", "beyond"), [(0.1, False), (-0.15, False), (1.5, True)])
def test_what_two_careful_programs_differ_by_is_no_level_that_is_off(off: float, beyond: bool) -> None:
    """Of a marker's pulses, say, which hardly scatter from rig to rig."""
    layout = Layout(tuple(replace(cell, tolerance=0.2) for cell in LAYOUT.cells))
    rng = np.random.default_rng(4)
    still = [5.0 + 0.001 * rng.normal(size=(BLOCKS, layout.size)) for _ in range(RIGS + 1)]
    places = healthy_band(still[1:], layout).places(still[0] + off)
    assert any(place.beyond for place in places) == beyond


def test_what_is_off_is_named_with_its_channel_and_its_worst_cell(band: HealthyBand) -> None:
    blocks = rig(np.random.default_rng(3))
    seventh = 20 + 7
    blocks[:, seventh * SLICES : (seventh + 1) * SLICES] += 12.0
    whole, first, second = band.places(blocks)
    assert (whole.channel, first.channel, second.channel) == ("", "right", "left")
    assert first.beyond
    assert not second.beyond
    assert first.worst == LAYOUT.cells[seventh] == whole.worst
    assert first.gap > whole.gap > first.farthest > 1.0


def test_how_far_healthy_rigs_lie_is_told_as_a_gap_too(band: HealthyBand) -> None:
    blocks = rig(np.random.default_rng(3)) + 4.0
    (whole, *_), gap = band.places(blocks), band.measure.total(band.measure.cells(blocks))
    assert gap / band.gap_up_to == pytest.approx(whole.gap / whole.farthest)
    assert 1.0 < band.gap_up_to < gap


def test_what_is_a_little_higher_everywhere_is_seen_by_its_level() -> None:
    rng = np.random.default_rng(6)
    band = healthy_band([rig(rng) for _ in range(RIGS)], LAYOUT)
    blocks = rig(rng)
    blocks[:, : 20 * SLICES] -= 0.8
    first = band.places(blocks)[1]
    assert (first.channel, first.beyond, first.gap_beyond) == ("left", True, False)
    assert first.level is not None
    assert first.level.what == "energy"
    assert first.level.off < -4.0


def test_one_rig_that_is_alone_somewhere_hides_nothing_elsewhere() -> None:
    """A point that one healthy rig in 48 touches, and all others never."""
    rng = np.random.default_rng(4)
    rigs = [rig(rng) for _ in range(RIGS)]
    rigs[5][:, : 20 * SLICES] += 30.0
    band = healthy_band(rigs, LAYOUT)
    blocks = rig(rng)
    blocks[:, 20 * SLICES :] += 1.5
    _, *channels = band.places(blocks)
    assert [place.channel for place in channels if place.beyond] == ["right"]
