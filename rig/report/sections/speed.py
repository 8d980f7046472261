"""The crank's speed over the record, beside the speed that was set."""

from __future__ import annotations

from math import isfinite, nan

import numpy as np

from rig.derived.settings import role_of
from rig.pages.content import Part, Sentence, Table
from rig.pages.plots import Plots, points_each
from rig.pages.words import DASH, difference, number, signed
from rig.report.crank_figures import counted_by, set_rpm, speed_figures, speeds
from rig.report.record import ORIGINS, RunRecord, Trace
from sim_twin.rigs.channel_table import Role

_ROW_PX = 240
_LEAST_BAND = 0.01
"""Of the mean, at least shown above and below it, so that noise is never blown up to fill the plot."""

_EXPLANATION = (
    "Ripple is the standard deviation of 50 values a second. From an encoder each is the slope over 20 ms, "
    "which its counts alone make scatter by up to 0.1 rpm; from a marker it is the mean of the revolution in "
    "which it lies, and shows no ripple within a revolution."
)
_CAPTION = "The axis reaches 1 % to either side at least. Drag to zoom, double-click to go back."
_NO_SPEED = (
    "The log holds no speed of the crank: that is derived from an encoder or a marker as a run is recorded."
)
_IN_STEP = "The twin is held at the mean speed that was measured; only its ripple is a prediction."


def parts(run: RunRecord) -> list[Part]:
    """Numbers and lines of every speed; nothing for a rig without a shaft."""
    if not run.roles.turns:
        return []
    found = speeds(run)
    if not found:
        return [Sentence(_NO_SPEED)]
    together = [Sentence(_IN_STEP)] if "measured" in found and len(found) > 1 else []
    set_to = set_rpm(run)
    sources = {run.whose(origin): counted_by(run, origin) for origin in ORIGINS}
    rows = []
    for whose, speed in found.items():
        figures = speed_figures(speed)
        rows.append(
            [
                whose,
                sources[whose] or DASH,
                f"{figures.mean:.2f} rpm",
                DASH if set_to is None else difference(figures.mean, set_to),
                _ripple(figures.ripple, "rpm"),
                _ripple(100 * figures.ripple / abs(figures.mean) if figures.mean else nan, "%"),
                f"{figures.lowest:.2f} rpm",
                f"{figures.highest:.2f} rpm",
            ]
        )
    against = "against the set speed" if set_to is None else f"against the set {number(set_to, 'rpm')}"
    headings = ("whose", "told by", "mean", against, "ripple", "ripple of the mean", "lowest", "highest")
    return [
        Sentence(_EXPLANATION),
        *together,
        Table(headings, rows, "Speed of the crank"),
        _figure(run, found),
        *_angles(run),
    ]


def _angles(run: RunRecord) -> list[Part]:
    """How far each encoder lies from where it is predicted."""
    rows = []
    for name in run.channels:
        seen, twin = (run.traces.get((origin, name)) for origin in ("measured", "predicted"))
        if role_of(name) is not Role.ANGLE or seen is None or twin is None:
            continue
        after_s = np.arange(len(seen.values)) / seen.sample_rate + seen.begins_s - twin.begins_s
        turned = np.interp(
            after_s, np.arange(len(twin.values)) / twin.sample_rate, twin.values.astype(np.float64), nan, nan
        )
        apart = np.exp(1j * (seen.values - turned))[np.isfinite(turned) & np.isfinite(seen.values)]
        if len(apart):
            mean = np.angle(apart.mean())
            spread = float(np.degrees(np.std(np.angle(apart * np.exp(-1j * mean)))))
            rows.append([name, f"{signed(float(np.degrees(mean)))}°", f"{spread:.2f}°"])
    headings = ("channel", "measured less predicted", "scatter")
    return [Table(headings, rows, "Angles; the twin is laid on the first")] if rows else []


def _ripple(value: float, unit: str) -> str:
    return f"{value:.3f} {unit}" if isfinite(value) else DASH


def _figure(run: RunRecord, found: dict[str, Trace]) -> Part:
    grid = Plots(rows=1, columns=1, row_px=_ROW_PX)
    set_to = set_rpm(run)
    shown = [speed.values[np.isfinite(speed.values)] for speed in found.values()]
    levels = np.concatenate(shown if set_to is None else [*shown, np.array([set_to])])
    middle = float(levels.mean())
    band = _LEAST_BAND * abs(middle) or 1.0  # a crank that stands has its line in the middle
    low = min(float(levels.min()), middle - band)
    high = max(float(levels.max()), middle + band)
    room = 0.05 * (high - low)
    grid.axes(0, "rpm", "s", y_axis={"range": [low - room, high + room]})
    end_s = max(len(speed.values) / speed.sample_rate for speed in found.values())
    if set_to is not None:
        grid.line(0, "set", [0.0, end_s], [set_to, set_to], subject="set")
    for whose, speed in found.items():
        times = (np.arange(len(speed.values)) + 0.5) / speed.sample_rate
        points = points_each(len(found))
        grid.outline(0, whose, times, speed.values, subject="crank.speed", points=points)
    return grid.figure("speed", _CAPTION)
