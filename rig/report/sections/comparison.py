"""Which twin lies closer to what was measured, the nominal or the repaired; empty without the two."""

from __future__ import annotations

import numpy as np

from rig.report.closeness import Closeness, closeness, overall
from rig.report.content import BigNumber, BigNumbers, Figure, Part
from rig.report.plot import PlotGrid
from rig.report.record import RunRecord

_ROW_PX = 44
_CAPTION = (
    "Level difference between the autospectra of twin and measurement, rms over the bands within 40 dB of "
    "the channel's strongest. Shorter is closer. The blue bar is the difference between the measurement's "
    "own halves: no twin can come much closer, and a healthy rig's twin stays somewhat further off."
)


def parts(run: RunRecord) -> list[Part]:
    """How far either twin lies from the measurement, in all and for each channel."""
    channels = closeness(run)
    if not channels:
        return []
    return [_numbers(channels), _figure(channels)]


def _numbers(channels: list[Closeness]) -> BigNumbers:
    total = overall(channels)
    return BigNumbers(
        [
            BigNumber("Nominal twin lies off by", f"{total.nominal_db:.1f} dB", "autospectra, all channels"),
            BigNumber("Repaired twin lies off by", f"{total.repaired_db:.1f} dB", "with the effects in it"),
            BigNumber("The run's halves differ by", f"{total.halves_db:.1f} dB", "what chatter alone does"),
        ]
    )


def _figure(channels: list[Closeness]) -> Figure:
    """Bars from left to right, the channels from top to bottom in the order of the run."""
    grid = PlotGrid(rows=1, columns=1, row_px=_ROW_PX * len(channels) + 10)
    names = {"tickvals": list(range(len(channels))), "ticktext": [each.channel for each in channels]}
    x = {"title": {"text": "dB"}, "rangemode": "tozero"}
    grid.axes(0, "Distance to the measurement", x, {**names, "autorange": "reversed"})
    rows = np.arange(len(channels), dtype=np.float64)
    for whose, lengths in (
        ("measured", [each.halves_db for each in channels]),
        ("nominal", [each.nominal_db for each in channels]),
        ("repaired", [each.repaired_db for each in channels]),
    ):
        grid.lying_bars(0, whose, rows, np.array(lengths))
    return grid.figure("comparison", _CAPTION)
