"""SSC Figure 17: largest and smallest cycle peak over speed, onset of impacts, and the part of friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.report import content
from rig.reproduce.chart import OURS, SECOND, TEXT_LINE, THIRD, WHAT_IF, Chart
from rig.reproduce.claim import above, below, between
from rig.reproduce.explanations import SPATIAL
from rig.reproduce.figure import Effort, Figure, Outcome
from rig.reproduce.spatial_runs import VERTICAL, Turns, run
from rig.reproduce.statement import Statement
from sim_twin.rigs.spatial_slider_crank.model import rig_of_the_figures

Array = NDArray[np.float64]
_PLACE = "4D, Fig. 17"
_FEW_RPM = (100.0, 150.0, 200.0, 230.0)
_ANGLES_DEG = (90.0, 80.0, 70.0)
_BEGUN = 0.5
"""Impacts a cycle from which on they have begun."""
_CONSISTENT = 10.0
_DRAMATIC = 3.0
_TEXT_ONSET_RPM = (150.0, 200.0)
_IMPACT = (
    "Impact: a contact at a vertical sensor after 1 ms or more without force. Begun: every second cycle."
)
Runs = dict[float, Turns]


def _compute(effort: Effort) -> Outcome:
    speeds = effort.of(tuple(np.arange(50.0, 251.0, 10.0)), _FEW_RPM)
    cycles = effort.of(12, 5)
    rig = rig_of_the_figures()
    runs = {speed: run(rig, speed, cycles) for speed in speeds}
    smooth = {speed: run(replace(rig, friction=0.0), speed, cycles) for speed in speeds}
    statements = [*_onset(runs), *_spread(runs), _without_friction(effort, runs, smooth)]
    return Outcome(statements, [_chart(runs, smooth)])


def _onset(runs: Runs) -> list[Statement]:
    onset = min((speed for speed, turns in runs.items() if turns.impacts() >= _BEGUN), default=float("inf"))
    slow, fast = min(runs), max(runs)
    strongest = {
        speed: max(turns.peaks(k).max() for k in range(len(VERTICAL))) for speed, turns in runs.items()
    }
    return [
        Statement(
            "impacts in the guide begin at",
            between(*_TEXT_ONSET_RPM, "between 150 and 200 rpm", _PLACE),
            onset if np.isfinite(onset) else fast,
            "rpm",
            remark=_IMPACT + " " + SPATIAL,
        ),
        Statement(
            f"largest peak at {fast:g} rpm over that at {slow:g} rpm",
            above(_DRAMATIC, "peak forces increase dramatically", _PLACE),
            strongest[fast] / strongest[slow],
            remark="Counted as dramatic: threefold.",
        ),
    ]


def _spread(runs: Runs) -> list[Statement]:
    quiet = [turns for turns in runs.values() if turns.impacts() == 0.0]
    loud = [turns for turns in runs.values() if turns.impacts() >= _BEGUN]
    found = []
    for name, chosen, claim in (
        (
            "spread of cycle peaks without impacts: largest over smallest, less one",
            quiet,
            below(_CONSISTENT, "consistent from cycle to cycle", _PLACE),
        ),
        (
            "spread of cycle peaks with impacts: largest over smallest, less one",
            loud,
            above(_CONSISTENT, "variation from one cycle to the next: the lines diverge", _PLACE),
        ),
    ):
        if chosen:
            spread = float(np.median([spread_of(turns) for turns in chosen]))
            remark = f"Median over {len(chosen)} speeds. Counted as consistent: within 10 %."
            found.append(Statement(name, claim, spread, "%", remark=remark))
    return found


def spread_of(turns: Turns) -> float:
    """Largest over smallest cycle peak less one, in percent, at the sensor with the largest force."""
    peaks = max((turns.peaks(sensor) for sensor in range(len(VERTICAL))), key=np.max)
    return 100 * float(peaks.max() / peaks.min() - 1)


def _without_friction(effort: Effort, runs: Runs, smooth: Runs) -> Statement:
    """Conditions with impacts at the rig's friction that have none without it."""
    pairs = [(runs[speed], smooth[speed]) for speed in runs]
    rig = rig_of_the_figures()
    for angle in effort.of(_ANGLES_DEG[1:], ()):
        turned = replace(rig, axis_angle=np.deg2rad(angle))
        for speed in np.arange(100.0, 201.0, 10.0):
            pairs.append((run(turned, speed, 8), run(replace(turned, friction=0.0), speed, 8)))
    with_impacts = [pair for pair in pairs if pair[0].impacts() >= _BEGUN]
    lost = sum(without.impacts() == 0.0 for _, without in with_impacts)
    return Statement(
        "conditions with impacts that have none without friction in the guide",
        above(0.5, "under some conditions no impacts without friction", "4D, below Fig. 17"),
        float(lost),
        "",
        remark=f"Of {len(with_impacts)} conditions (speed, axis angle) with impacts at friction "
        f"{rig.friction:g}. In the others there are impacts without friction too.",
    )


def _chart(runs: Runs, smooth: Runs) -> content.Figure:
    chart = Chart(rows=1, columns=2, row_px=320)
    speeds = np.array(sorted(runs))
    zero = {"rangemode": "tozero"}
    chart.axes(0, "peak of a cycle, strongest vertical sensor", "speed, rpm", "contact force, N", y_axis=zero)
    chart.axes(1, "impacts, busiest vertical sensor", "speed, rpm", "impacts a cycle", y_axis=zero)
    largest = [_strongest(runs[speed]) for speed in speeds]
    chart.series(0, "ours, largest peak", speeds, [peaks.max() for peaks in largest], OURS)
    chart.series(0, "ours, smallest peak", speeds, [peaks.min() for peaks in largest], SECOND)
    chart.series(
        0,
        "ours, largest peak without friction",
        speeds,
        [_strongest(smooth[s]).max() for s in speeds],
        WHAT_IF,
    )
    chart.series(1, "ours, impacts", speeds, [runs[speed].impacts() for speed in speeds], THIRD)
    chart.series(
        1, "ours, impacts without friction", speeds, [smooth[speed].impacts() for speed in speeds], WHAT_IF
    )
    for cell, top in enumerate(
        (max(peaks.max() for peaks in largest), max(t.impacts() for t in runs.values()))
    ):
        x = [value for end in _TEXT_ONSET_RPM for value in (end, end, np.nan)]
        chart.series(cell, "text: impacts begin between these", x, [0.0, float(top), np.nan] * 2, TEXT_LINE)
    return chart.figure("ssc-17", "Clearances 0.25 mm, axis angle 90 degrees.")


def _strongest(turns: Turns) -> Array:
    return max((turns.peaks(sensor) for sensor in range(len(VERTICAL))), key=np.max)


FIGURE = Figure("ssc-17", "Peaks and their spread over speed, onset of impacts, friction", _PLACE, _compute)
