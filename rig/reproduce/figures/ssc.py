"""SSC Figures 16 and 17: contact forces of the slider at 230 rpm, their peaks and impacts over speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from rig.pages.content import Figure
from rig.pages.plots import Plots
from rig.reproduce.explanations import SPATIAL
from rig.reproduce.figure import (
    OURS,
    OURS_LINE,
    SECOND,
    TEXT_LINE,
    THIRD,
    WHAT_IF_STYLE,
    Effort,
    Outcome,
    PaperFigure,
)
from rig.reproduce.statement import Statement, about, above, below, between
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank, rig_of_the_figures
from sim_twin.rigs.spatial_slider_crank.rig import MODEL
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
RATE = 51_200.0
VERTICAL = ("slider.force_3", "slider.force_4", "slider.force_7", "slider.force_8")
SETTLE_TURNS = 12
_FLIGHT_S = 1e-3
_TOUCHES_N = 0.05


@dataclass(frozen=True, slots=True)
class Turns:
    """Forces in N of the vertical sensors, shape (4, turns * samples), a whole number of samples a turn."""

    forces: Array
    samples: int

    @property
    def count(self) -> int:
        """How many turns."""
        return int(self.forces.shape[1] // self.samples)

    def peaks(self, sensor: int) -> Array:
        """Largest force of each turn in N, shape (turns,)."""
        return np.asarray(self.forces[sensor].reshape(self.count, self.samples).max(axis=1))

    def peak_times(self, sensor: int) -> Array:
        """When in its turn the largest force comes, s, shape (turns,)."""
        return np.asarray(self.forces[sensor].reshape(self.count, self.samples).argmax(axis=1) / RATE)

    def impacts_a_turn(self, sensor: int) -> float:
        """Contacts that begin after at least 1 ms without force; 0.05 N, a sensor's noise, is none."""
        change = np.diff((self.forces[sensor] > _TOUCHES_N).astype(np.int8))
        begins, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        before = np.searchsorted(ends, begins) - 1
        known = before >= 0
        return float(np.count_nonzero(begins[known] - ends[before[known]] >= _FLIGHT_S * RATE) / self.count)

    def impacts(self) -> float:
        """Impacts a turn at the sensor that sees most."""
        return max(self.impacts_a_turn(sensor) for sensor in range(len(VERTICAL)))


def run(rig: SpatialSliderCrank, speed_rpm: float, count: int) -> Turns:
    """`count` turns after the first twelve; raises SimulationFailed."""
    samples = round(60 / speed_rpm * RATE)
    drive = SpeedDrive(2 * np.pi * RATE / samples)  # whole samples a turn: off by 1e-4 at most
    truth = MODEL.truth(Twin(rig, drive), RATE, False)
    truth.change_drive(drive, 0.0, 0.0)
    rows = truth.advance(samples * (SETTLE_TURNS + count))
    if truth.status is not Status.COMPLETED:
        raise SimulationFailed(f"the spatial crank stopped at {speed_rpm:g} rpm", truth.status.advice)
    kept = [rows[rig.channels.index(name), samples * SETTLE_TURNS :] for name in VERTICAL]
    return Turns(np.array(kept), samples)


_PLACE_16 = "4D, Fig. 16"
_SPEED_RPM, _CYCLES = 230.0, 38
_SMALLEST_N, _LARGEST_N = 27.0, 80.0
_SHIFT_M = 5e-10
_MOVED_S = 1e-3


def _compute_16(effort: Effort) -> Outcome:
    rig = rig_of_the_figures()
    turns = run(rig, _SPEED_RPM, effort.of(_CYCLES, 10))
    moved = run(replace(rig, contact_span=rig.contact_span + _SHIFT_M), _SPEED_RPM, turns.count)
    sensor = once_a_turn(turns)
    peaks = turns.peaks(sensor)
    others = ", ".join(
        f"{VERTICAL[k]} {turns.peaks(k).min():.0f} to {turns.peaks(k).max():.0f} N"
        for k in range(len(VERTICAL))
        if k != sensor
    )
    shift = float(np.abs(moved.peak_times(sensor) - turns.peak_times(sensor)).max())
    statements = [
        Statement(
            "smallest peak of a cycle, 230 rpm",
            about(_SMALLEST_N, "approximately 27 N", _PLACE_16),
            float(peaks.min()),
            "N",
            remark=SPATIAL,
        ),
        Statement(
            "largest peak of a cycle, 230 rpm",
            about(_LARGEST_N, "80 N", _PLACE_16),
            float(peaks.max()),
            "N",
            remark=f"At {VERTICAL[sensor]}, which sees nearest to one impact a cycle, as the text's does. "
            f"The others: {others}.",
        ),
        Statement(
            "largest over smallest peak",
            about(_LARGEST_N / _SMALLEST_N, "27 N to 80 N: 2.96", _PLACE_16),
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
    return Outcome(statements, [_force_chart(turns, sensor)])


def once_a_turn(turns: Turns) -> int:
    """The vertical sensor that sees nearest to one impact a turn, as the text's does."""
    rates = [turns.impacts_a_turn(sensor) for sensor in range(len(VERTICAL))]
    return int(np.argmin([abs(np.log(max(rate, 1e-3))) for rate in rates]))


def _force_chart(turns: Turns, sensor: int) -> Figure:
    chart = Plots(rows=1, columns=1, row_px=280, legend=True)
    chart.axes(0, VERTICAL[sensor], "time, s", "contact force, N")
    force = turns.forces[sensor]
    chart.outline(0, "ours", np.arange(len(force)) / RATE, force, OURS_LINE)
    end = len(force) / RATE
    chart.line(
        0,
        "text: peaks between 27 and 80 N",
        [0, end, np.nan, 0, end],
        [_SMALLEST_N] * 2 + [np.nan] + [_LARGEST_N] * 2,
        TEXT_LINE,
    )
    return chart.figure("ssc-16", f"{turns.count} cycles at 230 rpm, clearances 0.25 mm.")


FIGURE_16 = PaperFigure("ssc-16", "Contact force at a vertical sensor, 230 rpm", _PLACE_16, _compute_16)


_PLACE_17 = "4D, Fig. 17"
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


def _compute_17(effort: Effort) -> Outcome:
    speeds = effort.of(tuple(np.arange(50.0, 251.0, 10.0)), _FEW_RPM)
    cycles = effort.of(12, 5)
    rig = rig_of_the_figures()
    runs = {speed: run(rig, speed, cycles) for speed in speeds}
    smooth = {speed: run(replace(rig, friction=0.0), speed, cycles) for speed in speeds}
    statements = [*_onset(runs), *_spread(runs), _without_friction(effort, runs, smooth)]
    return Outcome(statements, [_speed_chart(runs, smooth)])


def _onset(runs: Runs) -> list[Statement]:
    onset = min((speed for speed, turns in runs.items() if turns.impacts() >= _BEGUN), default=float("inf"))
    slow, fast = min(runs), max(runs)
    return [
        Statement(
            "impacts in the guide begin at",
            between(*_TEXT_ONSET_RPM, "between 150 and 200 rpm", _PLACE_17),
            onset if np.isfinite(onset) else fast,
            "rpm",
            remark=_IMPACT + " " + SPATIAL,
        ),
        Statement(
            f"largest peak at {fast:g} rpm over that at {slow:g} rpm",
            above(_DRAMATIC, "peak forces increase dramatically", _PLACE_17),
            float(_strongest(runs[fast]).max() / _strongest(runs[slow]).max()),
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
            below(_CONSISTENT, "consistent from cycle to cycle", _PLACE_17),
        ),
        (
            "spread of cycle peaks with impacts: largest over smallest, less one",
            loud,
            above(_CONSISTENT, "variation from one cycle to the next: the lines diverge", _PLACE_17),
        ),
    ):
        if chosen:
            spread = float(np.median([spread_of(turns) for turns in chosen]))
            remark = f"Median over {len(chosen)} speeds. Counted as consistent: within 10 %."
            found.append(Statement(name, claim, spread, "%", remark=remark))
    return found


def spread_of(turns: Turns) -> float:
    """Largest over smallest cycle peak less one, in percent, at the sensor with the largest force."""
    peaks = _strongest(turns)
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


def _speed_chart(runs: Runs, smooth: Runs) -> Figure:
    chart = Plots(rows=1, columns=2, row_px=320, legend=True)
    speeds = np.array(sorted(runs))
    zero = {"rangemode": "tozero"}
    chart.axes(0, "peak of a cycle, strongest vertical sensor", "speed, rpm", "contact force, N", y_axis=zero)
    chart.axes(1, "impacts, busiest vertical sensor", "speed, rpm", "impacts a cycle", y_axis=zero)
    largest = [_strongest(runs[speed]) for speed in speeds]
    chart.line(0, "ours, largest peak", speeds, [peaks.max() for peaks in largest], OURS)
    chart.line(0, "ours, smallest peak", speeds, [peaks.min() for peaks in largest], SECOND)
    chart.line(
        0,
        "ours, largest peak without friction",
        speeds,
        [_strongest(smooth[s]).max() for s in speeds],
        WHAT_IF_STYLE,
    )
    chart.line(1, "ours, impacts", speeds, [runs[speed].impacts() for speed in speeds], THIRD)
    chart.line(
        1,
        "ours, impacts without friction",
        speeds,
        [smooth[speed].impacts() for speed in speeds],
        WHAT_IF_STYLE,
    )
    for cell, top in enumerate(
        (max(peaks.max() for peaks in largest), max(t.impacts() for t in runs.values()))
    ):
        x = [value for end in _TEXT_ONSET_RPM for value in (end, end, np.nan)]
        chart.line(cell, "text: impacts begin between these", x, [0.0, float(top), np.nan] * 2, TEXT_LINE)
    return chart.figure("ssc-17", "Clearances 0.25 mm, axis angle 90 degrees.")


def _strongest(turns: Turns) -> Array:
    return max((turns.peaks(sensor) for sensor in range(len(VERTICAL))), key=np.max)


FIGURE_17 = PaperFigure(
    "ssc-17", "Peaks and their spread over speed, onset of impacts, friction", _PLACE_17, _compute_17
)
