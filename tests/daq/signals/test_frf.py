import numpy as np
import pytest
from hypothesis import given, settings

from daq.signals.frf import FrfAverage, frf
from daq.signals.spectrum import Segmenting
from tests.daq.signals.cuts import blocks, cuts_of

SAMPLES = 64
PLAIN = Segmenting(SAMPLES, overlap=0.0, window="boxcar")
RNG = np.random.default_rng(8)
STIMULUS, INPUT_NOISE = RNG.normal(size=(2, SAMPLES))
SYSTEM = RNG.normal(size=SAMPLES // 2 + 1) + 1j * RNG.normal(size=SAMPLES // 2 + 1)
SYSTEM[[0, -1]] = 1.0  # a real system is real there


def record(on_input: float, on_response: float) -> tuple[np.ndarray, np.ndarray]:
    """Four segments whose noises cancel in every mean product: with the signal and with each other.

    The noise on the response has the spectrum of that on the input, times `on_response` / `on_input`.
    """
    response = np.fft.irfft(SYSTEM * np.fft.rfft(STIMULUS))
    x = [STIMULUS + sign * on_input * INPUT_NOISE for sign in (1, 1, -1, -1)]
    y = [response + sign * on_response * INPUT_NOISE for sign in (1, -1, 1, -1)]
    return np.concatenate(x), np.concatenate(y)


def noise_to_signal(signal: np.ndarray, scale: float) -> np.ndarray:
    """Ratio of powers at each line."""
    return scale**2 * np.abs(np.fft.rfft(INPUT_NOISE)[1:]) ** 2 / np.abs(signal[1:]) ** 2


def test_without_noise_all_estimators_are_the_system() -> None:
    found = frf(*record(0.0, 0.0), 100.0, PLAIN)
    for estimate in (found.h1, found.h2, found.hv()):
        assert np.allclose(estimate[0], SYSTEM[1:], rtol=1e-10)  # rounding
    assert np.allclose(found.coherence, 1.0, rtol=1e-10)
    assert found.averages.tolist() == [4]


def test_noise_on_the_response_leaves_h1_right_and_makes_h2_too_large() -> None:
    found = frf(*record(0.0, 0.7), 100.0, PLAIN)
    ratio = noise_to_signal(SYSTEM * np.fft.rfft(STIMULUS), 0.7)
    assert np.allclose(found.h1[0], SYSTEM[1:], rtol=1e-10)
    assert np.allclose(found.h2[0], SYSTEM[1:] * (1 + ratio), rtol=1e-10)
    assert np.allclose(found.coherence[0], 1 / (1 + ratio), rtol=1e-10)


def test_noise_on_the_input_leaves_h2_right_and_makes_h1_too_small() -> None:
    found = frf(*record(0.7, 0.0), 100.0, PLAIN)
    ratio = noise_to_signal(np.fft.rfft(STIMULUS), 0.7)
    assert np.allclose(found.h2[0], SYSTEM[1:], rtol=1e-10)
    assert np.allclose(found.h1[0], SYSTEM[1:] / (1 + ratio), rtol=1e-10)
    assert np.allclose(found.coherence[0], 1 / (1 + ratio), rtol=1e-10)


@pytest.mark.parametrize(("on_input", "on_response"), [(0.5, 0.5), (0.5, 5e-3), (5e-3, 0.5)])
def test_hv_is_right_where_the_ratio_of_the_noises_is_known(on_input: float, on_response: float) -> None:
    found = frf(*record(on_input, on_response), 100.0, PLAIN)
    # A ratio of 1e4 between the noises magnifies rounding by as much.
    assert np.allclose(found.hv((on_response / on_input) ** 2)[0], SYSTEM[1:], rtol=1e-8)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_hv_does_not_depend_on_the_unit_if_the_ratio_has_it(scale: float) -> None:
    x, y = record(0.5, 0.5)
    assert np.allclose(frf(x, scale * y, 100.0, PLAIN).hv(scale**2), scale * frf(x, y, 100.0, PLAIN).hv())


def test_a_response_that_lags_has_a_negative_phase() -> None:
    x = np.tile(STIMULUS, 2)
    found = frf(x, np.roll(x, 3), 64.0, PLAIN)
    assert np.allclose(found.h1[0], np.exp(-2j * np.pi * found.frequency_hz * 3 / 64.0), rtol=1e-10)


@pytest.mark.parametrize("noisy", ["input", "response"])
def test_random_noise_biases_one_estimator_by_the_coherence_and_not_the_other(noisy: str) -> None:
    averages, rng = 400, np.random.default_rng(9)
    clean = rng.normal(size=256 * averages)
    noise = rng.normal(scale=np.sqrt(1 / 3), size=len(clean))
    x, y = (clean + noise, 2 * clean) if noisy == "input" else (clean, 2 * (clean + noise))
    found = frf(x, y, 1000.0, Segmenting(256, overlap=0.0))
    # Bendat and Piersol, 4th ed., table 9.6, for a coherence of 3/4; the Hann window ties lines together, so
    # that 128 of them are worth 128/1.5.
    deviation = np.sqrt((1 - 0.75) / 0.75 / (2 * averages)) / np.sqrt(128 / 1.5)
    expected = (2 * 0.75, 2.0) if noisy == "input" else (2.0, 2 / 0.75)
    for estimate, value in zip((found.h1, found.h2), expected, strict=True):
        assert abs(estimate.mean() / value - 1) < 4 * deviation
    # A line's deviation is sqrt(2) (1 - 3/4) sqrt(3/4) / sqrt(averages), its bias (1 - 3/4)^2 / averages.
    within = 4 * 0.306 / np.sqrt(averages * 128 / 1.5) + 2e-4
    assert found.coherence.mean() == pytest.approx(0.75, abs=within)


def test_a_segment_with_an_overload_is_left_out() -> None:
    rng = np.random.default_rng(10)
    x = rng.normal(size=5 * SAMPLES)
    y = np.convolve(x, [1.0, 0.5, 0.25])[: len(x)]
    second = slice(SAMPLES, 2 * SAMPLES)
    rest = frf(np.delete(x, second), np.delete(y, second), 100.0, PLAIN)
    clipped = y.copy()
    clipped[SAMPLES + 7] = 40.0
    found = frf(x, clipped, 100.0, PLAIN, clipped == 40.0)
    assert found.averages.tolist() == rest.averages.tolist() == [4]
    assert np.array_equal(found.h1, rest.h1)
    assert np.array_equal(found.coherence, rest.coherence)
    assert not np.allclose(frf(x, clipped, 100.0, PLAIN).h1, rest.h1, rtol=0.1)


def test_an_overload_of_one_response_leaves_the_others_their_segments() -> None:
    rng = np.random.default_rng(11)
    x, y = rng.normal(size=5 * SAMPLES), rng.normal(size=(2, 5 * SAMPLES))
    flagged = np.zeros((3, 5 * SAMPLES), dtype=bool)
    flagged[1, 70] = flagged[0, 200] = True  # the first response in segment 1, the input in segment 3
    found = frf(x, y, 100.0, PLAIN, flagged)
    assert found.averages.tolist() == [3, 4]
    alone = frf(x, y[1], 100.0, PLAIN, flagged[0])
    assert np.allclose(found.h1[1], alone.h1[0], rtol=1e-10)
    assert np.allclose(found.input_density[1], alone.input_density[0], rtol=1e-10)


def test_where_there_is_nothing_to_divide_by_there_is_no_number() -> None:
    x = np.random.default_rng(12).normal(size=2 * SAMPLES)
    silent = frf(np.zeros_like(x), x, 100.0, PLAIN)
    assert np.isnan(silent.h1).all()
    assert np.isnan(silent.coherence).all()
    nothing = frf(x[:10], x[:10], 100.0, PLAIN)
    assert nothing.averages.tolist() == [0]
    assert np.isnan(nothing.hv()).all()


def test_densities_are_those_of_the_channels() -> None:
    x = np.random.default_rng(13).normal(size=20 * SAMPLES)
    found = frf(x, 3 * x, 100.0, PLAIN)
    # White noise of variance 1 is spread over 50 Hz; its mean takes 1/64 of it, which has no line.
    assert found.input_density.sum() * 100 / SAMPLES == pytest.approx(
        np.mean(x.reshape(20, -1).var(axis=1)), rel=1e-10
    )
    assert np.allclose(found.response_density, 9 * found.input_density)
    assert np.allclose(found.cross_density, 3 * found.input_density)


CHANNELS = np.random.default_rng(14).normal(size=(3, 600)).astype(np.float32)
FLAGS = np.zeros((3, 600), dtype=bool)
FLAGS[1, 300] = True
CHANNELS[2, 450] = np.nan


@settings(deadline=None, max_examples=40)
@given(cuts_of(600))
def test_blocks_of_any_size_give_the_response_of_the_whole(cuts: list[int]) -> None:
    segmenting = Segmenting(48)
    average = FrfAverage(100.0, segmenting, responses=2)
    for block in blocks(600, cuts):
        average.add(CHANNELS[0, block], CHANNELS[1:, block], FLAGS[:, block])
    found, whole = average.result(), frf(CHANNELS[0], CHANNELS[1:], 100.0, segmenting, FLAGS)
    assert np.array_equal(found.h1, whole.h1)
    assert np.array_equal(found.hv(), whole.hv())
    assert np.array_equal(found.coherence, whole.coherence)
    assert found.averages.tolist() == whole.averages.tolist() == [22, 22]
