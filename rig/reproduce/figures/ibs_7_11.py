"""IBS Figures 7 and 11: contact force over half a cycle at 5 Hz, and its autospectrum at 20 Hz."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.signals.spectrum import Autospectrum, autospectrum, log_bands
from rig.pages.content import Figure
from rig.pages.plots import Plots
from rig.reproduce.beam_runs import (
    DRIVE_N,
    RATE,
    SETTLE_S,
    WHAT_IF_AMPLITUDE_N,
    beam,
    forces,
    peaks_of,
    what_if_beam,
)
from rig.reproduce.figure import (
    LEVEL,
    OURS_LINE,
    SEED,
    TEXT,
    TEXT_LINE,
    WHAT_IF,
    Effort,
    Outcome,
    PaperFigure,
    Sample,
    Statement,
    about,
    above,
    of_ratio,
    of_sample,
)
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.rigs.impact_beam.structure import structure_of
from sim_twin.twin import Twin

Array = NDArray[np.float64]
_POSITION = "Not a test: the drive's position, 0.69 L, is not in the text and was chosen to give these 6.2 N."
_PLACE_7 = "3D, Fig. 7"
_FREQUENCY = 5.0
_NOMINAL_N, _PEAK_N, _STEADY_S, _RELEASE_S = 6.2, 34.0, 0.020, 0.1
_CYCLE = round(RATE / _FREQUENCY)
_BOUNCING_BY_S = 0.060


class History(NamedTuple):
    """Of each cycle, shape (n,), in s from the drive's rising zero: first touch, end of bouncing, release."""

    touch_s: Array
    steady_s: Array
    release_s: Array


def history(upper: Array) -> History:
    """Times of the contacts on the upper side; `upper` (N, shape (n,)) begins with the drive's rising zero.

    Bouncing ends where the last contact that begins within 60 ms begins.
    """
    rows = []
    for start in range(0, len(upper) - _CYCLE + 1, _CYCLE):
        change = np.diff((upper[start : start + _CYCLE] > 0).astype(np.int8))
        begins, ends = np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1) + 1
        early = begins[begins < _BOUNCING_BY_S * RATE]
        if len(early) and len(ends):
            rows.append((early[0], early[-1], ends[-1]))
    return History(*(np.array(rows, dtype=float).reshape(-1, 3).T / RATE))


def resting_force(rig: ImpactBeam, force: float) -> float:
    """Contact force in N while `force` N presses the beam steadily against the upper side."""
    s, k = structure_of(rig), rig.contact_stiffness
    stiffness = s.K + k * np.outer(s.contact, s.contact)
    pressed = np.linalg.solve(stiffness, force * s.drive + k * rig.clearance * s.contact)
    return float(k * (s.contact @ pressed - rig.clearance))


def _compute_7(effort: Effort) -> Outcome:
    duration = effort.of(20.0, 3.0)
    run = forces(beam(), SineDrive(DRIVE_N, _FREQUENCY), duration)
    shaken_run = forces(what_if_beam(0.127), SineDrive(WHAT_IF_AMPLITUDE_N, _FREQUENCY), effort.of(5.0, 2.0))
    resting, times = resting_force(beam(), DRIVE_N), history(run.upper)
    peaks, shaken = peaks_of(run), peaks_of(shaken_run)
    peak = about(_PEAK_N, "about 34 N", _PLACE_7)
    steady = about(_STEADY_S, "at about 0.020 s", _PLACE_7)
    statements = [
        of_sample("initial peak, 5 Hz, ±0.127 mm", peak, peaks, "N", LEVEL),
        of_sample("the same, what if", peak, shaken, "N", WHAT_IF, what_if=True),
        Statement(
            "contact force of the drive alone",
            about(_NOMINAL_N, "about 6.2 N", _PLACE_7),
            resting,
            "N",
            remark=_POSITION,
        ),
        of_ratio(
            "initial peak over the force of the drive alone",
            above(5.0, "more than 5 times", _PLACE_7),
            (peaks.mean / resting, peaks.error / resting),
            "Follows from the level of the peaks.",
        ),
        of_sample(
            "bouncing ends",
            steady,
            Sample(times.steady_s),
            "s",
            "Where the last contact begins that begins within 60 ms of the drive's rising zero. More damping "
            "ends it earlier.",
        ),
        of_sample(
            "the same, what if",
            steady,
            Sample(history(shaken_run.upper).steady_s),
            "s",
            WHAT_IF,
            what_if=True,
        ),
        of_sample(
            "the beam leaves its bearing",
            about(_RELEASE_S, "at about 0.1 s", _PLACE_7),
            Sample(times.release_s),
            "s",
            "Last release after the drive's rising zero.",
        ),
    ]
    return Outcome(statements, [_history_chart(run.upper[:_CYCLE], times)])


def _history_chart(upper: Array, times: History) -> Figure:
    chart = Plots(rows=1, columns=2, row_px=300, legend=True)
    for cell, (title, end_ms) in enumerate((("half a cycle", 110.0), ("first impacts", 26.0))):
        axis = {"range": [0.0, end_ms]}
        chart.axes(cell, title, "time after the drive's rising zero, ms", "contact force, N", x_axis=axis)
        force = upper[: round(1e-3 * end_ms * RATE)]
        times_ms = 1e3 / RATE * np.arange(len(force))
        chart.outline(cell, "ours, one half cycle", times_ms, force, OURS_LINE)
        t = np.linspace(0, 0.5 / _FREQUENCY, 200)
        t = t[t <= 1e-3 * end_ms]
        sine = _NOMINAL_N * np.sin(2 * np.pi * _FREQUENCY * t)
        chart.line(cell, "text: force of the drive alone (6.2 N)", 1e3 * t, sine, TEXT_LINE)
        marks = [(1e3 * times.touch_s[0], _PEAK_N), (1e3 * _STEADY_S, 0.0), (1e3 * _RELEASE_S, 0.0)]
        seen = [mark for mark in marks if mark[0] <= end_ms]
        chart.line(
            cell,
            "text: peak 34 N, bouncing ends 20 ms, contact ends 100 ms",
            [mark[0] for mark in seen],
            [mark[1] for mark in seen],
            TEXT,
        )
    return chart.figure(
        "ibs-7",
        "Steel beam, rigid base; the first half cycle after 1 s. Text has the peak's force, not its time.",
    )


FIGURE_7 = PaperFigure("ibs-7", "Contact force over half a cycle at 5 Hz", _PLACE_7, _compute_7)

_PLACE_11 = "3D, Fig. 11"
_SAMPLE_RATE = 51_200.0
_CHANNEL = "contact.force_upper"
_NOISE_N = 0.05
_BAND_HZ = (10_000.0, 11_000.0)
_BANDS = 400
_RESOLUTION_HZ = 4.0


def _compute_11(effort: Effort) -> Outcome:
    drive, rig = SineDrive(DRIVE_N, 20.0), beam()
    twin = Twin(rig, drive, MODEL.nominal_sensors(rig, drive))
    stream = MODEL.stream(twin, _SAMPLE_RATE, np.random.default_rng(SEED))
    stream.drive(drive)
    stream.advance(round(SETTLE_S * _SAMPLE_RATE))
    seen = stream.advance(round(effort.of(20.0, 2.0) * _SAMPLE_RATE))[twin.channels.index(_CHANNEL)]
    spectrum = autospectrum(np.asarray(seen), _SAMPLE_RATE, _RESOLUTION_HZ)
    floor = _NOISE_N**2 / (_SAMPLE_RATE / 2)
    low, high = _BAND_HZ
    band = (spectrum.frequency_hz >= low) & (spectrum.frequency_hz < high)
    level = 10 * float(np.log10(np.mean(spectrum.density[band]) / floor))
    statement = Statement(
        "density from 10 to 11 kHz over the sensor's own noise",
        above(10.0, "significant excitation even above 10 kHz", _PLACE_11),
        level,
        "dB",
        remark="Counted as significant: ten times the density of the sensor's noise, 0.05 N rms.",
    )
    return Outcome([statement], [_spectrum_chart(spectrum, floor)])


def _spectrum_chart(spectrum: Autospectrum, floor: float) -> Figure:
    chart = Plots(rows=1, columns=1, row_px=320, legend=True)
    chart.axes(
        0,
        "contact.force_upper",
        "frequency, Hz",
        "autospectral density, N²/Hz",
        x_axis={"type": "log"},
        y_axis={"type": "log", "exponentformat": "power"},
    )
    smooth = log_bands(spectrum, _BANDS)
    chart.line(0, "ours", smooth.frequency_hz, smooth.density, OURS_LINE)
    chart.line(0, "the sensor's noise", [_RESOLUTION_HZ, _SAMPLE_RATE / 2], [floor, floor], TEXT_LINE)
    return chart.figure(
        "ibs-11",
        "Steel beam, ±0.127 mm, 20 Hz; with the sensor's noise and filter, averaged over narrow bands.",
    )


FIGURE_11 = PaperFigure("ibs-11", "Autospectrum of a force sensor at 20 Hz", _PLACE_11, _compute_11)
