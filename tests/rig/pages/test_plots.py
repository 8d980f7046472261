"""Plots as Plotly reads them: whose a line is, where it stands, and no more points than a page can bear."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest

from rig.pages.plots import STYLES, Plots, Style, packed, points_each


def values(array: dict[str, str]) -> list[float]:
    return [float(each) for each in np.frombuffer(base64.b64decode(array["bdata"]), "<f4")]


def drawn(plots: Plots) -> list[dict[str, Any]]:
    return list(plots.figure("plots").traces)


def test_numbers_arrive_as_they_are_and_a_hole_stays_one() -> None:
    arrived = values(packed([1.5, float("nan"), -2.0]))
    assert arrived[::2] == [1.5, -2.0]
    assert np.isnan(arrived[1])


def test_what_is_measured_and_what_is_predicted_have_colours_of_their_own_in_every_kind_of_plot() -> None:
    plots = Plots(1, 1, 100)
    for name in ("measured", "predicted"):
        plots.line(0, name, [0, 1], [0, 1])
        plots.dots(0, name, [0, 1], [0, 1], ["a", "b"])
        plots.bars(0, name, [0, 1], [0, 1])
        plots.lying_bars(0, name, [0, 1], [0, 1])
    for trace in drawn(plots):
        colour = trace.get("line", trace.get("marker"))["color"]
        assert colour == STYLES[trace["name"]].colour
    assert STYLES["measured"].colour != STYLES["predicted"].colour


def test_a_series_stands_once_in_a_legend_and_without_one_in_the_pages_key() -> None:
    for legend in (True, False):
        plots = Plots(1, 2, 100, legend=legend)
        for cell in (0, 1):
            plots.line(cell, "measured", [0, 1], [0, 1])
        figure = plots.figure("plots")
        assert figure.layout["showlegend"] is legend
        assert figure.key == (() if legend else ("measured",))
        assert [trace.get("showlegend") for trace in figure.traces] == (
            [True, False] if legend else [None] * 2
        )


def test_cells_fill_the_area_from_the_top_left_and_do_not_touch() -> None:
    plots = Plots(2, 2, 100)
    for cell in range(4):
        plots.axes(cell, f"cell {cell}", share_x_with=0)
    layout = plots.figure("plots").layout
    places = [(layout[f"xaxis{n}"]["domain"], layout[f"yaxis{n}"]["domain"]) for n in ("", 2, 3, 4)]
    assert (places[0][0][0], places[0][1][1]) == (0.0, 1.0)
    assert (places[3][0][1], places[3][1][0]) == pytest.approx((1.0, 0.0))
    assert places[0][0][1] < places[1][0][0]
    assert places[2][1][1] < places[0][1][0]
    assert "matches" not in layout["xaxis"]
    assert layout["xaxis4"]["matches"] == "x"


def test_a_long_line_is_drawn_by_its_extremes() -> None:
    long = np.zeros(100_000)
    long[54_321] = 7.0
    plots = Plots(1, 1, 100)
    plots.outline(0, "measured", np.arange(len(long)) / 1000, long, points=600)
    (trace,) = drawn(plots)
    x, y = values(trace["x"]), values(trace["y"])
    assert len(y) <= 600
    assert x[y.index(7.0)] == pytest.approx(54.321)
    assert points_each(10) > points_each(1000) == 600


def test_names_of_channels_stay_text() -> None:
    plots = Plots(1, 1, 100, legend=True)
    plots.axes(0, "<i>x</i>")
    plots.line(0, "<b>", [0], [0], Style("red"), subject="<a>", texts=["<u>"])
    figure = plots.figure("plots")
    (trace,) = figure.traces
    assert (trace["name"], trace["meta"], trace["text"]) == ("&lt;b&gt;", "&lt;a&gt;", ["&lt;u&gt;"])
    assert figure.layout["annotations"][0]["text"] == "<b>&lt;i&gt;x&lt;/i&gt;</b>"
