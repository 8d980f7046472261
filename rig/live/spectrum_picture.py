"""Autospectra over decades of frequency and of density."""

from __future__ import annotations

import math

import rerun as rr

from daq.signals.spectrum import Autospectrum, log_bands
from rig.live import paths
from rig.live.axes import DRAW_ORDER, AxesPicture, Axis, Frame, decades

FRAME = Frame()
BANDS = 240
_DECADES, _LABELLED = 12, 3
_LOWEST_HZ = 1.0


class SpectrumPicture:
    """One channel's measured and predicted autospectrum.

    The axes are drawn once, from the first spectrum, and again where the density outgrows them.
    """

    def __init__(self, recording: rr.RecordingStream, channel: str) -> None:
        self._recording = recording
        self._channel = channel
        self._axes = AxesPicture(recording, paths.spectrum(channel), FRAME)
        self._density: Axis | None = None

    def draw(self, whose: str, spectrum: Autospectrum, sample_rate: float) -> None:
        """Log the line of `spectrum` at the recording's current time."""
        seen = (spectrum.density > 0) & (spectrum.frequency_hz >= _LOWEST_HZ)
        if not seen.any():
            return
        largest = float(spectrum.density[seen].max())
        if self._density is None or largest > self._density.high:
            self._density = decades(10 * largest, _DECADES, _LABELLED)
        self._axes.fit(_frequencies(sample_rate / 2), self._density)
        heard = log_bands(Autospectrum(spectrum.frequency_hz[seen], spectrum.density[seen]), BANDS)
        line = rr.LineStrips2D(
            [self._axes.places(heard.frequency_hz, heard.density)],
            colors=[paths.COLOURS[whose]],
            radii=rr.Radius.ui_points(paths.WIDTHS[whose] / 2),
            draw_order=DRAW_ORDER[whose],
        )
        self._recording.log(paths.spectrum(self._channel, whose), line)


def _frequencies(highest_hz: float) -> Axis:
    count = math.floor(math.log10(highest_hz / _LOWEST_HZ)) + 1
    each = [_LOWEST_HZ * 10.0**at for at in range(count)]
    return Axis(_LOWEST_HZ, highest_hz, tuple((at, _hertz(at)) for at in each), logarithmic=True)


def _hertz(frequency: float) -> str:
    return f"{frequency / 1000:.0f} kHz" if frequency >= 1000 else f"{frequency:.0f} Hz"
