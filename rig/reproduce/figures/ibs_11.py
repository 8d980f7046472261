"""IBS Figure 11: autospectrum of a force sensor under 20 Hz drive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.signals.spectrum import Autospectrum, autospectrum, log_bands
from rig.report import content
from rig.reproduce.beam_runs import DRIVE_N, SETTLE_S, beam
from rig.reproduce.chart import OURS_LINE, TEXT_LINE, Chart
from rig.reproduce.claim import above
from rig.reproduce.figure import SEED, Effort, Figure, Outcome
from rig.reproduce.statement import Statement
from sim_twin.rigs.impact_beam.model import SineDrive
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.twin import Twin

_PLACE = "3D, Fig. 11"
_SAMPLE_RATE = 51_200.0
_CHANNEL = "contact.force_upper"
_NOISE_N = 0.05
_BAND_HZ = (10_000.0, 11_000.0)
_BANDS = 400
_RESOLUTION_HZ = 4.0


def _compute(effort: Effort) -> Outcome:
    spectrum = autospectrum(_sensor(effort.of(20.0, 2.0)), _SAMPLE_RATE, _RESOLUTION_HZ)
    floor = _NOISE_N**2 / (_SAMPLE_RATE / 2)
    low, high = _BAND_HZ
    band = (spectrum.frequency_hz >= low) & (spectrum.frequency_hz < high)
    level = 10 * float(np.log10(np.mean(spectrum.density[band]) / floor))
    statement = Statement(
        "density from 10 to 11 kHz over the sensor's own noise",
        above(10.0, "significant excitation even above 10 kHz", _PLACE),
        level,
        "dB",
        remark="Counted as significant: ten times the density of the sensor's noise, 0.05 N rms.",
    )
    return Outcome([statement], [_chart(spectrum, floor)])


def _sensor(duration: float) -> NDArray[np.float64]:
    """What the upper sensor gives, N, after 1 s of settling."""
    drive, rig = SineDrive(DRIVE_N, 20.0), beam()
    twin = Twin(rig, drive, MODEL.nominal_sensors(rig, drive))
    stream = MODEL.stream(twin, _SAMPLE_RATE, np.random.default_rng(SEED))
    stream.drive(drive)
    stream.advance(round(SETTLE_S * _SAMPLE_RATE))
    return np.asarray(stream.advance(round(duration * _SAMPLE_RATE))[twin.channels.index(_CHANNEL)])


def _chart(spectrum: Autospectrum, floor: float) -> content.Figure:
    chart = Chart(rows=1, columns=1, row_px=320)
    chart.axes(
        0,
        "contact.force_upper",
        "frequency, Hz",
        "autospectral density, N²/Hz",
        x_axis={"type": "log"},
        y_axis={"type": "log", "exponentformat": "power"},
    )
    smooth = log_bands(spectrum, _BANDS)
    chart.series(0, "ours", smooth.frequency_hz, smooth.density, OURS_LINE)
    chart.series(0, "the sensor's noise", [_RESOLUTION_HZ, _SAMPLE_RATE / 2], [floor, floor], TEXT_LINE)
    return chart.figure(
        "ibs-11",
        "Steel beam, ±0.127 mm, 20 Hz; with the sensor's noise and filter, averaged over narrow bands.",
    )


FIGURE = Figure("ibs-11", "Autospectrum of a force sensor at 20 Hz", _PLACE, _compute)
