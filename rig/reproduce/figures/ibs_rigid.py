"""IBS Figures 7, 8, 9 and 11, the beam on a rigid base: contact force over half a cycle at 5 Hz, its
autospectrum at 20 Hz, and peaks over clearance at both, of the steel and of the aluminium beam."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.signals.spectrum import autospectrum, log_bands
from rig.pages.content import Figure
from rig.pages.plots import FROM_ZERO, Plots
from rig.reproduce import figure as paper
from rig.reproduce.beam_runs import (
    DRIVE_N,
    RATE,
    SETTLE_S,
    WHAT_IF_AMPLITUDE_N,
    Material,
    beam,
    first_peaks,
    forces,
    peaks_of,
    what_if_beam,
)
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.rig import MODEL
from sim_twin.rigs.impact_beam.structure import structure_of
from sim_twin.twin import Twin

Array = NDArray[np.float64]
_POSITION = "Not a test: the drive's position, 0.69 L, is not in the text and was chosen to give these 6.2 N."
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


def _compute_7(effort: paper.Effort) -> paper.Outcome:
    duration = effort.of(20.0, 3.0)
    run = forces(beam(), SineDrive(DRIVE_N, _FREQUENCY), duration)
    shaken_run = forces(what_if_beam(0.127), SineDrive(WHAT_IF_AMPLITUDE_N, _FREQUENCY), effort.of(5.0, 2.0))
    resting, times = resting_force(beam(), DRIVE_N), history(run.upper)
    peaks, shaken = peaks_of(run), peaks_of(shaken_run)
    peak = paper.about(_PEAK_N, "about 34 N")
    steady = paper.about(_STEADY_S, "at about 0.020 s")
    statements = [
        paper.against("initial peak, 5 Hz, ±0.127 mm", peak, peaks, "N", paper.LEVEL),
        paper.so_what_if(peak, shaken, "N"),
        paper.Statement(
            "contact force of the drive alone",
            paper.about(_NOMINAL_N, "about 6.2 N"),
            resting,
            "N",
            remark=_POSITION,
        ),
        paper.against(
            "initial peak over the force of the drive alone",
            paper.above(5.0, "more than 5 times"),
            paper.Ratio(peaks.mean / resting, peaks.error / resting),
            remark="Follows from the level of the peaks.",
        ),
        paper.against(
            "bouncing ends",
            steady,
            paper.Sample(times.steady_s),
            "s",
            "Where the last contact begins that begins within 60 ms of the drive's rising zero. More damping "
            "ends it earlier.",
        ),
        paper.so_what_if(steady, paper.Sample(history(shaken_run.upper).steady_s), "s"),
        paper.against(
            "the beam leaves its bearing",
            paper.about(_RELEASE_S, "at about 0.1 s"),
            paper.Sample(times.release_s),
            "s",
            "Last release after the drive's rising zero.",
        ),
    ]
    return paper.Outcome(statements, [_history_chart(run.upper[:_CYCLE], times)])


def _history_chart(upper: Array, times: History) -> Figure:
    chart = Plots(rows=1, columns=2, row_px=300, legend=True)
    for cell, (title, end_ms) in enumerate((("half a cycle", 110.0), ("first impacts", 26.0))):
        axis = {"range": [0.0, end_ms]}
        chart.axes(cell, title, "time after the drive's rising zero, ms", "contact force, N", x_axis=axis)
        force = upper[: round(1e-3 * end_ms * RATE)]
        times_ms = 1e3 / RATE * np.arange(len(force))
        chart.outline(cell, "ours, one half cycle", times_ms, force, paper.OURS_LINE)
        t = np.linspace(0, 0.5 / _FREQUENCY, 200)
        t = t[t <= 1e-3 * end_ms]
        sine = _NOMINAL_N * np.sin(2 * np.pi * _FREQUENCY * t)
        chart.line(cell, "text: force of the drive alone (6.2 N)", 1e3 * t, sine, paper.TEXT_LINE)
        marks = [(1e3 * times.touch_s[0], _PEAK_N), (1e3 * _STEADY_S, 0.0), (1e3 * _RELEASE_S, 0.0)]
        seen = [mark for mark in marks if mark[0] <= end_ms]
        chart.line(
            cell,
            "text: peak 34 N, bouncing ends 20 ms, contact ends 100 ms",
            [mark[0] for mark in seen],
            [mark[1] for mark in seen],
            paper.TEXT,
        )
    return chart.figure(
        "ibs-7",
        "Steel beam, rigid base; the first half cycle after 1 s. Text has the peak's force, not its time.",
    )


FIGURE_7 = paper.PaperFigure("ibs-7", "Contact force over half a cycle at 5 Hz", "3D, Fig. 7", _compute_7)

_CLEARANCES_MM = (0.0635, 0.127, 0.1905, 0.254, 0.3175, 0.381, 0.4445, 0.508)
_FEW_MM = (0.127, 0.254, 0.508)
_SMALLEST, _LARGEST = 0.127, 0.508
_AT_5_HZ = ((0.127, 34.0), (0.254, 49.4), (0.508, 64.9), (0.508, 67.0))
"""Figure 7's text, Table 3 twice, Figure 8's text: mm and N."""
Curve = dict[float, paper.Sample]


def _curve(
    frequency: float, clearances: Sequence[float], duration: float, material: Material = "steel"
) -> Curve:
    return {g: first_peaks(beam(g, material), frequency, duration) for g in clearances}


def _compute_8(effort: paper.Effort) -> paper.Outcome:
    clearances, duration = effort.of(_CLEARANCES_MM, _FEW_MM), effort.of(20.0, 2.0)
    steel, aluminium = _curve(5.0, clearances, duration), _curve(5.0, clearances, duration, "aluminium")
    shaken = {
        g: first_peaks(what_if_beam(g), 5.0, effort.of(5.0, 2.0), WHAT_IF_AMPLITUDE_N) for g in clearances
    }
    rise = paper.about(67.0 / 34.0, "34 N to 67 N: 1.97")
    top = paper.about(67.0, "about 67 N (model; the measured force is even higher)")
    statements = [
        paper.against("initial peak, 5 Hz, ±0.508 mm", top, steel[_LARGEST], "N", paper.LEVEL),
        paper.so_what_if(top, shaken[_LARGEST], "N"),
        paper.against(
            "the same over the force of the drive alone",
            paper.above(10.0, "over 10 times 6.2 N"),
            paper.Ratio(steel[_LARGEST].mean / _NOMINAL_N, steel[_LARGEST].error / _NOMINAL_N),
        ),
        paper.against(
            "rise of the peak from ±0.127 to ±0.508 mm",
            rise,
            paper.ratio(steel[_LARGEST], steel[_SMALLEST]),
            remark="Known: without a shaker's mass and damping the approach speed grows as clearance^2/3.",
        ),
        paper.so_what_if(rise, paper.ratio(shaken[_LARGEST], shaken[_SMALLEST])),
        *_trends(steel, aluminium),
    ]
    chart = _peaks_chart(
        "ibs-8", {"steel": steel, "aluminium": aluminium, "what if (steel)": shaken}, _AT_5_HZ
    )
    return paper.Outcome(statements, [chart])


def _compute_9(effort: paper.Effort) -> paper.Outcome:
    clearances, duration = effort.of(_CLEARANCES_MM, _FEW_MM), effort.of(10.0, 1.0)
    steel, aluminium = (_curve(20.0, clearances, duration, each) for each in ("steel", "aluminium"))
    slow = _curve(5.0, _FEW_MM, effort.of(20.0, 2.0))
    weakest = min((paper.ratio(steel[g], slow[g]) for g in _FEW_MM), key=lambda pair: pair[0])
    statements = [
        *_trends(steel, aluminium),
        paper.against(
            "peak at 20 Hz over peak at 5 Hz, smallest of three clearances",
            paper.above(1.0, "forces increase with drive frequency", "3D, conclusion of Fig. 10"),
            weakest,
        ),
    ]
    return paper.Outcome(statements, [_peaks_chart("ibs-9", {"steel": steel, "aluminium": aluminium}, ())])


def _trends(steel: Curve, aluminium: Curve) -> list[paper.Statement]:
    ordered = sorted(steel)
    rises = {b: paper.ratio(steel[b], steel[a]) for a, b in pairwise(ordered)}
    softer = {g: paper.ratio(aluminium[g], steel[g]) for g in ordered}
    flattest, hardest = min(rises, key=lambda g: rises[g][0]), max(softer, key=lambda g: softer[g][0])
    return [
        paper.against(
            "peak against that of the next smaller clearance, smallest ratio",
            paper.above(1.0, "peaks increase with clearance"),
            rises[flattest],
            remark=f"At ±{flattest:g} mm.",
        ),
        paper.against(
            "aluminium over steel beam, largest ratio",
            paper.below(1.0, "lower for the aluminium beam", "3D, Fig. 8"),
            softer[hardest],
            remark=f"At ±{hardest:g} mm.",
        ),
    ]


def _peaks_chart(name: str, curves: dict[str, Curve], text: Sequence[tuple[float, float]]) -> Figure:
    chart = Plots(rows=1, columns=1, row_px=340, legend=True)
    chart.axes(
        0,
        "initial peaks of half cycles",
        "clearance ±, mm",
        "peak force, N",
        x_axis=FROM_ZERO,
        y_axis=FROM_ZERO,
    )
    for (label, curve), style in zip(
        curves.items(), (paper.OURS, paper.SECOND, paper.WHAT_IF_STYLE), strict=False
    ):
        g = np.array(sorted(curve))
        means = [curve[each].mean for each in g]
        deviations = [curve[each].deviation for each in g]
        chart.line(0, f"ours, {label}", g, means, style, deviations=deviations)
    if text:
        chart.line(0, "text (steel)", [point[0] for point in text], [point[1] for point in text], paper.TEXT)
    none = "" if text else " The text gives no number for this figure."
    return chart.figure(name, f"Bars: ± one standard deviation of the half cycles.{none}")


FIGURE_8 = paper.PaperFigure("ibs-8", "Peak force over clearance at 5 Hz", "3D, Fig. 8", _compute_8)
FIGURE_9 = paper.PaperFigure("ibs-9", "Peak force over clearance at 20 Hz", "3D, Fig. 9", _compute_9)

_SAMPLE_RATE = 51_200.0
_CHANNEL = "contact.force_upper"
_NOISE_N = 0.05
_BAND_HZ = (10_000.0, 11_000.0)
_BANDS = 400
_RESOLUTION_HZ = 4.0


def _compute_11(effort: paper.Effort) -> paper.Outcome:
    drive, rig = SineDrive(DRIVE_N, 20.0), beam()
    twin = Twin(rig, drive, MODEL.nominal_sensors(rig, drive))
    stream = MODEL.stream(twin, _SAMPLE_RATE, np.random.default_rng(paper.SEED))
    stream.drive(drive)
    stream.advance(round(SETTLE_S * _SAMPLE_RATE))
    seen = stream.advance(round(effort.of(20.0, 2.0) * _SAMPLE_RATE))[twin.channels.index(_CHANNEL)]
    spectrum = autospectrum(np.asarray(seen), _SAMPLE_RATE, _RESOLUTION_HZ)
    floor = _NOISE_N**2 / (_SAMPLE_RATE / 2)
    low, high = _BAND_HZ
    band = (spectrum.frequency_hz >= low) & (spectrum.frequency_hz < high)
    level = 10 * float(np.log10(np.mean(spectrum.density[band]) / floor))
    statement = paper.Statement(
        "density from 10 to 11 kHz over the sensor's own noise",
        paper.above(10.0, "significant excitation even above 10 kHz"),
        level,
        "dB",
        remark="Counted as significant: ten times the density of the sensor's noise, 0.05 N rms.",
    )
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
    chart.line(0, "ours", smooth.frequency_hz, smooth.density, paper.OURS_LINE)
    chart.line(0, "the sensor's noise", [_RESOLUTION_HZ, _SAMPLE_RATE / 2], [floor, floor], paper.TEXT_LINE)
    told = "Steel beam, ±0.127 mm, 20 Hz; with the sensor's noise and filter, averaged over narrow bands."
    return paper.Outcome([statement], [chart.figure("ibs-11", told)])


FIGURE_11 = paper.PaperFigure("ibs-11", "Autospectrum of a force sensor at 20 Hz", "3D, Fig. 11", _compute_11)
