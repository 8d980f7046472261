"""Chains by their frequency responses give what the chains in motion give."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.campaign import through_chains
from sim_twin.sensors import Encoder, SensorChain, SensorStream, oversampling

Array = NDArray[np.float64]
RATE, COUNT = 25_600.0, 25_600
FINE = oversampling(RATE)
BASE_HZ = 20.0
SETTLED = 2  # periods of a second: what a droop of 1 Hz still remembers is exp(-4 pi), 3e-6


def lines(highest: float) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(1)
    frequencies = BASE_HZ * np.arange(1.0, int(highest / BASE_HZ))
    return (
        np.asarray(frequencies),
        rng.normal(size=len(frequencies)),
        rng.uniform(0, 2 * np.pi, len(frequencies)),
    )


def at_times(times: Array, highest: float) -> Array:
    """A broad-band signal that repeats after 50 ms; `times` is one repeat."""
    frequencies, sizes, phases = lines(highest)
    return np.asarray(np.cos(2 * np.pi * np.outer(times, frequencies) + phases) @ sizes)


def periodic(rate: float, seconds: float, highest: float) -> Array:
    one = at_times(np.arange(round(rate / BASE_HZ)) / rate, highest)
    return np.tile(one, round(seconds * BASE_HZ))


def in_motion(chain: SensorChain, highest: float) -> Array:
    """One period of a second of the chain in motion, once it has settled."""
    stream = SensorStream(chain, RATE, None)
    stream.push(periodic(RATE * FINE, SETTLED + 1.1, highest))
    return stream.pull((SETTLED + 1) * COUNT)[SETTLED * COUNT :]


def at_once(chain: SensorChain, clean: Array, quiet: float = 0.0) -> Array:
    (shown,) = through_chains(clean[None], [chain], RATE, quiet, np.random.default_rng(3))
    return np.asarray(shown, dtype=np.float64)


@pytest.mark.parametrize(
    ("chain", "tolerance"),
    [
        # float32 of the record and of its spectrum
        (SensorChain(), 1e-4),
        (SensorChain(gain=0.7), 1e-4),
        (SensorChain(gain=-1.5), 1e-4),
        (SensorChain(factor=-10.0, limit=30.0), 1e-4),
        # the chain in motion interpolates between fine samples, to 80 dB
        (SensorChain(skew=7.3e-5), 5e-4),
        (SensorChain(skew=-2e-3), 5e-4),
        (SensorChain(droop_corner=1.0), 5e-4),
        (SensorChain(droop_corner=10.0), 5e-4),
        # a bilinear transform at 204.8 kHz bends the 8 kHz that are looked at by (pi 8/204.8)^2 / 3 = 0.5 %
        (SensorChain(bandwidth_corner=800.0), 5e-3),
        (SensorChain(bandwidth_corner=8000.0), 1e-2),
        (SensorChain(gain=1.3, skew=1e-4, droop_corner=5.0, bandwidth_corner=3000.0), 1e-2),
    ],
    ids=[
        "healthy",
        "gain",
        "turned round",
        "factor",
        "late",
        "early",
        "droop",
        "10 Hz droop",
        "800 Hz",
        "8 kHz",
        "all",
    ],
)
def test_a_chain_over_the_whole_record_is_the_chain_in_motion(chain: SensorChain, tolerance: float) -> None:
    highest = 8000.0
    exact = in_motion(chain, highest)
    shown = at_once(chain, periodic(RATE, 1.0, highest))
    assert np.sqrt(np.mean((shown - exact) ** 2) / np.mean(exact**2)) < tolerance


def test_a_record_that_ends_elsewhere_than_it_began_is_right_away_from_its_ends() -> None:
    count = 25_013  # prime: no fast length, and no whole period
    clean = periodic(RATE, 1.0, 2000.0)[:count]
    exact = in_motion(SensorChain(skew=1e-3), 2000.0)[:count]
    shown = at_once(SensorChain(skew=1e-3), clean)
    inner = slice(200, -200)  # 8 ms
    # what a jump of one rms at an end rings on with, 200 samples away: 1 / (200 pi)
    assert np.abs(shown - exact)[inner].max() < 0.02 * np.std(exact)


def test_noise_has_the_share_that_a_decimation_left_and_is_not_in_the_signal_s_gain() -> None:
    chain = SensorChain(noise=0.05, gain=1.8)
    noise = at_once(chain, np.zeros(100_000), 0.6)
    # 1e5 samples: 0.22 % at one sigma
    assert np.std(noise) == pytest.approx(0.6 * 0.05, rel=0.01)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.015
    clean = periodic(RATE, 1.0, 2000.0)
    assert np.std(at_once(chain, clean, 1.0) - at_once(chain, clean)) == pytest.approx(0.05, rel=0.03)


def test_an_encoder_counts_and_carries_no_noise() -> None:
    angle = np.linspace(0.1, 40.0, 10_000)
    (shown,) = through_chains(angle[None], [Encoder(4096)], RATE, 1.0, np.random.default_rng(0))
    counts = shown / (2 * np.pi / 4096)
    assert counts == pytest.approx(np.round(counts), abs=1e-9)
    assert np.all((angle - shown >= 0) & (angle - shown < 2 * np.pi / 4096))


def test_a_marker_on_a_counter_shows_one_sample_an_edge_and_carries_no_noise() -> None:
    mark = np.where(np.arange(10_000) % 2000 < 50, 5.0, 0.0)
    counter = SensorChain(noise=0.02, edges=10.0)
    (shown,) = through_chains(mark[None], [counter], RATE, 1.0, np.random.default_rng(0))
    assert np.flatnonzero(shown).tolist() == [2000, 4000, 6000, 8000]
    assert set(shown.tolist()) == {0.0, 10.0}


def test_each_row_goes_through_its_own_sensor() -> None:
    clean = np.stack([periodic(RATE, 1.0, 2000.0)] * 2)
    one, other = through_chains(
        clean, [SensorChain(), SensorChain(gain=2.0)], RATE, 0.0, np.random.default_rng(0)
    )
    assert other == pytest.approx(2 * one, abs=1e-4 * float(np.std(one)))


def test_a_constant_survives_unless_a_droop_takes_it() -> None:
    level = np.full(COUNT, 3.0)
    assert at_once(SensorChain(), level) == pytest.approx(level, abs=1e-5)
    assert at_once(SensorChain(droop_corner=1.0), level) == pytest.approx(0 * level, abs=1e-5)


def test_pulses_that_a_counter_times_are_timed_before_a_wrong_factor() -> None:
    speed = 20.0 + np.sin(2 * np.pi * 3 * np.arange(COUNT) / RATE)
    timed = SensorChain(pulses=4.0, factor=-2.0)
    [shown] = through_chains(speed[None].astype(np.float32), [timed], RATE, 1.0, np.random.default_rng(1))
    stream = SensorStream(timed, RATE, None)
    stream.push(np.repeat(speed, FINE))
    moved = stream.pull(COUNT - 200)
    settled = slice(round(0.2 * RATE), COUNT - 200)  # two pulses come in 0.16 s
    for seen in (shown[settled], moved[settled]):
        assert len(np.unique(seen)) <= 20.0 / (2 * np.pi) * 4
        assert np.all((seen > -42.0) & (seen < -38.0))
