"""The twin in step with a run gives the same samples however they are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from daq.block import sample_time_ns
from rig.twin.alignment import Alignment
from rig.twin.prediction import AlignedTwin
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.twin import Twin

RATE = 51_200.0
START_NS = 1_790_000_000_000_000_000
TWIN = Twin(nominal(), SineDrive(9.0, 20.0), nominal_sensors(nominal()))


def aligned(onset: float | None = None, phase: float = 0.7) -> AlignedTwin:
    return AlignedTwin(TWIN, Alignment(20.0, phase, onset), RATE, settle_s=0.0)


@pytest.mark.parametrize("onset", [None, 1000.25])
def test_samples_do_not_depend_on_the_sizes_they_are_asked_in(onset: float | None) -> None:
    whole = aligned(onset).advance(6000)
    parts = aligned(onset)
    pieces = np.concatenate([parts.advance(count) for count in (1, 999, 17, 4983)], axis=1)
    # The solver integrates exactly between contacts; another division of the time rounds the last digit of
    # a contact's beginning (1e-12 s), which chaos has multiplied by e in each 30 ms by the end.
    assert np.allclose(whole, pieces, atol=1e-3)


def test_blocks_count_from_sample_0_and_stop_where_asked() -> None:
    twin = aligned()
    first = list(twin.blocks(14_000, START_NS))
    later = list(twin.blocks(16_000, START_NS))
    upper = [block for block in first + later if block.channel == "contact.force_upper"]
    assert [(block.first_sample, block.end_sample) for block in upper] == [
        (0, 10_240),
        (10_240, 14_000),
        (14_000, 16_000),
    ]
    assert [block.time_ns for block in upper] == [
        sample_time_ns(START_NS, block.first_sample, RATE) for block in upper
    ]
    assert {block.channel for block in first} == set(TWIN.channels)
    assert all(block.values.dtype == np.float32 for block in first)


def test_the_drive_has_the_phase_that_was_measured() -> None:
    drive = aligned(phase=0.7).advance(5120)[0]
    times = np.arange(5120) / RATE
    assert drive == pytest.approx(9.0 * np.sin(2 * np.pi * 20.0 * times + 0.7), abs=1e-3)


def test_before_its_onset_the_twin_is_at_rest() -> None:
    onset = 1000.25
    rows = aligned(onset, phase=-2 * np.pi * 20.0 * onset / RATE).advance(3000)
    # The anti-alias filter spreads what follows over a few samples.
    assert np.abs(rows[:, :900]).max() < 1e-6
    times = (np.arange(1100, 3000) - onset) / RATE
    assert rows[0, 1100:] == pytest.approx(9.0 * np.sin(2 * np.pi * 20.0 * times), abs=1e-2)


def test_a_drive_that_ran_before_has_the_twin_bouncing_at_sample_0() -> None:
    upper = aligned().advance(2560)[TWIN.channels.index("contact.force_upper")]
    assert upper.max() > 10.0


@pytest.mark.parametrize(("hertz", "blocks"), [(20.0, 12), (10.0, 12), (2.0, 24), (0.3, 60)])
def test_a_picture_of_each_block_shows_every_phase_of_the_cycle_though_blocks_last_parts_of_it(
    hertz: float, blocks: int
) -> None:
    twin = AlignedTwin(TWIN, Alignment(hertz, 0.7, None), RATE, settle_s=0.0)
    phases = [0.0]
    for end in range(5120, (blocks + 1) * 5120, 5120):
        *_, last = twin.blocks(end, START_NS)
        shown = twin.shape()
        assert end - 5120 <= round(shown.time_s * RATE) <= last.end_sample + 64
        phases.append(shown.time_s * hertz % 1.0)
    assert np.diff([*sorted(phases), 1.0]).max() < 0.25
