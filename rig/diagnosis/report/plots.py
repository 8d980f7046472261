"""Plots of a diagnosis, on the grid that reports of runs use."""

from __future__ import annotations

import html
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.report.content import Figure
from rig.report.plot import COLOURS, PlotGrid, packed

Array = NDArray[np.float64]
LINES: dict[str, dict[str, Any]] = {
    "measured": {"color": COLOURS["measured"], "width": 3.2},
    "nominal twin": {"color": COLOURS["predicted"], "width": 2.0, "dash": "4px,2px"},
    "repaired twin": {"color": "#111111", "width": 1.3},
}
"""Measured lies below and thick, so that it shows on both sides of a twin that meets it."""
_HEALTHY = "rgba(120, 130, 145, 0.25)"
_COLOURS = ("#f4f6f4", "#fdeebf", "#fdc56c", "#f08a3c", "#cc3d2c", "#6d0f33")
_DOUBLINGS = len(_COLOURS) - 1
_LEGEND_PX = 30


@dataclass(slots=True)
class Plots:
    """Plots in rows and columns; cells are counted from the top left."""

    rows: int
    columns: int
    row_px: int
    _traces: list[dict[str, Any]] = field(default_factory=list)
    _layout: dict[str, Any] = field(default_factory=dict)
    _grid: PlotGrid = field(init=False)

    def __post_init__(self) -> None:
        self._grid = PlotGrid(self.rows, self.columns, self.row_px)

    def axes(self, cell: int, title: str, x: dict[str, Any], y: dict[str, Any]) -> None:
        """Place a cell's axes."""
        self._grid.axes(cell, title, x, y)

    def band(self, cell: int, x: Array, low: Array, high: Array, shape: str) -> None:
        """Fill what lies between two lines: a healthy rig."""
        common = {"type": "scatter", "mode": "lines", "x": packed(x), "hoverinfo": "skip"}
        common |= {"line": {"width": 0, "shape": shape}, "legendgroup": "healthy"}
        self._add(cell, {**common, "y": packed(low), "name": "healthy", "showlegend": False})
        filled = {"fill": "tonexty", "fillcolor": _HEALTHY, "name": "healthy rig", "showlegend": cell == 0}
        self._add(cell, {**common, "y": packed(high), **filled})

    def line(self, cell: int, whose: str, x: Array, y: Array, shape: str, markers: bool = False) -> None:
        """Draw a line of one of `LINES`."""
        data = {"type": "scatter", "mode": "lines+markers" if markers else "lines"}
        line = {**LINES[whose], "shape": shape}
        named = {"name": whose, "legendgroup": whose, "showlegend": cell == 0}
        self._add(cell, {**data, **named, "x": packed(x), "y": packed(y), "line": line})

    def heat(self, cell: int, x: list[Any], rows: list[str], gaps: Array) -> None:
        """Colour a gap for each row and column; `x` are the columns' edges, or their names."""
        with np.errstate(invalid="ignore"):
            doublings = np.log2(np.maximum(gaps, 1.0))
        trace = {
            "type": "heatmap",
            "x": x,
            "y": [html.escape(name) for name in rows],
            "z": _listed(doublings),
            "customdata": _listed(gaps),
            "coloraxis": "coloraxis",
            "hovertemplate": "%{y}<br>%{x}<br>gap %{customdata:.2f}<extra></extra>",
            "xgap": 1,
            "ygap": 2,
        }
        self._layout["coloraxis"] = _COLOUR_AXIS
        self._add(cell, trace)

    def figure(self, name: str, caption: str, below_px: int = 0) -> Figure:
        """Return the figure, lines named in a legend, colours in a bar; `below_px` is for long labels."""
        plain = self._grid.figure(name, caption)
        margin = {**plain.layout["margin"]}
        margin["t"] += _LEGEND_PX
        margin["b"] += below_px
        legend = {
            "orientation": "h",
            "yref": "container",
            "y": 1,
            "yanchor": "top",
            "x": 0,
            "font": {"size": 13},
        }
        named = "coloraxis" not in self._layout
        layout = {**plain.layout, **self._layout, "margin": margin, "showlegend": named, "legend": legend}
        return replace(
            plain, traces=self._traces, layout=layout, height_px=plain.height_px + _LEGEND_PX + below_px
        )

    def _add(self, cell: int, trace: dict[str, Any]) -> None:
        axis = "" if cell == 0 else str(cell + 1)
        self._traces.append({**trace, "xaxis": f"x{axis}", "yaxis": f"y{axis}"})


def _listed(values: Array) -> list[list[float | None]]:
    return [[None if np.isnan(each) else round(float(each), 3) for each in row] for row in values]


_COLOUR_AXIS = {
    "cmin": 0,
    "cmax": _DOUBLINGS,
    "colorscale": [[k / _DOUBLINGS, colour] for k, colour in enumerate(_COLOURS)],
    "colorbar": {
        "orientation": "h",
        "x": 0.98,
        "xanchor": "right",
        "yref": "container",
        "y": 1,
        "yanchor": "top",
        "len": 0.4,
        "thickness": 10,
        "outlinewidth": 1,
        "outlinecolor": "#c5cad1",
        "tickvals": list(range(_DOUBLINGS + 1)),
        "ticktext": ["1 = healthy", *(str(2**k) for k in range(1, _DOUBLINGS)), f"≥ {2**_DOUBLINGS}"],
    },
}
