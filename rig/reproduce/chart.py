"""Plots of the page: ours, the text's values, and their scatter, on the grid that reports use."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.signals.envelope import envelope
from rig.report.content import Figure
from rig.report.plot import COLOURS, PlotGrid, packed

Array = NDArray[np.float64]
_LEGEND_PX = 34
_POINTS = 3_000


@dataclass(frozen=True, slots=True)
class Style:
    """How a series is drawn: Plotly's `mode`, and the looks of line and marker."""

    colour: str
    mode: str = "lines"
    width: float = 1.8
    dash: str = "solid"
    symbol: str = "circle"
    size: int = 7


OURS_LINE = Style(COLOURS["predicted"], width=1.2)
OURS = Style(COLOURS["predicted"], "lines+markers")
SECOND = Style(COLOURS["measured"], "lines+markers", symbol="square")
SECOND_LINE = Style(COLOURS["measured"])
THIRD = Style("#5a8f29", "lines+markers", symbol="triangle-up")
WHAT_IF = Style("#7a5195", "lines+markers", dash="dash", symbol="cross-thin-open", size=8)
TEXT = Style("#111111", "markers", symbol="diamond-open", size=13)
TEXT_LINE = Style("#111111", "lines", dash="dot", width=1.4)


@dataclass(slots=True)
class Chart:
    """Plots in rows and columns, each series named in one legend above them."""

    rows: int
    columns: int
    row_px: int
    _traces: list[dict[str, Any]] = field(default_factory=list)
    _grid: PlotGrid = field(init=False)

    def __post_init__(self) -> None:
        self._grid = PlotGrid(self.rows, self.columns, self.row_px)

    def axes(self, cell: int, title: str, x: str, y: str, **more: dict[str, Any]) -> None:
        """Place a cell's axes with their labels; `x_axis` and `y_axis` are further keys of Plotly's."""
        self._grid.axes(
            cell,
            title,
            {"title": {"text": x}, **more.get("x_axis", {})},
            {"title": {"text": y}, **more.get("y_axis", {})},
        )

    def series(
        self, cell: int, name: str, x: Sequence[float] | Array, y: Sequence[float] | Array, style: Style
    ) -> None:
        """Draw a series."""
        self._add(cell, name, x, y, style, {})

    def outline(self, cell: int, name: str, step: float, values: NDArray[np.floating], style: Style) -> None:
        """Draw a trace sampled every `step` of the x axis, by its extremes where it has too many points."""
        chosen = envelope(values, _POINTS)
        self.series(
            cell, name, (step * chosen.indices).astype(np.float64), chosen.values.astype(np.float64), style
        )

    def scattered(
        self,
        cell: int,
        name: str,
        x: Sequence[float] | Array,
        y: Sequence[float] | Array,
        deviations: Sequence[float] | Array,
        style: Style,
    ) -> None:
        """Draw a series with bars of one standard deviation."""
        bars = {"type": "data", "array": _packed(deviations), "thickness": 1.2, "width": 3}
        self._add(cell, name, x, y, style, {"error_y": {**bars, "color": style.colour}})

    def figure(self, name: str, caption: str) -> Figure:
        """Return the figure with its legend."""
        plain = self._grid.figure(name, caption)
        margin = {**plain.layout["margin"], "t": plain.layout["margin"]["t"] + _LEGEND_PX}
        legend = {
            "orientation": "h",
            "yref": "container",
            "y": 1,
            "yanchor": "top",
            "x": 0,
            "font": {"size": 13},
        }
        layout = {**plain.layout, "margin": margin, "showlegend": True, "legend": legend}
        return replace(plain, traces=self._traces, layout=layout, height_px=plain.height_px + _LEGEND_PX)

    def _add(
        self,
        cell: int,
        name: str,
        x: Sequence[float] | Array,
        y: Sequence[float] | Array,
        style: Style,
        more: dict[str, Any],
    ) -> None:
        number = "" if cell == 0 else str(cell + 1)
        known = any(trace["legendgroup"] == name for trace in self._traces)
        self._traces.append(
            {
                "type": "scatter",
                "mode": style.mode,
                "name": html.escape(name),
                "legendgroup": name,
                "showlegend": not known,
                "x": _packed(x),
                "y": _packed(y),
                "line": {"color": style.colour, "width": style.width, "dash": style.dash},
                "marker": {
                    "color": style.colour,
                    "symbol": style.symbol,
                    "size": style.size,
                    "line": {"width": 2},
                },
                "xaxis": f"x{number}",
                "yaxis": f"y{number}",
                **more,
            }
        )


def _packed(values: Sequence[float] | Array) -> dict[str, str]:
    return packed(np.asarray(values, dtype=float))
