"""Intervals of parameters."""

from __future__ import annotations

from sim_twin.diagnosis.posterior import Estimate


def test_an_interval_is_stretched_about_its_value_within_what_is_plausible() -> None:
    found = Estimate(2.0, 1.5, 3.0)
    assert found.widened(2.0, 0.0, 10.0) == Estimate(2.0, 1.0, 4.0)
    assert found.widened(10.0, 0.5, 8.0) == Estimate(2.0, 0.5, 8.0)
    assert found.widened(1.0, 0.0, 10.0) == found
