"""Impacts over the crank angle at which they begin, and how the peaks of half cycles scatter."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.signals.impacts import COUNTS_FROM
from rig.derived.settings import role_of
from rig.pages.content import Figure, Part, Sentence, Table
from rig.pages.plots import FROM_ZERO, Plots
from rig.pages.words import as_written, difference, number
from rig.report.crank_figures import GroupImpacts, impacts_by_group
from rig.report.record import ORIGINS, RunRecord
from rig.report.summary import half_cycles_of, mean_and_deviation
from sim_twin.rigs.channel_table import Role

_ROW_PX = 230
_COLUMNS = 2
_BIN_DEG = 10
_MOST_DOTS = 3_000
_COUNTS = (
    f"counts from a rise of {100 * COUNTS_FROM:.0f} % of what is typically the sensor's largest of a cycle, "
    "in the first ten or so as measured, for measured and predicted alike."
)
_BLOW = f"On a sensor in a contact an impact is a blow with its bounces, its peak the largest; it {_COUNTS}"
_BURST = f"On a frame that rings an impact is a burst, its peak the largest magnitude; it {_COUNTS}"
_CAPTION = (
    "Left: a dot each, at the crank angle at which the impact begins. Right: how many begin in each "
    f"{_BIN_DEG}° of a revolution. The crank angle axes move together."
)


def parts(run: RunRecord) -> list[Part]:
    """Numbers, peaks and counts over the crank angle; nothing for a rig without a shaft."""
    if not run.roles.turns:
        return []
    if not run.impacts:
        return [Sentence("The log holds no impacts.")]
    found = impacts_by_group(run)
    every = [each for by_whose in found.values() for each in by_whose.values()]
    felt = [{role_of(name) is Role.CONTACT for name in run.roles.impacts[group]} for group in found]
    told = [Sentence(_BLOW if contact else _BURST) for contact in dict.fromkeys(itertools.chain(*felt))]
    figure: Part = Sentence("Nothing told the crank angle of these impacts: neither encoder nor marker.")
    if any(np.isfinite(each.angle_deg).any() for each in every):
        figure = _figure(found)
    rows = []
    for group, by_whose in found.items():
        for whose, each in by_whose.items():
            against = None if whose == "measured" else by_whose.get("measured")
            least, most = each.counts_from  # on several channels that may not be one level
            span = f"{number(least)} to " if most > least else ""
            rows.append(
                [
                    f"{group}, {whose}",
                    span + number(most, each.unit),
                    str(len(each.peak)),
                    number(each.a_revolution),
                    *(number(value, each.unit) for value in each.spread),
                    number(float(each.peak.max()) if len(each.peak) else None, each.unit),
                    "" if against is None else difference(each.spread[0], against.spread[0]),
                ]
            )
    headings = (
        "where, whose", "counts from", "impacts", "a revolution", "mean peak", "standard deviation",
        "largest", "mean against measured",
    )  # fmt: skip
    return [*told, Table(headings, rows, "Peak of each impact"), figure]


def _figure(found: dict[str, dict[str, GroupImpacts]]) -> Figure:
    plots = Plots(rows=len(found), columns=_COLUMNS, row_px=_ROW_PX)
    degrees: dict[str, Any] = {"range": [0, 360], "tickvals": list(range(0, 361, 45))}
    for row, (group, by_whose) in enumerate(found.items()):
        left, right = _COLUMNS * row, _COLUMNS * row + 1
        factor, unit = as_written(next(iter(by_whose.values())).unit)
        titles = (
            f"peak of each impact, {unit or '-'}",
            f"impacts a revolution in each {_BIN_DEG}°",
        )
        for cell, title in zip((left, right), titles, strict=True):
            title = f"{group}: {title}"
            plots.axes(cell, title, "crank angle, °", x_axis=degrees, y_axis=FROM_ZERO, share_x_with=0)
        for whose, each in by_whose.items():
            placed = np.flatnonzero(np.isfinite(each.angle_deg))
            # at most so many, evenly chosen, that the page stays small
            chosen = placed[:: -(-len(placed) // _MOST_DOTS) or 1]
            names = [each.channels[at] for at in chosen]
            plots.dots(left, whose, each.angle_deg[chosen], factor * each.peak[chosen], names)
            if each.revolutions > 0:  # not of a crank that stands, or whose revolutions are not known
                edges = np.arange(0, 361, _BIN_DEG, dtype=np.float64)
                counted, _ = np.histogram(each.angle_deg[np.isfinite(each.angle_deg)], bins=edges)
                counts = counted / each.revolutions
                if whose == "measured":
                    plots.bars(right, whose, (edges[:-1] + edges[1:]) / 2, counts)
                else:
                    plots.line(
                        right, whose, edges, np.append(counts, counts[-1]), subject="impacts", shape="hv"
                    )
    return plots.figure("impacts", _CAPTION)


_MOST_BINS = 40
_CROWD = 3
"""So many histograms hide each other: then only the measured one is filled."""
_FORCE = "peak force, N"
_PEAKS_EXPLAINED = (
    "A half cycle is all impacts on one side before any on the other; an impact, a blow with its bounces, "
    f"{_COUNTS} 'First' is the peak of its first contact, 'max' its largest force."
)

_HEADINGS = (
    "peak", "half cycles", "mean", "standard deviation", "smallest", "largest", "mean against measured",
)  # fmt: skip

Peaks = dict[str, NDArray[np.float64]]


def peaks(run: RunRecord) -> list[Part]:
    """Histogram and distribution function of *first* and of *max*, and their numbers.

    Nothing for a rig that has no such pair of stops.
    """
    if run.roles.stops is None:
        return []
    found = {run.whose(origin): half_cycles_of(run, origin) for origin in ORIGINS}
    if all(cycles is None for cycles in found.values()):
        return [Sentence("This run has no pair of contact forces, so there are no half cycles to count.")]
    cycles = {whose: each for whose, each in found.items() if each is not None and len(each)}
    if not cycles:
        return [Sentence("No impact in this run.")]
    kinds: dict[str, Peaks] = {
        "first": {whose: each.first_n for whose, each in cycles.items()},
        "max": {whose: each.max_n for whose, each in cycles.items()},
    }
    plots = Plots(rows=2, columns=2, row_px=_ROW_PX)
    rows = []
    for column, (name, peaks) in enumerate(kinds.items()):
        _draw(plots, column, name, peaks)
        measured = peaks.get("measured")
        for whose, values in peaks.items():
            numbers = (*mean_and_deviation(values), float(values.min()), float(values.max()))
            against = ""
            if measured is not None and whose != "measured":
                against = difference(numbers[0], float(measured.mean()))
            told = [number(each, "N") for each in numbers]
            rows.append([f"{name}, {whose}", str(len(values)), *told, against])
    return [
        Sentence(_PEAKS_EXPLAINED),
        Table(_HEADINGS, rows, "Peak force of each half cycle"),
        plots.figure("peaks"),
    ]


def _draw(plots: Plots, column: int, name: str, peaks: Peaks) -> None:
    """A histogram above the distribution function, both over one force axis."""
    upper, lower = column, column + 2
    plots.axes(upper, f"{name}: half cycles per bin", _FORCE, y_axis=FROM_ZERO)
    title = f"{name}: share of half cycles up to this force"
    plots.axes(lower, title, _FORCE, y_axis={"range": [0, 1.02]}, share_x_with=upper)
    together = np.concatenate(list(peaks.values()))
    edges = np.histogram_bin_edges(together, bins=min(max(len(together) // 8, 5), _MOST_BINS))
    for whose, values in peaks.items():
        counts, _ = np.histogram(values, bins=edges)
        if whose == "measured" or len(peaks) < _CROWD:
            plots.bars(upper, whose, (edges[:-1] + edges[1:]) / 2, counts)
        else:
            outline = [0, *counts, 0]
            plots.line(upper, whose, [edges[0], *edges], outline, subject=f"peaks {name}", shape="hv")
        shares = np.arange(1, len(values) + 1) / len(values)
        plots.line(lower, whose, np.sort(values), shares, subject=f"peaks {name}", shape="hv")
