"""SSC Figure 16: contact force at a vertical sensor of the slider over 10 s at 230 rpm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.report import content
from rig.reproduce.chart import OURS_LINE, TEXT_LINE, Chart
from rig.reproduce.claim import about, above
from rig.reproduce.explanations import SPATIAL
from rig.reproduce.figure import Effort, Figure, Outcome
from rig.reproduce.spatial_runs import RATE, VERTICAL, Turns, run
from rig.reproduce.statement import Statement
from sim_twin.rigs.spatial_slider_crank.model import rig_of_the_figures

Array = NDArray[np.float64]
_PLACE = "4D, Fig. 16"
_SPEED_RPM, _CYCLES = 230.0, 38
_SMALLEST_N, _LARGEST_N = 27.0, 80.0
_SHIFT_M = 5e-10
_MOVED_S = 1e-3


def _compute(effort: Effort) -> Outcome:
    rig = rig_of_the_figures()
    turns = run(rig, _SPEED_RPM, effort.of(_CYCLES, 10))
    moved = run(replace(rig, contact_span=rig.contact_span + _SHIFT_M), _SPEED_RPM, turns.count)
    sensor = once_a_turn(turns)
    peaks = turns.peaks(sensor)
    shift = float(np.abs(moved.peak_times(sensor) - turns.peak_times(sensor)).max())
    statements = [
        Statement(
            "smallest peak of a cycle, 230 rpm",
            about(_SMALLEST_N, "approximately 27 N", _PLACE),
            float(peaks.min()),
            "N",
            remark=SPATIAL,
        ),
        Statement(
            "largest peak of a cycle, 230 rpm",
            about(_LARGEST_N, "80 N", _PLACE),
            float(peaks.max()),
            "N",
            remark=f"At {VERTICAL[sensor]}, which sees nearest to one impact a cycle, as the text's does. "
            f"The others: {_others(turns, sensor)}.",
        ),
        Statement(
            "largest over smallest peak",
            about(_LARGEST_N / _SMALLEST_N, "27 N to 80 N: 2.96", _PLACE),
            float(peaks.max() / peaks.min()),
            remark=f"Extremes of {len(peaks)} chaotic cycles: another start gives others.",
        ),
        Statement(
            "shift of a peak's time when a contact point moves by 5e-10 m, largest",
            above(1e3 * _MOVED_S, "dramatically changes the times of impact", "4D, below Fig. 17"),
            1e3 * shift,
            "ms",
            remark="Counted as dramatic: 1 ms, the length of a bounce.",
        ),
    ]
    return Outcome(statements, [_chart(turns, sensor)])


def once_a_turn(turns: Turns) -> int:
    """The vertical sensor that sees nearest to one impact a turn, as the text's does."""
    rates = [turns.impacts_a_turn(sensor) for sensor in range(len(VERTICAL))]
    return int(np.argmin([abs(np.log(max(rate, 1e-3))) for rate in rates]))


def _others(turns: Turns, sensor: int) -> str:
    ranges = {k: turns.peaks(k) for k in range(len(VERTICAL)) if k != sensor}
    return ", ".join(f"{VERTICAL[k]} {peaks.min():.0f} to {peaks.max():.0f} N" for k, peaks in ranges.items())


def _chart(turns: Turns, sensor: int) -> content.Figure:
    chart = Chart(rows=1, columns=1, row_px=280)
    chart.axes(0, VERTICAL[sensor], "time, s", "contact force, N")
    force = turns.forces[sensor]
    chart.outline(0, "ours", 1 / RATE, force, OURS_LINE)
    end = len(force) / RATE
    chart.series(
        0,
        "text: peaks between 27 and 80 N",
        [0, end, np.nan, 0, end],
        [_SMALLEST_N] * 2 + [np.nan] + [_LARGEST_N] * 2,
        TEXT_LINE,
    )
    return chart.figure("ssc-16", f"{turns.count} cycles at 230 rpm, clearances 0.25 mm.")


FIGURE = Figure("ssc-16", "Contact force at a vertical sensor, 230 rpm", _PLACE, _compute)
