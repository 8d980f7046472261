"""Autospectra drawn on logarithmic axes, which Rerun's own plots do not have: lines in a plane."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from daq.signals import Autospectrum, log_bands
from rig.live import paths

WIDTH, HEIGHT = 16.0, 5.4
"""The picture's frame: x to the right, y downward."""

LEFT, BOTTOM = 2.2, 1.3
"""Room for the labels."""

BANDS = 240
_DRAW_ORDER = {"measured": 2.0, "nominal": 2.5, "predicted": 3.0, "repaired": 3.0}
_DECADES = 12
_LOWEST_HZ = 1.0


class SpectrumPicture:
    """One channel's measured and predicted autospectrum over decades of frequency and of density.

    The axes are drawn once, from the first spectrum, and again where the density outgrows them.
    """

    def __init__(self, recording: rr.RecordingStream, channel: str, unit: str) -> None:
        self._recording = recording
        self._channel = channel
        self._unit = unit
        self._top_decade = -math.inf
        self._frequency_decades = 1.0

    def draw(self, whose: str, spectrum: Autospectrum, sample_rate: float) -> None:
        """Log the line of `spectrum` at the recording's current time."""
        positive = spectrum.density > 0
        if not positive.any():
            return
        self._fit_axes(float(spectrum.density[positive].max()), sample_rate)
        heard = Autospectrum(spectrum.frequency_hz[positive], spectrum.density[positive])
        points = self._points(log_bands(heard, BANDS))
        line = rr.LineStrips2D(
            [points],
            colors=[paths.COLOURS[whose]],
            radii=rr.Radius.ui_points(paths.WIDTHS[whose] / 2),
            draw_order=_DRAW_ORDER[whose],
        )
        self._recording.log(paths.spectrum(self._channel, whose), line)

    def _points(self, spectrum: Autospectrum) -> NDArray[np.float64]:
        x = np.log10(spectrum.frequency_hz / _LOWEST_HZ) / self._frequency_decades * WIDTH
        y = (self._top_decade - np.log10(spectrum.density)) / _DECADES * HEIGHT
        return np.column_stack((x, np.minimum(y, HEIGHT)))[x >= 0]

    def _fit_axes(self, largest: float, sample_rate: float) -> None:
        if math.log10(largest) <= self._top_decade:
            return
        self._top_decade = math.ceil(math.log10(largest)) + 1
        self._frequency_decades = math.log10(sample_rate / 2 / _LOWEST_HZ)
        self._draw_axes()

    def _draw_axes(self) -> None:
        columns = range(math.floor(self._frequency_decades) + 1)
        x = [decade / self._frequency_decades * WIDTH for decade in columns]
        rows = range(0, _DECADES + 1, 3)
        y = [row / _DECADES * HEIGHT for row in rows]
        grid = [[(each, 0.0), (each, HEIGHT)] for each in x] + [[(0.0, each), (WIDTH, each)] for each in y]
        grid.append([(WIDTH, 0.0), (WIDTH, HEIGHT)])
        lines = rr.LineStrips2D(grid, colors=[paths.DIM], radii=rr.Radius.ui_points(0.4), draw_order=1.0)
        self._recording.log(paths.spectrum(self._channel, "axes"), lines)
        texts = [_hertz(10**decade) for decade in columns]
        texts += [f"1e{self._top_decade - row:.0f}" for row in rows]
        places = [(each, HEIGHT + 0.55) for each in x] + [(-1.1, each) for each in y]
        labels = rr.Points2D(
            places, labels=texts, show_labels=True, colors=[paths.DIM], radii=rr.Radius.ui_points(0.0)
        )
        self._recording.log(paths.spectrum(self._channel, "labels"), labels)


def _hertz(frequency: float) -> str:
    return f"{frequency / 1000:.0f} kHz" if frequency >= 1000 else f"{frequency:.0f} Hz"
