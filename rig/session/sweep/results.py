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

from daq.derived_names import CRANK_SPEED
from daq.log import LogReader
from rig.derived import RECORD
from rig.files.rigs import RIGS
from rig.files.scenario import Scenario
from rig.files.sweep import Sweep
from rig.report.summary import summarise
from rig.session.frequency import FrequencySink
from rig.session.sweep.state import PointState, SweepState, write_whole

TABLE: Final = "points.csv"


HELD: Final = ("drive held [Hz]", "speed held [rpm]")
IMPACTS: Final = "impacts recorded"
A_CYCLE: Final = "impacts a cycle"
PEAK_MEAN, PEAK_SD = "impact peak mean", "impact peak sd"


def figures_of(log: Path, scenario: Scenario) -> dict[str, float]:
    """Figures of a point's record by names that hold the unit; none that is not finite.

    What the drive was held to, impacts on the rig's contact forces (elsewhere on the channel that shows most
    of them) and their peaks in its unit, statistics of the peaks of half cycles where it has contact forces,
    then rms and peak of each channel.
    """
    summary = summarise(log)
    with LogReader(log) as reader:
        figures = _held(reader, scenario) | _impacts(reader, scenario, summary.duration_s)
    if summary.measured_peaks is not None:
        peaks = dataclasses.asdict(summary.measured_peaks)
        figures |= {"half_cycles": peaks.pop("count"), **peaks}
    for channel in summary.channels:
        if channel.measured is not None:
            figures[f"{channel.name} rms [{channel.unit}]"] = channel.measured.rms
            figures[f"{channel.name} peak [{channel.unit}]"] = channel.measured.peak
    return {name: float(value) for name, value in figures.items() if math.isfinite(value)}


def _held(log: LogReader, scenario: Scenario) -> dict[str, float]:
    """Frequency of the whole recorded drive, or mean speed of the recorded crank."""
    kind = RIGS[scenario.rig]
    hertz = None if kind.sine is None else kind.sine.hertz(scenario.drive)
    if kind.sine is not None and hertz is not None:
        drive = [block for _, block in log.blocks("measured", [kind.sine.channel])]
        if not drive:
            return {}
        seen = FrequencySink(kind.sine.channel, hertz, drive[0].sample_rate)
        for block in drive:
            seen.block("measured", block)
        return {HELD[0]: seen.result().measured}
    speeds = [block.values for _, block in log.blocks("derived", [CRANK_SPEED])]
    rpm = np.concatenate(speeds, dtype=np.float64) if speeds else np.empty(0)
    rpm = rpm[np.isfinite(rpm)]
    return {HELD[1]: float(rpm.mean())} if len(rpm) else {}


def _impacts(log: LogReader, scenario: Scenario, duration_s: float) -> dict[str, float]:
    """Nothing where the log does not say that impacts were looked for."""
    if RECORD not in log.metadata:
        return {}
    kind = RIGS[scenario.rig]
    seen = [impact for impact in log.impacts() if impact.origin == "measured"]
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
