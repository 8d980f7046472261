"""IBS Figures 8 and 9: peak impact force over clearance, steel and aluminium beam, at 5 and at 20 Hz."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from rig.pages.content import Figure
from rig.pages.plots import Plots
from rig.reproduce.beam_runs import WHAT_IF_AMPLITUDE_N, Material, beam, first_peaks, what_if_beam
from rig.reproduce.figure import (
    LEVEL,
    OURS,
    SECOND,
    TEXT,
    WHAT_IF,
    WHAT_IF_STYLE,
    Effort,
    Outcome,
    PaperFigure,
    Sample,
    Statement,
    about,
    above,
    below,
    of_ratio,
    of_sample,
    ratio,
)

_CLEARANCES_MM = (0.0635, 0.127, 0.1905, 0.254, 0.3175, 0.381, 0.4445, 0.508)
_FEW_MM = (0.127, 0.254, 0.508)
_SMALLEST, _LARGEST = 0.127, 0.508
_NOMINAL_N = 6.2
_AT_5_HZ = ((0.127, 34.0), (0.254, 49.4), (0.508, 64.9), (0.508, 67.0))
"""Figure 7's text, Table 3 twice, Figure 8's text: mm and N."""
Curve = dict[float, Sample]


def _curve(
    frequency: float, clearances: Sequence[float], duration: float, material: Material = "steel"
) -> Curve:
    return {g: first_peaks(beam(g, material), frequency, duration) for g in clearances}


def _compute_8(effort: Effort) -> Outcome:
    clearances, duration = effort.of(_CLEARANCES_MM, _FEW_MM), effort.of(20.0, 2.0)
    steel, aluminium = _curve(5.0, clearances, duration), _curve(5.0, clearances, duration, "aluminium")
    shaken = {
        g: first_peaks(what_if_beam(g), 5.0, effort.of(5.0, 2.0), WHAT_IF_AMPLITUDE_N) for g in clearances
    }
    place = "3D, Fig. 8"
    rise = about(67.0 / 34.0, "34 N to 67 N: 1.97", place)
    top = about(67.0, "about 67 N (model; the measured force is even higher)", place)
    statements = [
        of_sample("initial peak, 5 Hz, ±0.508 mm", top, steel[_LARGEST], "N", LEVEL),
        of_sample("the same, what if", top, shaken[_LARGEST], "N", WHAT_IF, what_if=True),
        of_ratio(
            "the same over the force of the drive alone",
            above(10.0, "over 10 times 6.2 N", place),
            (steel[_LARGEST].mean / _NOMINAL_N, steel[_LARGEST].error / _NOMINAL_N),
        ),
        of_ratio(
            "rise of the peak from ±0.127 to ±0.508 mm",
            rise,
            ratio(steel[_LARGEST], steel[_SMALLEST]),
            "Known: without a shaker's mass and damping the approach speed grows as clearance^2/3.",
        ),
        of_ratio(
            "the same, what if", rise, ratio(shaken[_LARGEST], shaken[_SMALLEST]), WHAT_IF, what_if=True
        ),
        *_trends(steel, aluminium, place),
    ]
    chart = _chart("ibs-8", {"steel": steel, "aluminium": aluminium, "what if (steel)": shaken}, _AT_5_HZ)
    return Outcome(statements, [chart])


def _compute_9(effort: Effort) -> Outcome:
    clearances, duration = effort.of(_CLEARANCES_MM, _FEW_MM), effort.of(10.0, 1.0)
    steel, aluminium = (_curve(20.0, clearances, duration, each) for each in ("steel", "aluminium"))
    slow = _curve(5.0, _FEW_MM, effort.of(20.0, 2.0))
    place = "3D, Fig. 9"
    weakest = min((ratio(steel[g], slow[g]) for g in _FEW_MM), key=lambda pair: pair[0])
    statements = [
        *_trends(steel, aluminium, place),
        of_ratio(
            "peak at 20 Hz over peak at 5 Hz, smallest of three clearances",
            above(1.0, "forces increase with drive frequency", "3D, conclusion of Fig. 10"),
            weakest,
        ),
    ]
    return Outcome(statements, [_chart("ibs-9", {"steel": steel, "aluminium": aluminium}, ())])


def _trends(steel: Curve, aluminium: Curve, place: str) -> list[Statement]:
    ordered = sorted(steel)
    rises = {b: ratio(steel[b], steel[a]) for a, b in pairwise(ordered)}
    softer = {g: ratio(aluminium[g], steel[g]) for g in ordered}
    flattest, hardest = min(rises, key=lambda g: rises[g][0]), max(softer, key=lambda g: softer[g][0])
    return [
        of_ratio(
            "peak against that of the next smaller clearance, smallest ratio",
            above(1.0, "peaks increase with clearance", place),
            rises[flattest],
            f"At ±{flattest:g} mm.",
        ),
        of_ratio(
            "aluminium over steel beam, largest ratio",
            below(1.0, "lower for the aluminium beam", "3D, Fig. 8"),
            softer[hardest],
            f"At ±{hardest:g} mm.",
        ),
    ]


def _chart(name: str, curves: dict[str, Curve], text: Sequence[tuple[float, float]]) -> Figure:
    chart = Plots(rows=1, columns=1, row_px=340, legend=True)
    zero = {"rangemode": "tozero"}
    chart.axes(
        0, "initial peaks of half cycles", "clearance ±, mm", "peak force, N", x_axis=zero, y_axis=zero
    )
    for (label, curve), style in zip(curves.items(), (OURS, SECOND, WHAT_IF_STYLE), strict=False):
        g = np.array(sorted(curve))
        means = [curve[each].mean for each in g]
        deviations = [curve[each].deviation for each in g]
        chart.line(0, f"ours, {label}", g, means, style, deviations=deviations)
    if text:
        chart.line(0, "text (steel)", [point[0] for point in text], [point[1] for point in text], TEXT)
    none = "" if text else " The text gives no number for this figure."
    return chart.figure(name, f"Bars: ± one standard deviation of the half cycles.{none}")


FIGURE_8 = PaperFigure("ibs-8", "Peak force over clearance at 5 Hz", "3D, Fig. 8", _compute_8)
FIGURE_9 = PaperFigure("ibs-9", "Peak force over clearance at 20 Hz", "3D, Fig. 9", _compute_9)
