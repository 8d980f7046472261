import numpy as np
import pytest

from daq.signals.spectrum import Autospectrum, Segmenting, averaged_spectrum, third_octaves

# Exact midband frequencies of one-third octaves, to five digits, by their nominal ones (IEC 61260-1:2014).
EXACT = {
    100.0: 100.00,
    125.0: 125.89,
    160.0: 158.49,
    200.0: 199.53,
    250.0: 251.19,
    315.0: 316.23,
    400.0: 398.11,
    500.0: 501.19,
    630.0: 630.96,
    800.0: 794.33,
    1000.0: 1000.0,
    1250.0: 1258.9,
    1600.0: 1584.9,
}


def density_of(values: np.ndarray, sample_rate: float, window: str = "boxcar") -> Autospectrum:
    spectrum = averaged_spectrum(values, sample_rate, Segmenting(len(values), window=window))
    return Autospectrum(spectrum.frequency_hz, spectrum.density)


def test_bands_lie_where_the_standard_has_them() -> None:
    bands = third_octaves(Autospectrum(np.arange(1.0, 2001.0), np.ones(2000)))
    exact = dict(zip(bands.nominal_hz, bands.midband_hz, strict=True))
    for nominal, midband in EXACT.items():
        assert exact[nominal] == pytest.approx(midband, rel=5e-5)
    assert np.array_equal(bands.upper_hz[:-1], bands.lower_hz[1:])
    assert bands.upper_hz / bands.lower_hz == pytest.approx(10**0.1, rel=1e-12)


@pytest.mark.parametrize("samples", [4096, 4095])
def test_bands_add_up_to_the_mean_square(samples: int) -> None:
    values = np.random.default_rng(7).normal(size=samples)
    bands = third_octaves(density_of(values, 10_000.0))
    # Parseval's theorem; an autospectrum has no line at 0 Hz, so it lacks the mean.
    assert bands.mean_square.sum() == pytest.approx(values.var(), rel=1e-12)


def test_a_flat_density_gives_bands_their_width() -> None:
    bands = third_octaves(Autospectrum(np.arange(1.0, 2001.0), np.full(2000, 3.0)))
    inner = slice(1, -1)
    widths = bands.upper_hz[inner] - bands.lower_hz[inner]
    assert bands.mean_square[inner] == pytest.approx(3.0 * widths, rel=1e-9)


def test_a_sine_is_in_its_band_alone() -> None:
    values = 2.0 * np.sin(2 * np.pi * 1000.0 * np.arange(8192) / 8192)
    bands = third_octaves(density_of(values, 8192.0, "hann"))
    at = int(np.flatnonzero(bands.nominal_hz == 1000.0)[0])
    assert bands.mean_square[at] == pytest.approx(2.0, rel=1e-9)
    assert np.delete(bands.mean_square, at).sum() < 1e-9


def test_no_spectrum_has_no_bands() -> None:
    assert len(third_octaves(Autospectrum(np.empty(0), np.empty(0))).mean_square) == 0
