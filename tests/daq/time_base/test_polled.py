"""A value polled lies between request and reply, and no nearer."""

from __future__ import annotations

import numpy as np
import pytest

from daq.time_base.polled import polled_clock


@pytest.mark.parametrize("where", [0.0, 0.3, 1.0])  # of the way from request to reply
def test_the_bound_holds_wherever_in_the_poll_the_value_was_taken(where: float) -> None:
    rng = np.random.default_rng(1)
    request = np.arange(2000) / 20.0
    reply = request + 8e-3 + rng.exponential(1e-3, 2000) + 20e-3 * (rng.random(2000) < 0.01)
    clock = polled_clock("inverter", request, reply, 7)
    taken = request + where * (reply - request)
    assert np.mean(np.abs(reply + clock.offset_s - taken) <= clock.uncertainty_s) >= 0.95
    assert clock.uncertainty_s < 10e-3
    assert (clock.time_ns, clock.device, clock.rate_ppm) == (7, "inverter", 0.0)


def test_one_poll_says_half_its_length() -> None:
    clock = polled_clock("inverter", [1.0], [1.01], 0)
    assert (clock.offset_s, clock.uncertainty_s) == pytest.approx((-5e-3, 5e-3))
