"""Half a minute of the load that `scripts/soak` holds for an hour."""

from __future__ import annotations

import pytest

from benchmarks.soak import ALL, section


@pytest.mark.long
@pytest.mark.timeout(300)
def test_a_stalling_disk_and_a_busy_neighbour_cost_no_sample_of_64_channels() -> None:
    page, held = section("load", ALL["load"], short=True)
    assert held, page
