"""Plotly figures as plain data: small plots in a grid, what was measured and each twin in its colour."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.report.content import Figure

COLOURS = {
    "measured": "#1a6fb5",
    "predicted": "#d95f02",
    "nominal": "#d95f02",
    "repaired": "#111111",
    "set": "#8a929c",
}
"""Blue and orange, apart for every kind of colour blindness and in a grey print; black is what was added.

Grey is what was asked for."""

_WIDTHS = {"measured": 2.4, "predicted": 1.1, "nominal": 1.1, "repaired": 1.1, "set": 1.0}
"""Predictions are drawn last and thin, so that what was measured shows on both sides of them."""

_POINTS_IN_ALL = 140_000
_FEWEST_POINTS, _MOST_POINTS = 600, 4_000
_TITLE_PX, _AXIS_PX, _TOP_PX = 24, 44, 26
_INK, _GRID = "#333a44", "#e3e6ea"


def packed(values: NDArray[np.floating]) -> dict[str, str]:
    """Array as Plotly reads it: base64 of little-endian float32 (NaN breaks a line)."""
    return {"dtype": "f4", "bdata": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def points_each(traces: int) -> int:
    """Points a trace may have in a figure of so many, to keep the page small and quick."""
    return min(max(_POINTS_IN_ALL // max(traces, 1), _FEWEST_POINTS), _MOST_POINTS)


@dataclass(slots=True)
class PlotGrid:
    """Plots of equal size in rows and columns, filled one cell at a time (counted from the top left)."""

    rows: int
    columns: int
    row_px: int
    _traces: list[dict[str, Any]] = field(default_factory=list)
    _layout: dict[str, Any] = field(default_factory=dict)
    _titles: list[dict[str, Any]] = field(default_factory=list)
    _barmode: str = "overlay"

    def axes(
        self, cell: int, title: str, x: dict[str, Any], y: dict[str, Any], share_x_with: int | None = None
    ) -> None:
        """Place the axes of a cell, `title` above it; its x axis may move with that of another cell."""
        left, right, bottom, top = self._place(cell)
        number = _number(cell)
        common = {"gridcolor": _GRID, "zerolinecolor": "#c5cad1", "linecolor": _INK, "ticks": "outside"}
        matches = {} if share_x_with in (None, cell) else {"matches": f"x{_number(share_x_with or 0)}"}
        self._layout[f"xaxis{number}"] = {
            **common,
            "domain": [left, right],
            "anchor": f"y{number}",
            **matches,
            **x,
            "title": {"standoff": 4, **x.get("title", {})},
        }
        self._layout[f"yaxis{number}"] = {
            **common,
            "domain": [bottom, top],
            "anchor": f"x{number}",
            "automargin": True,
            **y,
        }
        self._titles.append(
            {
                "text": f"<b>{html.escape(title)}</b>",
                "x": left,
                "y": top,
                "xref": "paper",
                "yref": "paper",
                "xanchor": "left",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 13},
            }
        )

    def line(
        self,
        cell: int,
        whose: str,
        x: NDArray[np.floating],
        y: NDArray[np.floating],
        subject: str,
        shape: str = "linear",
    ) -> None:
        """Draw a line of one of `COLOURS` in a cell; `subject` (a channel's name) goes with the data."""
        line = {"color": COLOURS[whose], "width": _WIDTHS[whose], "shape": shape}
        data = {"type": "scatter", "mode": "lines", "x": packed(x), "y": packed(y), "line": line}
        self._add(cell, whose, {**data, "meta": html.escape(subject)})

    def points(
        self,
        cell: int,
        x: NDArray[np.floating],
        y: NDArray[np.floating],
        deviations: NDArray[np.floating],
        names: Sequence[str],
        hollow: Sequence[bool],
    ) -> None:
        """Draw measured points in a cell, joined in their order, with a bar of a deviation to either side.

        All of shape (n,); `names` are shown where somebody points at one.
        """
        symbols = ["circle-open" if each else "circle" for each in hollow]
        colour = COLOURS["measured"]
        self._add(
            cell,
            "measured",
            {
                "type": "scatter",
                "mode": "lines+markers",
                "x": packed(x),
                "y": packed(y),
                "error_y": {"type": "data", "array": packed(deviations), "thickness": 1, "width": 3},
                "text": [html.escape(name) for name in names],
                "line": {"color": colour, "width": 1},
                "marker": {"color": colour, "symbol": symbols, "size": 8},
            },
        )

    def dots(
        self,
        cell: int,
        whose: str,
        x: NDArray[np.floating],
        y: NDArray[np.floating],
        names: Sequence[str],
    ) -> None:
        """Draw a cloud of dots of one of `COLOURS` in a cell, shape (n,); `names` show at the pointer."""
        size = 7 if whose == "measured" else 4.5
        data = {"type": "scatter", "mode": "markers", "x": packed(x), "y": packed(y)}
        marker = {"color": COLOURS[whose], "size": size, "opacity": 0.7}
        self._add(cell, whose, {**data, "text": [html.escape(name) for name in names], "marker": marker})

    def bars(
        self, cell: int, whose: str, centres: NDArray[np.floating], heights: NDArray[np.floating]
    ) -> None:
        """Draw a histogram's bars of one of `COLOURS` in a cell."""
        marker = {"color": COLOURS[whose], "opacity": 0.55}
        self._add(cell, whose, {"type": "bar", "x": packed(centres), "y": packed(heights), "marker": marker})

    def lying_bars(
        self, cell: int, whose: str, rows: NDArray[np.floating], lengths: NDArray[np.floating]
    ) -> None:
        """Draw a bar of one of `COLOURS` in every row of a cell; those of a row lie one below the other."""
        data = {"type": "bar", "orientation": "h", "x": packed(lengths), "y": packed(rows)}
        self._barmode = "group"
        self._add(cell, whose, {**data, "marker": {"color": COLOURS[whose]}})

    def figure(self, name: str, caption: str = "") -> Figure:
        """Return the figure."""
        layout = {
            **self._layout,
            "annotations": self._titles,
            "barmode": self._barmode,
            "bargap": 0.05,
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": _INK},
            "showlegend": False,
            "margin": {"l": 64, "r": 12, "t": _TOP_PX, "b": _AXIS_PX},
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "hovermode": "closest",
        }
        key = tuple(dict.fromkeys(trace["name"] for trace in self._traces))
        return Figure(name, self._traces, layout, self._height_px(), caption, key)

    def _add(self, cell: int, whose: str, trace: dict[str, Any]) -> None:
        number = _number(cell)
        self._traces.append(
            {
                **trace,
                "name": whose,
                "xaxis": f"x{number}",
                "yaxis": f"y{number}",
            }
        )

    def _height_px(self) -> int:
        return _TOP_PX + _AXIS_PX + self.rows * self.row_px + (self.rows - 1) * (_AXIS_PX + _TITLE_PX)

    def _place(self, cell: int) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of a cell as shares of the plotting area."""
        row, column = divmod(cell, self.columns)
        gap = 0.07 if self.columns > 1 else 0.0
        width = (1 - gap * (self.columns - 1)) / self.columns
        area_px = self._height_px() - _TOP_PX - _AXIS_PX
        top = 1 - row * (self.row_px + _AXIS_PX + _TITLE_PX) / area_px
        left = column * (width + gap)
        return left, left + width, max(top - self.row_px / area_px, 0.0), top


def _number(cell: int) -> str:
    return "" if cell == 0 else str(cell + 1)
