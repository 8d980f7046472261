"""What the points of a sweep came to, as a table for other programs."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from pathlib import Path
from typing import Final

from rig.files.sweep import Sweep
from rig.report import summarise
from rig.session.sweep.state import SweepState, write_whole

TABLE: Final = "points.csv"


def figures_of(log: Path) -> dict[str, float]:
    """Figures of a record in their channels' units, by names that hold the unit; none that is not finite.

    Statistics of the peaks of half cycles where it has contact forces, then rms and peak of each channel.
    """
    summary = summarise(log)
    figures: dict[str, float] = {}
    if summary.measured_peaks is not None:
        peaks = dataclasses.asdict(summary.measured_peaks)
        figures = {"half_cycles": peaks.pop("count"), **peaks}
    for channel in summary.channels:
        if channel.measured is not None:
            figures[f"{channel.name} rms [{channel.unit}]"] = channel.measured.rms
            figures[f"{channel.name} peak [{channel.unit}]"] = channel.measured.peak
    return {name: float(value) for name, value in figures.items() if math.isfinite(value)}


def write_results(folder: Path, sweep: Sweep, state: SweepState) -> Path:
    """Write one row for each point that has ended; returns the table's path."""
    names = list(dict.fromkeys(name for point in state.points.values() for name in point.figures))
    keys = [axis.key for axis in sweep.axes]
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["point", *keys, "outcome", "impacts", *names, "log"])
    for point in sweep.points:
        ended = state.points.get(point.number)
        if ended is not None:
            figures = [f"{ended.figures[name]:.6g}" if name in ended.figures else "" for name in names]
            values = [point.settings[key] for key in keys]
            counted = "" if ended.impacts is None else ended.impacts
            rows.writerow([point.number, *values, ended.outcome, counted, *figures, ended.log or ""])
    write_whole(folder / TABLE, text.getvalue().encode())
    return folder / TABLE
