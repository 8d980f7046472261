"""Frequency response functions between one input and any number of responses, with coherence.

With X the input's lines and Y the response's, both of e^(-j omega t), and <> the average over segments:
Sxx = <X* X>, Syy = <Y* Y>, Sxy = <X* Y>. The conjugate is on the input: a response
that lags has a negative phase.

    H1 = Sxy / Sxx           unbiased where only the response is noisy
    H2 = Syy / Sxy*          unbiased where only the input is noisy
    Hv                       total least squares: both noisy, in a known ratio
    coherence = |Sxy|^2 / (Sxx Syy) = H1 / H2, 0 to 1

H has the unit of the response over that of the input.
Bendat and Piersol, Random Data, 4th ed., chapters 6 and 9; for Hv Shin and Hammond, Fundamentals of Signal
Processing for Sound and Vibration Engineers, p. 293.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.signals.spectrum import (
    SegmentCutter,
    Segmenting,
    density_scale,
    line_frequencies,
    usable,
    windowed_lines,
    without_gap,
)


@dataclass(frozen=True, slots=True)
class Frf:
    """Averages of one input and r responses over segments, without a line at 0 Hz.

    `frequency_hz` has shape (m,). The one-sided densities `input_density` (Sxx, unit^2/Hz of the input),
    `response_density` (Syy) and `cross_density` (Sxy) have shape (r, m), each over the segments that count
    for that response; NaN where there is none. `averages`, shape (r,), says how many. With a single one the
    coherence is 1, whatever the data.
    """

    frequency_hz: NDArray[np.float64]
    input_density: NDArray[np.float64]
    response_density: NDArray[np.float64]
    cross_density: NDArray[np.complex128]
    averages: NDArray[np.intp]

    @property
    def h1(self) -> NDArray[np.complex128]:
        """Shape (r, m); NaN where the input has no power."""
        return _ratio(self.cross_density, self.input_density)

    @property
    def h2(self) -> NDArray[np.complex128]:
        """Shape (r, m); NaN where input and response have nothing in common."""
        return _ratio(self.response_density, np.conj(self.cross_density))

    def hv(self, noise_ratio: float = 1.0) -> NDArray[np.complex128]:
        """Shape (r, m). `noise_ratio`: density of the response's noise over that of the input's.

        It has a unit (that of the response over the input's, squared), so that 1 is a guess as good as the
        choice of units. Large ratios lead to H1, small ones to H2.
        """
        less = self.response_density - noise_ratio * self.input_density
        root = np.sqrt(less**2 + 4 * noise_ratio * np.abs(self.cross_density) ** 2)
        # The same root of the same quadratic twice, each where its terms do not cancel.
        large = _ratio(less + root, 2 * np.conj(self.cross_density))
        small = _ratio(2 * noise_ratio * self.cross_density, root - less)
        return np.where(less > 0, large, small)

    @property
    def coherence(self) -> NDArray[np.float64]:
        """Shape (r, m), 0 to 1; NaN where either has no power."""
        return _ratio(np.abs(self.cross_density) ** 2, self.input_density * self.response_density)


class FrfAverage:
    """Frequency responses of channels whose samples come in blocks of any size; the cuts leave no trace.

    A segment counts for a response unless the input or that response has a sample in it that is flagged or
    not finite. Hand samples that are missing over as NaN.
    """

    def __init__(self, sample_rate: float, segmenting: Segmenting, responses: int = 1) -> None:
        lines = segmenting.samples // 2
        self._frequency = line_frequencies(segmenting.samples, sample_rate)
        self._cutter = SegmentCutter(segmenting)
        self._weights = segmenting.weights()
        self._scale = density_scale(self._weights, sample_rate)
        self._count = np.zeros(responses, dtype=np.intp)
        # Power of the input, power of the response, real and imaginary part of the cross spectrum.
        self._means = np.full((4, responses, lines), np.nan)

    def add(
        self,
        stimulus: NDArray[np.floating],
        responses: NDArray[np.floating],
        flagged: NDArray[np.bool_] | None = None,
    ) -> None:
        """Take the next samples: the input, shape (n,), and the responses, shape (n,) or (r, n).

        `flagged` is True for samples that must not count (an overload): shape (n,) for all channels together,
        or (1 + r, n) for the input, which comes first, and each response.
        """
        for segment in self._cutter.add(usable(np.vstack((stimulus, responses)), flagged)):
            input_good, *rest = without_gap(segment)
            if not input_good:
                continue
            good = np.array(rest)
            lines = windowed_lines(segment, self._weights)
            x, y = lines[0], lines[1:][good]
            cross = np.conj(x) * y
            power = x.real**2 + x.imag**2
            powers = np.broadcast_to(power, y.shape), y.real**2 + y.imag**2
            news = np.stack((*powers, cross.real, cross.imag))
            self._count[good] += 1
            count = self._count[good]
            means = np.where((count == 1)[:, None], news, self._means[:, good])
            self._means[:, good] = means + (news - means) * (1 / count)[:, None]

    def result(self) -> Frf:
        xx, yy, real, imaginary = self._means * self._scale
        return Frf(self._frequency, xx, yy, real + 1j * imaginary, self._count.copy())


def frf(
    stimulus: NDArray[np.floating],
    responses: NDArray[np.floating],
    sample_rate: float,
    segmenting: Segmenting,
    flagged: NDArray[np.bool_] | None = None,
) -> Frf:
    """What `FrfAverage` finds in a whole record; arguments as in its `add`."""
    count = 1 if np.ndim(responses) == 1 else len(responses)
    average = FrfAverage(sample_rate, segmenting, count)
    average.add(stimulus, responses, flagged)
    return average.result()


def _ratio(over: NDArray[Any], under: NDArray[Any]) -> NDArray[Any]:
    nothing = np.full(over.shape, np.nan, dtype=np.result_type(over, under))
    return np.asarray(np.divide(over, under, out=nothing, where=np.abs(under) > 0))
