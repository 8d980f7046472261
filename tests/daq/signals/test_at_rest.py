"""What is told of a sensor at rest, and of taps, by signals that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.signals.at_rest import Tap, TapFinder, at_rest

RATE = 12_800.0
NOISE = 0.02


def seconds(length_s: float, seed: int = 1) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and white noise."""
    times = np.arange(round(length_s * RATE)) / RATE
    return times, np.random.default_rng(seed).normal(0.0, NOISE, len(times))


def test_level_and_noise_are_told_without_drift_and_hum() -> None:
    times, noise = seconds(2.0)
    hum = 0.3 * np.sin(math.tau * 50.03 * times) + 0.05 * np.sin(math.tau * 150.09 * times + 1.0)
    found = at_rest(1.5 + 0.2 * times + hum + noise, RATE)
    assert found.mean == pytest.approx(1.7, abs=1e-3)
    assert found.noise == pytest.approx(NOISE, rel=0.05)
    assert [round(line.frequency_hz) for line in found.lines] == [50, 150]
    assert [line.amplitude for line in found.lines] == pytest.approx([0.3, 0.05], rel=0.05)


@pytest.mark.parametrize("mains_hz", [50.0, 60.0])
def test_harmonics_alone_tell_which_mains(mains_hz: float) -> None:
    times, noise = seconds(2.0)
    values = noise + sum(0.1 * np.sin(math.tau * k * mains_hz * times) for k in (2, 3, 6))
    found = at_rest(values, RATE)
    assert [line.frequency_hz / mains_hz for line in found.lines] == pytest.approx([2, 3, 6])


def test_noise_alone_has_no_mains() -> None:
    """8000 places for a line in all; noise is to make none in them."""
    assert not any(at_rest(seconds(1.0, seed)[1], RATE).lines for seed in range(400))


def test_what_is_not_finite_has_no_level() -> None:
    _, values = seconds(1.0)
    values[100] = np.nan
    assert math.isnan(at_rest(values, RATE).noise)


def taps_in(values: NDArray[np.float64], least: float = 1e-3) -> list[Tap]:
    finder = TapFinder(RATE, np.full(len(values), least))
    blocks = np.array_split(values, values.shape[1] // 960, axis=1)
    return [tap for tap in map(finder.take, blocks) if tap is not None]


def ring(times: NDArray[np.float64], at_s: float, height: float) -> NDArray[np.float64]:
    """A blow that rings: its first swing is its largest but for one behind it, on the other side."""
    since = np.maximum(times - at_s, 0.0)
    return height * np.sin(math.tau * 60.0 * since) * np.exp(-30.0 * since) * (since > 0)


def test_taps_are_told_once_with_the_sign_of_their_first_swing() -> None:
    times, noise = seconds(4.0)
    quiet = seconds(4.0, 2)[1]
    struck = noise + 0.7 + ring(times, 1.5, 5.0) + ring(times, 3.0, -8.0)
    found = taps_in(np.stack([struck, quiet]))
    assert [tap.at_sample / RATE for tap in found] == pytest.approx([1.5, 3.0], abs=2e-3)
    assert [math.copysign(1.0, tap.swings[0]) for tap in found] == [1.0, -1.0]
    assert abs(found[1].swings[0]) == pytest.approx(8.0 * math.exp(-0.125), rel=0.05)
    assert not any(tap.swings[1] for tap in found)


def test_noise_hum_and_drift_are_no_taps() -> None:
    times, noise = seconds(10.0)
    assert not taps_in(np.stack([noise + np.sin(math.tau * 50.0 * times), noise + 0.5 * times]))


def test_below_the_least_nothing_is_a_tap() -> None:
    times, _ = seconds(3.0)
    assert not taps_in(ring(times, 2.0, 0.5)[None, :], least=1.0)
