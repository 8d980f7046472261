"""The host's clock against the card's, from when blocks of 0.1 s arrive."""

from __future__ import annotations

import numpy as np
import pytest

from rig.session.arrivals import Arrivals

RATE, BLOCK = 51_200.0, 5120
START_NS = 1_790_000_000_000_000_000


def arrived(blocks: int, ppm: float = 0.0, delay_s: float = 0.01, jitter_s: float = 2e-3) -> Arrivals:
    """Blocks that come `delay_s` and an exponential jitter after their end, by a host clock off by `ppm`."""
    late = np.random.default_rng(1).exponential(jitter_s, blocks)
    arrivals = Arrivals(RATE)
    for number in range(1, blocks + 1):
        true_s = number * BLOCK / RATE + delay_s + late[number - 1]
        arrivals.note(number * BLOCK, START_NS + round(true_s * (1 + ppm * 1e-6) * 1e9))
    return arrivals


@pytest.mark.parametrize("ppm", [100.0, -50.0])
def test_rate_and_offset_of_a_long_run_are_found(ppm: float) -> None:
    record = arrived(1200, ppm).record("host", START_NS)
    assert record is not None
    # 2 ms of jitter over 300 blocks in 120 s: a slope to 2e-3 / sqrt(300) / 35 s = 3 ppm; four sigma.
    assert record.rate_ppm == pytest.approx(ppm, abs=12)
    assert record.device == "host"


def test_offset_is_the_earliest_arrival_and_its_uncertainty_the_median_lateness() -> None:
    record = arrived(100).record("host", START_NS)
    assert record is not None
    assert record.offset_s == pytest.approx(0.01, abs=2e-4)
    # the median of an exponential distribution is its mean times ln 2; a hundred draws give it to 30 %
    assert record.uncertainty_s == pytest.approx(2e-3 * np.log(2), rel=0.3)


@pytest.mark.parametrize("blocks", [10, 20, 40])
def test_a_short_run_claims_no_rate(blocks: int) -> None:
    record = arrived(blocks).record("host", START_NS)
    assert record is not None
    assert record.rate_ppm == 0.0


def test_too_few_blocks_say_nothing() -> None:
    assert arrived(9).record("host", START_NS) is None
