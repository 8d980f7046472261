"""What the points of a sweep came to, as a table for other programs."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np

from rig.derived.settings import RECORD
from rig.files.rigs import RIGS
from rig.files.scenario import Scenario
from rig.files.sweep import Sweep
from rig.report.record import RunRecord, read_run
from rig.report.summary import summary_of
from rig.session.frequency import OFF, UNKNOWN, FrequencyCheck
from rig.sweep.state import PointState, SweepState, write_whole

TABLE: Final = "points.csv"


HELD: Final = ("drive held [Hz]", "speed held [rpm]")
IMPACTS: Final = "impacts recorded"
A_CYCLE: Final = "impacts a cycle"
PEAK_MEAN, PEAK_SD = "impact peak mean", "impact peak sd"
_FAILS = {OFF, UNKNOWN, "drive.not_seen", "motor.off_speed", "motor.limit"}
"""Codes of events that say of a complete record that its drive was not as asked for."""


def outcome_of(log: Path, scenario: Scenario) -> tuple[str, dict[str, float]]:
    """Read a point's complete log once: why it is not what the sweep asked for, or nothing, and its figures.

    Those by names that hold the unit, none that is not finite: what the drive was held to, impacts on the
    rig's contact forces (elsewhere on the channel that shows most of them) and their peaks in its unit,
    statistics of the peaks of half cycles where it has contact forces, then rms and peak of each channel.
    """
    sine = RIGS[scenario.rig].sine
    hertz = None if sine is None else sine.hertz(scenario.drive)
    check = None if sine is None or hertz is None else FrequencyCheck(sine.channel, hertz)
    run = read_run(log, [] if check is None else [check])
    summary = summary_of(run)
    figures = {HELD[0]: check.result().measured} if check is not None else _speed_held(run)
    figures |= _impacts(run, scenario, summary.duration_s)
    if summary.measured_peaks is not None:
        peaks = dataclasses.asdict(summary.measured_peaks)
        figures |= {"half_cycles": peaks.pop("count"), **peaks}
    for channel in summary.channels:
        if channel.measured is not None:
            figures[f"{channel.name} rms [{channel.unit}]"] = channel.measured.rms
            figures[f"{channel.name} peak [{channel.unit}]"] = channel.measured.peak
    why = "; ".join(event.text for event in run.events if event.code in _FAILS)
    return why, {name: float(value) for name, value in figures.items() if math.isfinite(value)}


def _speed_held(run: RunRecord) -> dict[str, float]:
    """Mean speed of the recorded crank."""
    speed = run.speeds.get("measured")
    rpm = np.empty(0) if speed is None else speed.values[np.isfinite(speed.values)].astype(np.float64)
    return {HELD[1]: float(rpm.mean())} if len(rpm) else {}


def _impacts(run: RunRecord, scenario: Scenario, duration_s: float) -> dict[str, float]:
    """Nothing where the log does not say that impacts were looked for."""
    if RECORD not in run.metadata:
        return {}
    kind = RIGS[scenario.rig]
    seen = [impact for impact in run.impacts if impact.origin == "measured"]
    on = kind.contacts
    if not on:
        on = tuple(channel for channel, _ in Counter(impact.channel for impact in seen).most_common(1))
    peaks = np.array([impact.peak for impact in seen if impact.channel in on])
    cycle_hz = kind.drive_frequency(dataclasses.asdict(scenario.drive)) or math.nan
    found: dict[str, float] = {IMPACTS: len(peaks), A_CYCLE: len(peaks) / (duration_s * cycle_hz or math.nan)}
    if len(peaks):
        found |= {PEAK_MEAN: float(peaks.mean()), PEAK_SD: float(peaks.std())}
    return found


def impacts_recorded(ended: PointState) -> str:
    """How many impacts a point's record holds, wherever they are told; empty where nobody looked for them."""
    return f"{ended.figures[IMPACTS]:.0f}" if IMPACTS in ended.figures else ""


def write_results(folder: Path, sweep: Sweep, state: SweepState) -> Path:
    """Write one row for each point that has ended; returns the table's path."""
    found = dict.fromkeys(name for point in state.points.values() for name in point.figures)
    names = [name for name in found if name != IMPACTS]
    keys = [axis.key for axis in sweep.axes]
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["point", *keys, "outcome", "impacts", *names, "log"])
    for point in sweep.points:
        ended = state.points.get(point.number)
        if ended is not None:
            figures = [f"{ended.figures[name]:.6g}" if name in ended.figures else "" for name in names]
            values = [point.settings[key] for key in keys]
            counted = impacts_recorded(ended)
            rows.writerow([point.number, *values, ended.outcome, counted, *figures, ended.log or ""])
    write_whole(folder / TABLE, text.getvalue().encode())
    return folder / TABLE
