"""IBS Figure 7: the history of the contact force over half a cycle at 5 Hz."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.report import content
from rig.reproduce.beam_runs import (
    DRIVE_N,
    RATE,
    WHAT_IF_AMPLITUDE_N,
    beam,
    forces,
    peaks_of,
    what_if_beam,
)
from rig.reproduce.chart import OURS_LINE, TEXT, TEXT_LINE, Chart
from rig.reproduce.claim import about, above
from rig.reproduce.explanations import LEVEL, POSITION, WHAT_IF
from rig.reproduce.figure import Effort, Figure, Outcome
from rig.reproduce.sample import Sample
from rig.reproduce.statement import Statement, of_ratio, of_sample
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.structure import structure_of

Array = NDArray[np.float64]
_PLACE = "3D, Fig. 7"
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


def _compute(effort: Effort) -> Outcome:
    duration = effort.of(20.0, 3.0)
    run = forces(beam(), SineDrive(DRIVE_N, _FREQUENCY), duration)
    shaken_run = forces(what_if_beam(0.127), SineDrive(WHAT_IF_AMPLITUDE_N, _FREQUENCY), effort.of(5.0, 2.0))
    resting, times = resting_force(beam(), DRIVE_N), history(run.upper)
    peaks, shaken = peaks_of(run), peaks_of(shaken_run)
    peak = about(_PEAK_N, "about 34 N", _PLACE)
    steady = about(_STEADY_S, "at about 0.020 s", _PLACE)
    statements = [
        of_sample("initial peak, 5 Hz, ±0.127 mm", peak, peaks, "N", LEVEL),
        of_sample("the same, what if", peak, shaken, "N", WHAT_IF, what_if=True),
        Statement(
            "contact force of the drive alone",
            about(_NOMINAL_N, "about 6.2 N", _PLACE),
            resting,
            "N",
            remark=POSITION,
        ),
        of_ratio(
            "initial peak over the force of the drive alone",
            above(5.0, "more than 5 times", _PLACE),
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
            about(_RELEASE_S, "at about 0.1 s", _PLACE),
            Sample(times.release_s),
            "s",
            "Last release after the drive's rising zero.",
        ),
    ]
    return Outcome(statements, [_chart(run.upper[:_CYCLE], times)])


def _chart(upper: Array, times: History) -> content.Figure:
    chart = Chart(rows=1, columns=2, row_px=300)
    for cell, (title, end_ms) in enumerate((("half a cycle", 110.0), ("first impacts", 26.0))):
        axis = {"range": [0.0, end_ms]}
        chart.axes(cell, title, "time after the drive's rising zero, ms", "contact force, N", x_axis=axis)
        force = upper[: round(1e-3 * end_ms * RATE)]
        chart.outline(cell, "ours, one half cycle", 1e3 / RATE, force, OURS_LINE)
        t = np.linspace(0, 0.5 / _FREQUENCY, 200)
        t = t[t <= 1e-3 * end_ms]
        sine = _NOMINAL_N * np.sin(2 * np.pi * _FREQUENCY * t)
        chart.series(cell, "text: force of the drive alone (6.2 N)", 1e3 * t, sine, TEXT_LINE)
        marks = [(1e3 * times.touch_s[0], _PEAK_N), (1e3 * _STEADY_S, 0.0), (1e3 * _RELEASE_S, 0.0)]
        seen = [mark for mark in marks if mark[0] <= end_ms]
        chart.series(
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


FIGURE = Figure("ibs-7", "Contact force over half a cycle at 5 Hz", _PLACE, _compute)
