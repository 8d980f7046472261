"""Plotly figures as plain data: plots in rows and columns, each line and dot in the colour of whose it is.

The dicts are what Plotly reads: its own classes would check each of a hundred thousand numbers on the way.
"""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.signals.envelope import envelope
from rig.pages.content import Figure

BLUE: Final = "#1a6fb5"
ORANGE: Final = "#d95f02"
BLACK: Final = "#111111"
GREY: Final = "#8a929c"
GREEN: Final = "#5a8f29"
"""Blue is measured and orange predicted, apart for every kind of colour blindness and in a grey print; black
is what was added, grey what was asked for, green what learnt from recordings."""


@dataclass(frozen=True, slots=True)
class Style:
    """How a series is drawn: Plotly's `mode`, and the looks of line and marker, sizes in pixels."""

    colour: str
    width: float = 1.8
    mode: str = "lines"
    dash: str = "solid"
    symbol: str | Sequence[str] = "circle"
    size: float = 7


STYLES: Final[Mapping[str, Style]] = {
    "measured": Style(BLUE, 2.4),
    "predicted": Style(ORANGE, 1.1),
    "nominal": Style(ORANGE, 1.1),
    "repaired": Style(BLACK, 1.1),
    "surrogate": Style(GREEN, 1.1),
    "set": Style(GREY, 1.0),
    "event": Style(GREY, 1.0, dash="dot"),
    "limit": Style("#b3261e", 1.2, dash="dash"),
}
"""Predictions are drawn last and thin, so that what was measured shows on both sides of them."""

FROM_ZERO: Final[Mapping[str, Any]] = {"rangemode": "tozero"}
"""Of an axis that begins at 0."""

SCATTER: Final = "rgba(26, 111, 181, 0.22)"
_HEALTHY = "rgba(120, 130, 145, 0.25)"
_HEAT = ("#f4f6f4", "#fdeebf", "#fdc56c", "#f08a3c", "#cc3d2c", "#6d0f33")
_DOUBLINGS = len(_HEAT) - 1

# A page of this many points stays below the 8 MB that mail takes, and zooms without a pause.
_POINTS_IN_ALL = 140_000
_FEWEST_POINTS, _MOST_POINTS = 600, 4_000
_TITLE_PX, _AXIS_PX, _TOP_PX, _LEGEND_PX = 24, 44, 26, 34
_INK, _GRID = "#333a44", "#e3e6ea"
_LEGEND = {"orientation": "h", "yref": "container", "y": 1, "yanchor": "top", "x": 0, "font": {"size": 13}}


def packed(values: ArrayLike) -> dict[str, str]:
    """Array as Plotly reads it: base64 of little-endian float32 (NaN breaks a line)."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()}


def points_each(traces: int) -> int:
    """Points a trace may have in a figure of so many, to keep the page small and quick."""
    return min(max(_POINTS_IN_ALL // max(traces, 1), _FEWEST_POINTS), _MOST_POINTS)


@dataclass(slots=True)
class Plots:
    """Plots of equal size, filled one cell at a time, counted from the top left.

    What each series is called stands in Plotly's own `legend` above them, or else in the key of the page,
    which knows the names of `STYLES`.
    """

    rows: int
    columns: int
    row_px: int
    legend: bool = False
    _traces: list[dict[str, Any]] = field(default_factory=list)
    _layout: dict[str, Any] = field(default_factory=dict)
    _titles: list[dict[str, Any]] = field(default_factory=list)

    def axes(
        self,
        cell: int,
        title: str,
        x: str = "",
        y: str = "",
        *,
        x_axis: Mapping[str, Any] | None = None,
        y_axis: Mapping[str, Any] | None = None,
        share_x_with: int | None = None,
    ) -> None:
        """Place a cell's axes: labels `x` and `y`, and further keys of Plotly's for each.

        `title` stands above it; its x axis may move with that of another cell.
        """
        row, column = divmod(cell, self.columns)
        gap = 0.07 if self.columns > 1 else 0.0
        width = (1 - gap * (self.columns - 1)) / self.columns
        area_px = self._area_px()
        top = 1 - row * (self.row_px + _AXIS_PX + _TITLE_PX) / area_px
        left = column * (width + gap)
        right, bottom = left + width, max(top - self.row_px / area_px, 0.0)
        number = _number(cell)
        common = {"gridcolor": _GRID, "zerolinecolor": "#c5cad1", "linecolor": _INK, "ticks": "outside"}
        matches = {} if share_x_with in (None, cell) else {"matches": f"x{_number(share_x_with or 0)}"}
        self._layout[f"xaxis{number}"] = {
            **common,
            "domain": [left, right],
            "anchor": f"y{number}",
            "title": {"standoff": 4, "text": x},
            **matches,
            **(x_axis or {}),
        }
        self._layout[f"yaxis{number}"] = {
            **common,
            "domain": [bottom, top],
            "anchor": f"x{number}",
            "automargin": True,
            **({"title": {"text": y}} if y else {}),  # an empty one takes room all the same
            **(y_axis or {}),
        }
        anchor = {"xref": "paper", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
        text = {"text": f"<b>{html.escape(title)}</b>", "showarrow": False, "font": {"size": 13}}
        self._titles.append({**text, "x": left, "y": top, **anchor})

    def line(
        self,
        cell: int,
        name: str,
        x: ArrayLike,
        y: ArrayLike,
        style: Style | None = None,
        *,
        subject: str = "",
        shape: str = "linear",
        deviations: ArrayLike | None = None,
        texts: Sequence[str] = (),
    ) -> None:
        """Draw a series, by default in the style of its name.

        `subject` (a channel's name) goes with the data, `texts` show where somebody points at a value,
        `deviations` are drawn as a bar to either side of it. Arrays of shape (n,).
        """
        style = style or STYLES[name]
        trace: dict[str, Any] = {"type": "scatter", "mode": style.mode, "x": packed(x), "y": packed(y)}
        line = {"color": style.colour, "width": style.width, "shape": shape}
        trace["line"] = line if style.dash == "solid" else {**line, "dash": style.dash}
        if "markers" in style.mode:
            symbols = style.symbol if isinstance(style.symbol, str) else list(style.symbol)
            edge = {"width": 2, "color": style.colour}
            trace["marker"] = {"color": style.colour, "symbol": symbols, "size": style.size, "line": edge}
        if deviations is not None:
            bars = {"type": "data", "array": packed(deviations), "thickness": 1.2, "width": 3}
            trace["error_y"] = {**bars, "color": style.colour}
        self._add(cell, name, _with_words(trace, subject, texts))

    def outline(
        self,
        cell: int,
        name: str,
        x: NDArray[np.floating],
        y: NDArray[np.floating],
        style: Style | None = None,
        *,
        subject: str = "",
        points: int = 3_000,
    ) -> None:
        """Draw a line that may be long, by its extremes: so many `points` at most."""
        chosen = envelope(y, points)
        self.line(cell, name, x[chosen.indices], chosen.values, style, subject=subject)

    def dots(self, cell: int, name: str, x: ArrayLike, y: ArrayLike, texts: Sequence[str]) -> None:
        marker = {"color": STYLES[name].colour, "size": 7 if name == "measured" else 4.5, "opacity": 0.7}
        trace = {"type": "scatter", "mode": "markers", "x": packed(x), "y": packed(y), "marker": marker}
        self._add(cell, name, _with_words(trace, "", texts))

    def bars(self, cell: int, name: str, centres: ArrayLike, heights: ArrayLike) -> None:
        marker = {"color": STYLES[name].colour, "opacity": 0.55}
        self._add(cell, name, {"type": "bar", "x": packed(centres), "y": packed(heights), "marker": marker})

    def lying_bars(self, cell: int, name: str, rows: ArrayLike, lengths: ArrayLike) -> None:
        """Draw a bar in every row of a cell; those of a row lie one below the other."""
        marker = {"color": STYLES[name].colour}
        data = {"type": "bar", "orientation": "h", "x": packed(lengths), "y": packed(rows)}
        self._add(cell, name, {**data, "marker": marker})

    def band(
        self,
        cell: int,
        x: ArrayLike,
        low: ArrayLike,
        high: ArrayLike,
        shape: str = "linear",
        name: str = "healthy rig",
        colour: str = _HEALTHY,
        subject: str = "",
    ) -> None:
        """Fill what lies between two lines: by default a healthy rig."""
        common = {"type": "scatter", "mode": "lines", "x": packed(x), "hoverinfo": "skip"}
        common |= {"line": {"width": 0, "shape": shape}}
        edge = _with_words({**common, "y": packed(low), "showlegend": False}, subject, ())
        self._add(cell, name.partition(" ")[0], edge)
        filled = {"fill": "tonexty", "fillcolor": colour}
        self._add(cell, name, _with_words({**common, **filled, "y": packed(high)}, subject, ()))

    def heat(self, cell: int, x: list[Any], rows: Sequence[str], gaps: NDArray[np.float64]) -> None:
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
        self._add(cell, "gap", trace)

    def figure(self, name: str, caption: str = "", below_px: int = 0) -> Figure:
        """The figure; `below_px` is for long labels."""
        above_px = _LEGEND_PX if self.legend else 0
        lying = any(trace.get("orientation") == "h" for trace in self._traces)
        layout = {
            **self._layout,
            "annotations": self._titles,
            "barmode": "group" if lying else "overlay",
            "bargap": 0.05,
            "font": {"family": "system-ui, sans-serif", "size": 12, "color": _INK},
            "showlegend": self.legend and "coloraxis" not in self._layout,
            **({"legend": _LEGEND} if self.legend else {}),
            "margin": {"l": 64, "r": 12, "t": _TOP_PX + above_px, "b": _AXIS_PX + below_px},
            "paper_bgcolor": "white",
            "plot_bgcolor": "white",
            "hovermode": "closest",
        }
        key = () if self.legend else tuple(dict.fromkeys(trace["name"] for trace in self._traces))
        height_px = self._area_px() + _TOP_PX + _AXIS_PX + above_px + below_px
        return Figure(name, self._traces, layout, height_px, caption, key)

    def _add(self, cell: int, name: str, trace: dict[str, Any]) -> None:
        """A name stands in the legend once, and a click there hides all that is called so."""
        number = _number(cell)
        told: dict[str, Any] = {"name": html.escape(name), "xaxis": f"x{number}", "yaxis": f"y{number}"}
        if self.legend:
            first = all(each["legendgroup"] != name for each in self._traces)
            told |= {"legendgroup": name, "showlegend": first}
        self._traces.append({**told, **trace})

    def _area_px(self) -> int:
        return self.rows * self.row_px + (self.rows - 1) * (_AXIS_PX + _TITLE_PX)


def _number(cell: int) -> str:
    return "" if cell == 0 else str(cell + 1)


def _with_words(trace: dict[str, Any], subject: str, texts: Sequence[str]) -> dict[str, Any]:
    if subject:
        trace["meta"] = html.escape(subject)
    if texts:
        trace["text"] = [html.escape(text) for text in texts]
    return trace


def _listed(values: NDArray[np.float64]) -> list[list[float | None]]:
    return [[None if np.isnan(each) else round(float(each), 3) for each in row] for row in values]


_COLOUR_AXIS = {
    "cmin": 0,
    "cmax": _DOUBLINGS,
    "colorscale": [[k / _DOUBLINGS, colour] for k, colour in enumerate(_HEAT)],
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
