"""The blind check's measuring chain against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from benchmarks.blind.sensing import Chain, altered, anti_alias, healthy, plugged, sensed

RATE, FACTOR, LEAD, COUNT = 51_200.0, 4, 2_560, 5_120
_PERFECT = Chain(noise=0.0, full_scale=100.0)
_TIMES = np.arange(COUNT) / RATE


def _shown(frequency: float, chain: Chain, offset: float = 0.0) -> NDArray[np.float64]:
    t = np.arange((LEAD + COUNT + 512) * FACTOR) / (RATE * FACTOR) - LEAD / RATE
    fine = offset + np.sin(2 * np.pi * frequency * t)
    return sensed(fine, FACTOR, RATE, LEAD, COUNT, chain, np.random.default_rng(0))


def _sine(frequency: float, gain: float = 1.0, angle: float = 0.0) -> NDArray[np.float64]:
    return gain * np.sin(2 * np.pi * frequency * _TIMES + angle)


def test_healthy_channel_has_gain_one_and_no_delay() -> None:
    # Ripple 4e-5 of the anti-alias filter, quantisation 6e-6.
    np.testing.assert_allclose(_shown(3_000.0, _PERFECT), _sine(3_000.0), atol=1e-4)


@pytest.mark.parametrize("skew", [2e-3, -7.3e-5, 2e-6])
def test_skewed_channel_shows_the_past(skew: float) -> None:
    shown = _shown(3_000.0, Chain(0.0, 100.0, gain=1.5, skew=skew))
    # The held ends of the signal reach in by the filter's length only.
    inner = slice(600, -600)
    expected = _sine(3_000.0, 1.5, -2 * np.pi * 3_000.0 * skew)
    np.testing.assert_allclose(shown[inner], expected[inner], atol=3e-4)


def test_low_pass_is_a_second_order_butterworth() -> None:
    corner, frequency = 1_000.0, 1_500.0
    response = signal.freqs(*signal.butter(2, corner, analog=True), [frequency])[1][0]
    shown = _shown(frequency, Chain(0.0, 100.0, low_pass=corner))
    inner = slice(600, -600)
    np.testing.assert_allclose(
        shown[inner], _sine(frequency, abs(response), np.angle(response))[inner], atol=3e-4
    )


def test_high_pass_loses_the_mean_from_the_first_sample() -> None:
    shown = _shown(400.0, Chain(0.0, 100.0, high_pass=4.0), offset=5.0)
    response = 1 / (1 - 4j / 400)
    # The start of the sine is not its steady state: off by corner / frequency at most.
    expected = _sine(400.0, abs(response), np.angle(response))
    np.testing.assert_allclose(shown, expected, atol=0.011)


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_anti_alias_filter_keeps_to_its_edges(factor: int) -> None:
    f, response = signal.freqz(anti_alias(factor), worN=2**15, fs=factor)
    level = 20 * np.log10(np.abs(response) + 1e-12)
    assert np.abs(level[f <= 0.45]).max() < 0.01
    assert level[f >= 0.55].max() < -80


def test_noise_and_quantisation() -> None:
    shown = _shown(0.0, Chain(noise=0.05, full_scale=500.0))
    steps = shown / (500.0 / 2**23)
    # 5 120 samples give the rms to 1 %; three sigma.
    assert shown.std() == pytest.approx(0.05, rel=0.03)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)


def test_sensor_effects_reach_their_channel_alone() -> None:
    effects = [
        {"name": "sensor_gain", "parameters": {"channel": "a", "gain": 2.0}},
        {"name": "sensor_droop", "parameters": {"channel": "a", "corner_hz": 3.0}},
        {"name": "sensor_bandwidth", "parameters": {"channel": "a", "corner_hz": 900.0}},
        {"name": "time_skew", "parameters": {"channel": "a", "seconds": 1e-3}},
    ]
    assert altered(_PERFECT, "a", effects) == Chain(0.0, 100.0, 2.0, 1e-3, 3.0, 900.0)
    assert altered(_PERFECT, "b", effects) == _PERFECT


def test_wiring_is_wrong_by_a_factor_late_in_all_or_swapped() -> None:
    turned = {"name": "sensor_factor", "parameters": {"channel": "a", "factor": -1.0}}
    late = {"name": "analog_delay", "parameters": {"seconds": 1e-3}}
    assert altered(_PERFECT, "a", [turned, late]) == Chain(0.0, 100.0, skew=1e-3, factor=-1.0)
    assert altered(_PERFECT, "b", [turned, late]) == Chain(0.0, 100.0, skew=1e-3)
    upper, lower, yoke = (np.full(3, value) for value in (1.0, 2.0, 3.0))
    fine = {"contact.force_upper": upper, "contact.force_lower": lower, "yoke.force": yoke}
    # the second one after the lower in the ring of three is the upper
    swapped = {"name": "swapped_channels", "parameters": {"channel": "contact.force_lower", "other": 2.0}}
    found = plugged(fine, [swapped])
    assert [each[0] for each in found.values()] == [2.0, 1.0, 3.0]
    assert list(found) == list(fine)
    assert plugged(fine, [turned]) == fine


def test_a_wrong_factor_is_of_the_numbers_noise_and_all() -> None:
    chain, other = Chain(noise=0.05, full_scale=100.0), Chain(noise=0.05, full_scale=100.0, factor=10.0)
    assert np.array_equal(_shown(3_000.0, other), 10.0 * _shown(3_000.0, chain))


def test_healthy_chains_scatter_as_stated() -> None:
    rng = np.random.default_rng(1)
    drawn = [healthy(rng, 0.05, 500.0) for _ in range(2_000)]
    # 2 000 draws give a standard deviation to 1.6 %; three sigma.
    assert np.std([chain.gain for chain in drawn]) == pytest.approx(0.005, rel=0.05)
    assert np.std([chain.skew for chain in drawn]) == pytest.approx(2e-6, rel=0.05)


def test_motion_that_ends_early_is_refused() -> None:
    with pytest.raises(ValueError, match="missing at the end"):
        sensed(np.zeros(400), FACTOR, RATE, 0, 200, _PERFECT, np.random.default_rng(0))
