import numpy as np
import pytest

from daq.signals import Autospectrum, autospectrum, log_bands

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


def test_bands_keep_a_flat_density_and_get_wider_with_frequency() -> None:
    flat = Autospectrum(np.arange(2.0, 25_601.0, 2.0), np.full(12_800, 3.0))
    bands = log_bands(flat, 200)
    assert np.allclose(bands.density, 3.0)
    assert len(bands.frequency_hz) <= 200
    assert np.all(np.diff(bands.frequency_hz) > 0)
