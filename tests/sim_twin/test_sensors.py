"""The measuring chain: each part of it by what it is to do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from sim_twin.linear_filter import LinearFilter, oscillator, resonance
from sim_twin.sensors import OVERSAMPLED_RATE, SensorChain, SensorStream, anti_alias_taps, oversampling

FS = 51_200.0
COUNT = 8192
AFTER = 2048  # samples for filters to settle


def through(chain: SensorChain, fine: np.ndarray, fs: float = FS, chunks: int = 1) -> np.ndarray:
    """Channel samples of a fine signal."""
    stream = SensorStream(chain, fs, None)
    stream.push(fine)
    return np.concatenate([stream.pull(COUNT // chunks) for _ in range(chunks)])


def sine(frequency: float, fs: float = FS, phase: float = 0.3) -> np.ndarray:
    fine = fs * oversampling(fs)
    count = (COUNT + 512) * oversampling(fs)
    return np.asarray(np.sin(2 * np.pi * frequency * np.arange(count) / fine + phase))


def gain_and_delay(chain: SensorChain, frequency: float) -> tuple[float, float]:
    """Amplitude ratio and delay in s of a sine after the chain has settled."""
    y = through(chain, sine(frequency))[AFTER:]
    t = np.arange(AFTER, COUNT) / FS
    basis = np.column_stack(
        [np.sin(2 * np.pi * frequency * t + 0.3), np.cos(2 * np.pi * frequency * t + 0.3)]
    )
    a, b = np.linalg.lstsq(basis, y, rcond=None)[0]
    return float(np.hypot(a, b)), float(-np.arctan2(b, a) / (2 * np.pi * frequency))


@pytest.mark.parametrize("fs", [51_200.0, 25_600.0, 20_000.0, 102_400.0])
def test_the_truth_is_sampled_at_204_8_khz_at_least(fs: float) -> None:
    assert oversampling(fs) * fs >= OVERSAMPLED_RATE - 1e-6
    assert (oversampling(fs) - 1) * fs < OVERSAMPLED_RATE


@pytest.mark.parametrize("factor", [4, 8])
@pytest.mark.parametrize("delay", [0.0, 0.37, -0.5])
def test_anti_alias_filter_is_flat_to_0_45_and_80_db_down_from_0_55(factor: int, delay: float) -> None:
    taps = anti_alias_taps(factor, delay)
    frequency = np.linspace(0, 0.5 * factor, 4001)  # in units of the channel's rate
    k = np.arange(len(taps)) - len(taps) // 2
    response = np.abs(np.exp(-2j * np.pi * np.outer(frequency / factor, k)) @ taps)
    assert np.abs(response[frequency <= 0.45] - 1).max() < 2e-4
    assert response[frequency >= 0.55].max() < 1e-4


@pytest.mark.parametrize("frequency", [20.0, 997.0, 9_973.0, 0.44 * FS])
def test_a_healthy_chain_neither_delays_nor_weakens(frequency: float) -> None:
    gain, delay = gain_and_delay(SensorChain(), frequency)
    assert gain == pytest.approx(1.0, abs=2e-4)
    assert abs(delay * FS) < 1e-3


@pytest.mark.parametrize("skew", [-2e-3, -1.234e-5, 3e-6, 5e-5, 2e-3])
def test_skew_delays_a_sine_exactly(skew: float) -> None:
    frequency = 97.0  # below half a period within 2 ms, so the phase is not ambiguous
    gain, delay = gain_and_delay(SensorChain(skew=skew), frequency)
    assert delay == pytest.approx(skew, abs=1e-3 / FS)
    assert gain == pytest.approx(1.0, abs=2e-4)


def test_skew_of_a_broadband_signal_is_the_signal_itself_later() -> None:
    rng = np.random.default_rng(1)
    lines = np.arange(1, 400) * 50.0  # up to 0.39 of the rate
    phases = rng.uniform(0, 2 * np.pi, len(lines))

    def signal_at(t: np.ndarray) -> np.ndarray:
        return np.asarray(np.cos(2 * np.pi * np.outer(t, lines) + phases).sum(axis=1))

    fine = signal_at(np.arange((COUNT + 512) * 4) / (4 * FS))
    shown = through(SensorChain(skew=7.3e-5), fine)[AFTER:]
    exact = signal_at(np.arange(AFTER, COUNT) / FS - 7.3e-5)
    assert shown == pytest.approx(exact, abs=1e-3 * np.abs(exact).max())


@pytest.mark.parametrize("corner", [0.5, 10.0])
def test_droop_is_a_first_order_high_pass(corner: float) -> None:
    step = np.ones((COUNT + 512) * 4)
    y = through(SensorChain(droop_corner=corner), step)
    # After a unit step a charge amplifier's output falls as exp(-2 pi f t); the filter rings before.
    t = np.arange(COUNT) / FS
    later = slice(AFTER, None)
    # bilinear transform: its time constant is off by (2 pi f / fs)^2 / 12 only
    assert y[later] == pytest.approx(np.exp(-2 * np.pi * corner * t[later]), abs=1e-3)


def test_a_droop_takes_3_db_and_45_degrees_at_its_corner() -> None:
    y = through(SensorChain(droop_corner=100.0), sine(100.0))[AFTER:]
    t = np.arange(AFTER, COUNT) / FS
    exact = np.sqrt(0.5) * np.sin(2 * np.pi * 100.0 * t + 0.3 + np.pi / 4)
    assert y == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize("corner", [800.0, 3000.0, 8000.0])
@pytest.mark.parametrize("share", [0.25, 1.0, 2.0])
def test_bandwidth_is_a_second_order_butterworth(corner: float, share: float) -> None:
    frequency = corner * share
    gain, _ = gain_and_delay(SensorChain(bandwidth_corner=corner), frequency)
    # The bilinear transform at 204.8 kHz bends 16 kHz by 2 %, half of it in the gain there.
    assert gain == pytest.approx(1 / np.sqrt(1 + share**4), rel=0.045 if frequency > 10e3 else 0.01)


def test_gain_multiplies() -> None:
    fine = sine(440.0)
    assert through(SensorChain(gain=0.7), fine) == pytest.approx(
        0.7 * through(SensorChain(), fine), abs=1e-15
    )


def test_noise_has_its_rms_and_is_white() -> None:
    stream = SensorStream(SensorChain(noise=0.05), FS, np.random.default_rng(7))
    stream.push(np.zeros(4 * 100_512))
    noise = stream.pull(100_000)
    assert np.std(noise) == pytest.approx(0.05, rel=0.01)  # 1e5 samples: 0.22 % at one sigma
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.015
    assert abs(noise.mean()) < 5 * 0.05 / np.sqrt(100_000)


def test_samples_are_multiples_of_a_24_bit_step() -> None:
    stream = SensorStream(SensorChain(full_scale=500.0), FS, np.random.default_rng(7))
    fine = 3.0 * sine(440.0)
    stream.push(fine)
    codes = stream.pull(COUNT) / (500.0 / 2**23)
    assert codes == pytest.approx(np.round(codes), abs=1e-6)
    error = codes * (500.0 / 2**23) - through(SensorChain(), fine)
    assert np.abs(error).max() <= 0.5 * 500.0 / 2**23 * (1 + 1e-6)


@pytest.mark.parametrize(
    "chain",
    [SensorChain(), SensorChain(skew=1.7e-4, droop_corner=2.0, bandwidth_corner=1500.0, gain=1.3)],
    ids=["healthy", "everything"],
)
def test_chunks_do_not_matter(chain: SensorChain) -> None:
    fine = np.random.default_rng(2).standard_normal((COUNT + 512) * 4)
    assert through(chain, fine, chunks=64) == pytest.approx(through(chain, fine), abs=1e-12)


def test_samples_that_are_not_there_yet_cannot_be_pulled() -> None:
    stream = SensorStream(SensorChain(), FS, None)
    stream.push(np.zeros(100))
    with pytest.raises(ValueError, match="fine samples are missing"):
        stream.pull(100)


def test_lookahead_is_what_a_sample_needs() -> None:
    for skew in (-2e-3, 0.0, 3.3e-6, 2e-3):
        stream = SensorStream(SensorChain(skew=skew), FS, None)
        stream.push(np.zeros(9 * 4 + stream.lookahead))
        assert len(stream.pull(10)) == 10


def test_a_resonance_has_its_gain_at_low_frequency_and_at_its_own() -> None:
    mode = resonance(700.0, 0.03, 204_800.0)
    t = np.arange(102_400) / 204_800.0
    for frequency, expected in ((8.0, 1.0), (700.0, 1 / 0.06), (1400.0, 1 / np.hypot(3.0, 0.12))):
        y = resonance(700.0, 0.03, 204_800.0)(np.sin(2 * np.pi * frequency * t))[51_200:]
        assert np.sqrt(2) * np.std(y) == pytest.approx(expected, rel=2e-3)
    assert mode(np.ones(204_800))[-1] == pytest.approx(1.0, abs=1e-9)


def test_recursions_and_oscillators_are_those_of_scipy_to_the_last_bit() -> None:
    rng = np.random.default_rng(3)
    omega, decay, mass, rate = 4000.0, 300.0, 2.0, 204_800.0
    A, B = np.array([[0.0, 1.0], [-(omega**2), -decay]]), np.array([[0.0], [1 / mass]])
    C, D = np.array([[-(omega**2), -decay]]), np.array([[1 / mass]])
    *system, _ = signal.cont2discrete((A, B, C, D), 1 / rate, method="foh")
    numerator, denominator = signal.ss2tf(*system)
    own = oscillator(omega, decay, 1 / mass, (-(omega**2), -decay), 1 / mass, rate)
    for b, a, ours in (
        (numerator[0], denominator, own),
        *((b, a, LinearFilter(b, a)) for b, a in (signal.butter(1, 0.1, "highpass"), signal.butter(2, 0.3))),
    ):
        state = np.zeros(len(a) - 1)
        for count in (1, 1000, 3):
            x = rng.standard_normal(2 * count)[::2]
            expected, state = signal.lfilter(b, a, x, zi=state)
            assert np.array_equal(ours(x), expected)


def test_a_marker_on_a_counter_shows_one_sample_an_edge_however_it_is_cut_into_blocks() -> None:
    at = np.arange((COUNT + 512) * oversampling(FS)) / oversampling(FS)  # in samples
    mark = np.where(at < 100.0, 5.0, 0.0)  # high to begin with: nobody saw it rise
    for rise in (1000.5, 2047.5, 5000.5):
        mark[(at >= rise) & (at < rise + 80.0)] = 5.0
    counter = SensorChain(edges=10.0)
    shown = through(counter, mark)
    assert np.flatnonzero(shown).tolist() == [1001, 2048, 5001]
    assert set(shown.tolist()) == {0.0, 10.0}
    assert np.array_equal(through(counter, mark, chunks=4), shown)
