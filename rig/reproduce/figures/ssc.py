"""SSC Figures 16 and 17: contact forces of the slider at 230 rpm, their peaks and impacts over speed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from rig.pages.content import Figure
from rig.pages.plots import FROM_ZERO, Plots
from rig.reproduce import figure as paper
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank, rig_of_the_figures
from sim_twin.rigs.spatial_slider_crank.rig import MODEL
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
_SPATIAL = (
    "Mass, inertia and contact points of the slider, friction and the direction of gravity are not in the "
    "text: chosen once and stated (decision 0005)."
)
RATE = 51_200.0
VERTICAL = ("slider.force_3", "slider.force_4", "slider.force_7", "slider.force_8")
SETTLE_TURNS = 12
_STARTS, _FEW_STARTS = (0.0, 2.0, 4.0), (0.0, 2.0)
"""Crank angles from which the chaotic motion sets out, rad."""
_SMALL, _LARGE = 0.05, 0.95
"""Of the peaks of all starts, where conditions are compared: the extremes of few cycles hang on the start."""
_FLIGHT_S = 1e-3
_TOUCHES_N = 0.05


@dataclass(frozen=True, slots=True)
class Turns:
    """Forces in N of the vertical sensors, shape (4, turns * samples), a whole number of samples a turn."""

    forces: Array
    samples: int

    @property
    def count(self) -> int:
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


def run(rig: SpatialSliderCrank, speed_rpm: float, count: int, start: float) -> Turns:
    """`count` turns after the first twelve from crank angle `start` in rad; raises SimulationFailed."""
    samples = round(60 / speed_rpm * RATE)
    drive = SpeedDrive(2 * np.pi * RATE / samples)  # whole samples a turn: off by 1e-4 at most
    truth = MODEL.truth(Twin(rig, drive), RATE, False)
    truth.change_drive(drive, start, 0.0)
    rows = truth.advance(samples * (SETTLE_TURNS + count))
    if truth.status is not Status.COMPLETED:
        raise SimulationFailed(f"the spatial crank stopped at {speed_rpm:g} rpm", truth.status.advice)
    kept = [rows[rig.channels.index(name), samples * SETTLE_TURNS :] for name in VERTICAL]
    return Turns(np.array(kept), samples)


_SPEED_RPM, _CYCLES = 230.0, 38
_SMALLEST_N, _LARGEST_N = 27.0, 80.0
_SHIFT_M = 5e-10
_MOVED_S = 1e-3


def _compute_16(effort: paper.Effort) -> paper.Outcome:
    rig = rig_of_the_figures()
    displaced = replace(rig, contact_span=rig.contact_span + _SHIFT_M)
    cycles, starts = effort.of(_CYCLES, 6), effort.of(_STARTS, _FEW_STARTS)
    runs = [run(rig, _SPEED_RPM, cycles, start) for start in starts]
    moved = [run(displaced, _SPEED_RPM, cycles, start) for start in starts]
    # the vertical sensor that sees nearest to one impact a turn, as the text's does
    rates = np.mean([[turns.impacts_a_turn(k) for k in range(len(VERTICAL))] for turns in runs], axis=0)
    sensor = int(np.argmin(np.abs(np.log(np.maximum(rates, 1e-3)))))
    peaks = [turns.peaks(sensor) for turns in runs]
    small, large = (paper.Sample(np.array([extreme(each) for each in peaks])) for extreme in (np.min, np.max))
    others = ", ".join(
        "{} {:.0f} to {:.0f} N".format(VERTICAL[k], *np.quantile(_pooled(runs, k), [_SMALL, _LARGE]))
        for k in range(len(VERTICAL))
        if k != sensor
    )
    shifts = [
        float(np.abs(other.peak_times(sensor) - turns.peak_times(sensor)).max())
        for turns, other in zip(runs, moved, strict=True)
    ]
    told = f"Of {cycles} cycles from each of {len(starts)} starts: the mean, and how the starts scatter."
    statements = [
        paper.against(
            "smallest peak of a cycle, 230 rpm",
            paper.about(_SMALLEST_N, "approximately 27 N"),
            small,
            "N",
            remark=f"{told} {_SPATIAL}",
        ),
        paper.against(
            "largest peak of a cycle, 230 rpm",
            paper.about(_LARGEST_N, "80 N"),
            large,
            "N",
            remark=f"{told} At {VERTICAL[sensor]}, which sees nearest to one impact a "
            f"cycle, as the text's does. The others: {others}.",
        ),
        paper.against(
            "largest over smallest peak",
            paper.about(_LARGEST_N / _SMALLEST_N, "27 N to 80 N: 2.96"),
            paper.Sample(large.values / small.values),
            remark=told,
        ),
        paper.Statement(
            "shift of a peak's time when a contact point moves by 5e-10 m, largest of a start",
            paper.above(1e3 * _MOVED_S, "dramatically changes the times of impact", "4D, below Fig. 17"),
            1e3 * float(np.median(shifts)),
            "ms",
            remark=f"Median over {len(starts)} starts. Counted as dramatic: 1 ms, the length of a bounce.",
        ),
    ]
    chart = Plots(rows=1, columns=1, row_px=280, legend=True)
    chart.axes(0, VERTICAL[sensor], "time, s", "contact force, N")
    force = runs[0].forces[sensor]
    chart.outline(0, "ours", np.arange(len(force)) / RATE, force, paper.OURS_LINE)
    end = len(force) / RATE
    chart.line(
        0,
        "text: peaks between 27 and 80 N",
        [0, end, np.nan, 0, end],
        [_SMALLEST_N] * 2 + [np.nan] + [_LARGEST_N] * 2,
        paper.TEXT_LINE,
    )
    caption = f"{cycles} cycles of one start at 230 rpm, clearances 0.25 mm."
    return paper.Outcome(statements, [chart.figure("ssc-16", caption)])


FIGURE_16 = paper.PaperFigure(
    "ssc-16", "Contact force at a vertical sensor, 230 rpm", "4D, Fig. 16", _compute_16
)

_FEW_RPM = (140.0, 160.0, 230.0)
_ANGLES_DEG = (90.0, 80.0, 70.0)
_BEGUN = 0.5
"""Impacts a cycle from which on they have begun."""
_CONSISTENT = 10.0
_DRAMATIC = 3.0
_TEXT_ONSET_RPM = (150.0, 200.0)
_IMPACT = (
    "Impact: a contact at a vertical sensor after 1 ms or more without force. Begun: every second cycle, "
    "from more than half of the starts."
)
Runs = dict[float, list[Turns]]
"""Of each speed in rpm, one of each start."""


def _compute_17(effort: paper.Effort) -> paper.Outcome:
    speeds = effort.of(tuple(np.arange(50.0, 251.0, 10.0)), _FEW_RPM)
    cycles, starts = effort.of(8, 3), effort.of(_STARTS, _FEW_STARTS)
    rig = rig_of_the_figures()
    runs = _over_speeds(rig, speeds, cycles, starts)
    smooth = _over_speeds(replace(rig, friction=0.0), speeds, cycles, starts)
    onset = min((speed for speed, each in runs.items() if begun(each) > 0.5), default=float("inf"))
    slow, fast = min(runs), max(runs)
    quiet = [turns for each in runs.values() if begun(each) == 0.0 for turns in each]
    loud = [turns for each in runs.values() if begun(each) == 1.0 for turns in each]
    shares = ", ".join(f"{speed:g} rpm {begun(each):.0%}" for speed, each in runs.items())
    found = []
    for name, chosen, claim in (
        (
            "spread of cycle peaks without impacts: largest over smallest, less one",
            quiet,
            paper.below(_CONSISTENT, "consistent from cycle to cycle"),
        ),
        (
            "spread of cycle peaks with impacts: largest over smallest, less one",
            loud,
            paper.above(_CONSISTENT, "variation from one cycle to the next: the lines diverge"),
        ),
    ):
        if chosen:
            spread = float(np.median([spread_of(turns) for turns in chosen]))
            remark = f"Median over {len(chosen)} runs (speed, start). Counted as consistent: within 10 %."
            found.append(paper.Statement(name, claim, spread, "%", remark=remark))
    statements = [
        paper.Statement(
            "impacts in the guide begin at",
            paper.between(*_TEXT_ONSET_RPM, "between 150 and 200 rpm"),
            onset if np.isfinite(onset) else fast,
            "rpm",
            remark=f"{_IMPACT} Share of {len(starts)} starts with begun impacts: {shares}. {_SPATIAL}",
        ),
        paper.Statement(
            f"largest peak at {fast:g} rpm over that at {slow:g} rpm",
            paper.above(_DRAMATIC, "peak forces increase dramatically"),
            _peak(runs[fast], _LARGE) / _peak(runs[slow], _LARGE),
            remark="Quantiles of 95 % over all starts. Counted as dramatic: threefold.",
        ),
        *found,
        _without_friction(effort, runs, smooth),
    ]
    return paper.Outcome(statements, [_speed_chart(runs, smooth)])


def _over_speeds(
    rig: SpatialSliderCrank, speeds: Iterable[float], cycles: int, starts: tuple[float, ...]
) -> Runs:
    return {speed: [run(rig, speed, cycles, start) for start in starts] for speed in speeds}


def begun(runs: list[Turns]) -> float:
    """Share of the starts from which impacts come at least every second cycle."""
    return float(np.mean([turns.impacts() >= _BEGUN for turns in runs]))


def spread_of(turns: Turns) -> float:
    """Largest over smallest cycle peak less one, in percent, at the sensor with the largest force."""
    peaks = _strongest([turns])
    return 100 * float(peaks.max() / peaks.min() - 1)


def _without_friction(effort: paper.Effort, runs: Runs, smooth: Runs) -> paper.Statement:
    """Conditions with impacts from every start at the rig's friction that have them from none without it."""
    pairs = [(runs[speed], smooth[speed]) for speed in runs]
    rig, speeds = rig_of_the_figures(), np.arange(100.0, 201.0, 10.0)
    for angle in effort.of(_ANGLES_DEG[1:], ()):
        turned = replace(rig, axis_angle=np.deg2rad(angle))
        rough = _over_speeds(turned, speeds, 4, _STARTS)
        even = _over_speeds(replace(turned, friction=0.0), speeds, 4, _STARTS)
        pairs += [(rough[speed], even[speed]) for speed in rough]
    with_impacts = [pair for pair in pairs if begun(pair[0]) == 1.0]
    lost = sum(begun(without) == 0.0 for _, without in with_impacts)
    return paper.Statement(
        "conditions with impacts from every start, and from none without friction in the guide",
        paper.above(0.5, "under some conditions no impacts without friction", "4D, below Fig. 17"),
        float(lost),
        "",
        remark=f"Of {len(with_impacts)} conditions (speed, axis angle) with impacts, at least every second "
        f"cycle, from each start at friction {rig.friction:g}. In the others they come "
        "from some starts without friction too.",
    )


def _speed_chart(runs: Runs, smooth: Runs) -> Figure:
    chart = Plots(rows=1, columns=2, row_px=320, legend=True)
    speeds = np.array(sorted(runs))
    chart.axes(
        0, "peak of a cycle, strongest vertical sensor", "speed, rpm", "contact force, N", y_axis=FROM_ZERO
    )
    chart.axes(1, "impacts, busiest vertical sensor", "speed, rpm", "impacts a cycle", y_axis=FROM_ZERO)
    chart.line(0, "ours, large peak (95 %)", speeds, [_peak(runs[s], _LARGE) for s in speeds], paper.OURS)
    chart.line(0, "ours, small peak (5 %)", speeds, [_peak(runs[s], _SMALL) for s in speeds], paper.SECOND)
    chart.line(
        0,
        "ours, large peak without friction",
        speeds,
        [_peak(smooth[s], _LARGE) for s in speeds],
        paper.WHAT_IF_STYLE,
    )
    chart.line(1, "ours, impacts", speeds, [_rate(runs[speed]) for speed in speeds], paper.THIRD)
    chart.line(
        1,
        "ours, impacts without friction",
        speeds,
        [_rate(smooth[speed]) for speed in speeds],
        paper.WHAT_IF_STYLE,
    )
    tops = (max(_peak(each, _LARGE) for each in runs.values()), max(_rate(each) for each in runs.values()))
    for cell, top in enumerate(tops):
        x = [value for end in _TEXT_ONSET_RPM for value in (end, end, np.nan)]
        chart.line(cell, "text: impacts begin between these", x, [0.0, top, np.nan] * 2, paper.TEXT_LINE)
    return chart.figure(
        "ssc-17", "Clearances 0.25 mm, axis angle 65 degrees; quantiles and means over several starts."
    )


def _pooled(runs: list[Turns], sensor: int) -> Array:
    return np.concatenate([turns.peaks(sensor) for turns in runs])


def _strongest(runs: list[Turns]) -> Array:
    return max((_pooled(runs, sensor) for sensor in range(len(VERTICAL))), key=np.max)


def _peak(runs: list[Turns], share: float) -> float:
    return float(np.quantile(_strongest(runs), share))


def _rate(runs: list[Turns]) -> float:
    return float(np.mean([turns.impacts() for turns in runs]))


FIGURE_17 = paper.PaperFigure(
    "ssc-17", "Peaks and their spread over speed, onset of impacts, friction", "4D, Fig. 17", _compute_17
)
