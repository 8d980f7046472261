"""PSC: accelerations of the frame at 150 and 200 rpm for the three clearance settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from rig.pages.content import Figure
from rig.pages.plots import FROM_ZERO, Plots
from rig.reproduce import figure as paper
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.rig import MODEL
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
_FRAME = (
    "Frame stiffness, mass and damping are assumed: the text has none. Ours rings at 180 to 310 Hz after "
    "impacts that come at other times each turn, and hardly moves between them."
)
_CHANNELS = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y")
_SETTINGS_MM = ((1.0, 1.0), (1.0, 2.0), (2.0, 2.0))
_LABELS = [f"{first:g} and {second:g} mm" for first, second in _SETTINGS_MM]
_SPEEDS_RPM = (150.0, 200.0)
_RATE = 51_200.0
_SETTLE_TURNS = 3
_MAINLY = 50.0
_PIECES = 36
_STYLES = (paper.SECOND, paper.OURS)


@dataclass(frozen=True, slots=True)
class Turns:
    """Accelerations of the frame in m/s2, shape (channels, turns, samples), turn by turn."""

    accelerations: Array

    def rms(self, channel: int) -> paper.Sample:
        return paper.Sample(np.sqrt(np.mean(self.accelerations[channel] ** 2, axis=1)))

    def periodic_level(self, channel: int) -> float:
        """Share of the variance of the level, rms over each 10 degrees, that repeats from turn to turn."""
        rows = self.accelerations[channel]
        pieces = rows[:, : rows.shape[1] // _PIECES * _PIECES].reshape(len(rows), _PIECES, -1)
        level = np.sqrt(np.mean(pieces**2, axis=2))
        return repeating(level - level.mean())


def repeating(rows: Array) -> float:
    """Share of the mean square of `rows`, shape (turns, n), that lies in their mean: unbiased, percent."""
    whole, turns = float(np.mean(rows**2)), len(rows)
    repeated = float(np.mean(rows.mean(axis=0) ** 2))
    return 100 * (repeated - whole / turns) / (whole * (1 - 1 / turns))


Runs = Mapping[tuple[float, tuple[float, float]], Turns]


def turns(speed_rpm: float, clearances_mm: tuple[float, float], count: int) -> Turns:
    """`count` turns after the first three; raises SimulationFailed."""
    rig = PlanarSliderCrank(clearance_1=1e-3 * clearances_mm[0], clearance_2=1e-3 * clearances_mm[1])
    drive = SpeedDrive(speed_rpm * 2 * np.pi / 60)
    truth = MODEL.truth(Twin(rig, drive), _RATE, False)
    truth.change_drive(drive, 0.0, 0.0)
    samples = round(60 / speed_rpm * _RATE)
    rows = truth.advance(samples * (_SETTLE_TURNS + count))
    if truth.status is not Status.COMPLETED:
        raise SimulationFailed(f"the crank stopped at {speed_rpm:g} rpm", truth.status.advice)
    kept = [rows[rig.channels.index(name), samples * _SETTLE_TURNS :] for name in _CHANNELS]
    return Turns(np.array(kept).reshape(len(_CHANNELS), count, samples))


def _compute(effort: paper.Effort) -> paper.Outcome:
    count = effort.of(60, 6)
    runs = {(speed, g): turns(speed, g, count) for speed in _SPEEDS_RPM for g in _SETTINGS_MM}
    channels = range(len(_CHANNELS))
    waveform = paper.Sample(
        np.array([repeating(run.accelerations[channel]) for run in runs.values() for channel in channels])
    )
    level = paper.Sample(
        np.array([run.periodic_level(channel) for run in runs.values() for channel in channels])
    )
    (slow, fast), (small, _, large) = _SPEEDS_RPM, _SETTINGS_MM
    faster = [(runs[fast, setting], runs[slow, setting]) for setting in _SETTINGS_MM]
    wider = [(runs[speed, large], runs[speed, small]) for speed in _SPEEDS_RPM]
    periodic = paper.above(_MAINLY, "mainly periodic, with some peaks of impacts", "5, below Fig. 4")
    statements = [
        *_smallest("rms at 200 over rms at 150 rpm", "amplitudes increase with speed", faster),
        *_smallest("rms at 2 and 2 mm over rms at 1 and 1 mm", "amplitudes increase with clearance", wider),
        paper.against(
            "share of the waveform's mean square that repeats each turn", periodic, waveform, "%", _FRAME
        ),
        paper.against(
            "share of the level's variance that repeats each turn",
            periodic,
            level,
            "%",
            "Level: rms over each 10 degrees of the crank. Mean over channels, speeds and settings.",
        ),
    ]
    chart = Plots(rows=len(_CHANNELS), columns=len(_SETTINGS_MM), row_px=150, legend=True)
    for row, name in enumerate(_CHANNELS):
        for column, setting in enumerate(_SETTINGS_MM):
            cell = row * len(_SETTINGS_MM) + column
            title = f"{name.replace('.acceleration', '')}, {_LABELS[column]}"
            chart.axes(cell, title, "crank angle, degrees", "m/s²", x_axis={"range": [0, 720], "dtick": 180})
            for speed, style in ((200.0, paper.OURS_LINE), (150.0, paper.SECOND_LINE)):
                trace = runs[speed, setting].accelerations[row, :2].ravel()
                degrees = 720 / len(trace) * np.arange(len(trace))
                chart.outline(cell, f"ours, {speed:g} rpm", degrees, trace, style)
    return paper.Outcome(statements, [_bars(runs), chart.figure("psc-traces", "Two turns of each setting.")])


def _smallest(what: str, text: str, pairs: Sequence[tuple[Turns, Turns]]) -> list[paper.Statement]:
    """Of each channel, the smallest of the ratios of rms of `pairs` of runs."""
    claim: paper.Claim = paper.above(1.0, text, "5, Figs. 7-10")
    found = []
    for channel, name in enumerate(_CHANNELS):
        ratios = [paper.ratio(one.rms(channel), other.rms(channel)) for one, other in pairs]
        smallest = min(ratios, key=lambda pair: pair[0])
        found.append(paper.against(f"{name}: {what}, smallest", claim, smallest))
    return found


def _bars(runs: Runs) -> Figure:
    chart = Plots(rows=1, columns=3, row_px=240, legend=True)
    for cell, name in enumerate(_CHANNELS):
        ticks = {"tickvals": [0, 1, 2], "ticktext": _LABELS, "range": [-0.3, 2.3]}
        title = name.replace(".acceleration", "")
        chart.axes(cell, title, "clearance c₁ and c₂", "rms, m/s²", x_axis=ticks, y_axis=FROM_ZERO)
        for speed, style in zip(_SPEEDS_RPM, _STYLES, strict=True):
            rms = [runs[speed, g].rms(cell) for g in _SETTINGS_MM]
            means, deviations = [each.mean for each in rms], [each.deviation for each in rms]
            chart.line(cell, f"ours, {speed:g} rpm", [0, 1, 2], means, style, deviations=deviations)
    return chart.figure(
        "psc-rms", "Bars: ± one standard deviation from turn to turn. The text gives no numbers."
    )


FIGURE = paper.PaperFigure(
    "psc", "Frame acceleration at 150 and 200 rpm for three clearance settings", "5, Figs. 5-10", _compute
)
