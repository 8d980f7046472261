"""Of somebody's own rig: what speaks for believing the answer, and what was measured beside the twins."""

from __future__ import annotations

import numpy as np

from rig.diagnosis.report.before_and_after import LINES, RUNNER_UP, lines_of
from rig.diagnosis.report.case import Case, plain, within
from rig.pages.content import Part, Sentence, Table
from rig.pages.plots import Plots
from rig.pages.words import probability

_SHOWN, _COLUMNS, _ROW_PX = 8, 2, 190
_CAPTION = (
    "The numbers of the fingerprints in their order, means over the blocks. Grey: how far a healthy rig "
    "usually lies from the nominal twin."
)
_AGAIN = (
    "Rigs with each cause hidden, drawn from anywhere in its range and simulated by the subject itself, and "
    "what they were taken for."
)
_WIDTHS = (
    "How wide healthy rigs are decides what is unusual. If they were narrower or wider than the subject "
    "says, this would be the answer."
)
_NOT_ASKED = (
    "How the answer hangs on the width of healthy rigs is not known: the subject has no `wider`, or "
    "there was no time."
)


def trust(case: Case) -> list[Part]:
    """Tables of the seeds, of the width of healthy rigs, and of what was hidden and found again."""
    shares = ("none", "effect", "unknown")
    by_seed = [
        [str(one["seed"]), one["verdict"], ", ".join(map(plain, one["selected"]))]
        + [probability(one["probability"][each]) for each in shares]
        for one in case.diagnosis["by_seed"]
    ]
    by_width = [
        [f"{one['width']:g} times as wide", one["verdict"], ", ".join(map(plain, one["selected"]))]
        + [probability(one["probability"][each]) for each in shares]
        for one in case.diagnosis["by_width"]
    ]
    again = [
        [plain(one["cause"]), f"{one['found']} of {one['of']}", plain(one["else"] or "")]
        for one in case.diagnosis["found_again"]
    ]
    return [
        Table(
            ("seed", "verdict", "selected", *shares),
            by_seed,
            "The same with other simulated rigs",
            words=True,
        ),
        Sentence(_WIDTHS if by_width else _NOT_ASKED),
        Table(
            ("healthy rigs", "verdict", "selected", *shares), by_width, "Width of healthy rigs", words=True
        ),
        Table(("hidden", "found again", "else mostly taken for"), again, _AGAIN, words=True),
    ]


def curves(case: Case) -> list[Part]:
    """A plot for each of the channels whose gaps are largest: measured, nominal and repaired numbers."""
    shown = [(name, run) for name, run, _ in case.largest_channels()][:_SHOWN]
    columns = min(_COLUMNS, len(shown))
    plots = Plots(-(-len(shown) // columns), columns, _ROW_PX, legend=True)
    starts, floors = case.findings.layout.starts, case.findings.floor
    for cell, (name, run) in enumerate(shown):
        inside = [k for k, each in enumerate(case.cells) if within(name, run)(each)]
        at = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in inside])
        sizes = [case.cells[k].size for k in inside]
        names = [case.cells[k].what for k, size in zip(inside, sizes, strict=True) for _ in range(size)]
        places = np.arange(len(at), dtype=np.float64)
        every = -(-len(at) // 8)
        x_axis = {"tickvals": places[::every].tolist(), "ticktext": names[::every], "tickangle": 0}
        where = f", {case.run_name(run)}" if len(case.run_numbers) > 1 else ""
        plots.axes(cell, name + where, "", case.cells[inside[0]].unit, x_axis=x_axis)
        floor = np.repeat(floors[inside], sizes)
        lines = lines_of(case, lambda numbers, at=at: numbers[at])  # type: ignore[misc]
        nominal = lines["nominal twin"]
        known = np.where(np.isfinite(floor), floor, 0.0)
        plots.band(cell, places, nominal - known, nominal + known)
        for whose, values in lines.items():
            plots.line(cell, whose, places, values, LINES.get(whose, RUNNER_UP))
    return [plots.figure("curves", _CAPTION)]
