import numpy as np
import pytest
from hypothesis import given, settings
from scipy import signal

from daq.signals.spectrum import (
    Autospectrum,
    Segmenting,
    SpectrumAverage,
    autospectrum,
    averaged_spectrum,
    log_bands,
)
from tests.daq.signals.cuts import blocks, cuts_of

RATE = 51_200.0


def power(spectrum: Autospectrum) -> float:
    step = spectrum.frequency_hz[1] - spectrum.frequency_hz[0]
    return float(spectrum.density.sum() * step)


def test_the_density_of_a_sine_adds_up_to_its_mean_square() -> None:
    times = np.arange(round(2 * RATE)) / RATE
    spectrum = autospectrum(9.0 * np.sin(2 * np.pi * 100.0 * times), RATE)
    # A sine of amplitude A has the mean square A^2/2, and a Hann window keeps all of it within two lines.
    assert power(spectrum) == pytest.approx(9.0**2 / 2, rel=1e-3)
    assert spectrum.frequency_hz[spectrum.density.argmax()] == pytest.approx(100.0, abs=1.0)


def test_white_noise_is_flat_at_its_variance_over_the_band() -> None:
    noise = np.random.default_rng(1).normal(scale=0.05, size=round(20 * RATE))
    spectrum = autospectrum(noise, RATE)
    # 79 half-overlapping segments leave about 14 % in each line; the mean over 12 800 lines is far closer.
    assert spectrum.density.mean() == pytest.approx(0.05**2 / (RATE / 2), rel=0.01)


def test_samples_that_are_not_finite_are_left_out() -> None:
    values = np.random.default_rng(2).normal(size=20_000)
    values[:9000] = np.nan
    spectrum = autospectrum(values, RATE, resolution_hz=20.0)
    assert np.isfinite(spectrum.density).all()
    assert power(spectrum) == pytest.approx(1.0, rel=0.1)  # a variance from 11 000 samples: sd 1.4 %


@pytest.mark.parametrize("values", [np.empty(0), np.ones(5), np.full(1000, np.nan)])
def test_too_few_samples_give_an_empty_spectrum(values: np.ndarray) -> None:
    assert len(autospectrum(values, RATE).frequency_hz) == 0
    assert len(log_bands(autospectrum(values, RATE), 10).frequency_hz) == 0


def test_an_autospectrum_is_the_average_over_its_segments() -> None:
    values = np.random.default_rng(3).normal(size=2000).astype(np.float32)
    whole = averaged_spectrum(values, 1000.0, Segmenting(500))
    assert np.array_equal(autospectrum(values, 1000.0).density, whole.density)


def test_each_line_counts_in_the_band_that_it_lies_in() -> None:
    """Also where lines are missing."""
    frequency = np.array([1.0, 2.0, 9.0, 10.0, 11.0, 90.0, 100.0])
    bands = log_bands(Autospectrum(frequency, np.arange(7.0)), 2)  # parted just above 10 Hz
    assert bands.frequency_hz == pytest.approx([5.5, 67.0])
    assert bands.density == pytest.approx([1.5, 5.0])


def test_bands_keep_a_flat_density_and_get_wider_with_frequency() -> None:
    flat = Autospectrum(np.arange(2.0, 25_601.0, 2.0), np.full(12_800, 3.0))
    bands = log_bands(flat, 200)
    assert np.allclose(bands.density, 3.0)
    assert len(bands.frequency_hz) <= 200
    assert np.all(np.diff(bands.frequency_hz) > 0)


@pytest.mark.parametrize("window", ["boxcar", "hann", "flattop"])
def test_a_sine_on_a_line_has_its_mean_square_and_its_amplitude(window: str) -> None:
    values = 3.0 * np.sin(2 * np.pi * 100 * np.arange(4096) / 1024 + 0.3)
    spectrum = averaged_spectrum(values, 1024.0, Segmenting(1024, window=window))
    line = int(np.flatnonzero(spectrum.frequency_hz == 100.0)[0])
    # Windows that are sums of cosines leave nothing of a sine on a line to its image below zero.
    assert spectrum.power[line] == pytest.approx(4.5, rel=1e-12)
    assert spectrum.amplitude[line] == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize(("window", "lines"), [("boxcar", 1.0), ("hann", 1.5), ("flattop", 3.7702)])
def test_the_noise_bandwidth_is_that_of_the_window(window: str, lines: float) -> None:
    spectrum = averaged_spectrum(np.zeros(4096), 4096.0, Segmenting(4096, window=window))
    assert spectrum.noise_bandwidth_hz == pytest.approx(lines, rel=1e-4)  # the flat top's to five digits


def test_a_line_at_half_the_sampling_rate_counts_once() -> None:
    values = 2.0 * (-1.0) ** np.arange(64)
    spectrum = averaged_spectrum(values, 64.0, Segmenting(64, window="boxcar"))
    assert spectrum.frequency_hz[-1] == 32.0
    assert spectrum.amplitude[-1] == pytest.approx(2.0, rel=1e-12)
    assert spectrum.density.sum() == pytest.approx(4.0, rel=1e-12)  # lines 1 Hz apart


@pytest.mark.parametrize("samples", [256, 255])
def test_the_density_is_that_of_scipy(samples: int) -> None:
    values = np.random.default_rng(4).normal(size=5000)
    frequency, density = signal.welch(values, 1000.0, nperseg=samples)
    spectrum = averaged_spectrum(values, 1000.0, Segmenting(samples))
    assert spectrum.frequency_hz == pytest.approx(frequency[1:], rel=1e-14)
    assert spectrum.density == pytest.approx(density[1:], rel=1e-10)  # rounding of some 40 sums


NOISE = np.random.default_rng(5).normal(size=700).astype(np.float32)
NOISE[123] = np.nan
OVERLOADED = np.arange(700) // 20 == 20


@settings(deadline=None, max_examples=40)
@given(cuts_of(700))
def test_blocks_of_any_size_give_the_spectrum_of_the_whole(cuts: list[int]) -> None:
    segmenting = Segmenting(64, overlap=0.7)
    average = SpectrumAverage(100.0, segmenting)
    for block in blocks(700, cuts):
        average.add(NOISE[block], OVERLOADED[block])
    whole = averaged_spectrum(NOISE, 100.0, segmenting, OVERLOADED)
    assert np.array_equal(average.result().density, whole.density)
    assert average.result().averages == whole.averages > 10


def test_a_segment_that_is_flagged_or_not_finite_is_left_out() -> None:
    values = np.random.default_rng(6).normal(size=500)
    segmenting = Segmenting(100, overlap=0.0)
    rest = averaged_spectrum(np.concatenate((values[:100], values[200:300], values[400:])), 10.0, segmenting)
    values[150] = 1e6
    values[399] = np.inf
    found = averaged_spectrum(values, 10.0, segmenting, np.arange(500) == 150)
    assert found.averages == rest.averages == 3
    assert np.array_equal(found.density, rest.density)


def test_without_a_segment_there_is_no_density() -> None:
    spectrum = averaged_spectrum(np.ones(99), 10.0, Segmenting(100))
    assert spectrum.averages == 0
    assert np.isnan(spectrum.amplitude).all()


def test_an_exponential_average_forgets() -> None:
    sine = np.sin(2 * np.pi * 8 * np.arange(64) / 64)
    average = SpectrumAverage(64.0, Segmenting(64, overlap=0.0, window="boxcar"), memory=4)
    for amplitude in (1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0):
        average.add(amplitude * sine)
    # From 1/2 towards 2 by a quarter of the rest with each segment.
    assert average.result().power[7] == pytest.approx(0.5 + 1.5 * (1 - 0.75**3), rel=1e-12)
