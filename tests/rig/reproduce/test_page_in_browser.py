"""The page as an engineer sees it: opened in Chromium, asked what it has drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.reproduce import page
from rig.reproduce.page import Reproduced
from tests.rig.browser import browser_page, needs_chromium

# The timeout is for compiling every kernel of three rigs on a cold cache.
pytestmark = [pytest.mark.browser, pytest.mark.timeout(400), needs_chromium]

DRAWN = """() => [...document.querySelectorAll(".plot")].map(plot => plot.calcdata.map(
    points => [points[0].trace.name, points.length]))"""


def test_every_plot_is_drawn_and_nothing_is_fetched(quick_figures: list[Reproduced], tmp_path: Path) -> None:
    html = tmp_path / "reproduce.html"
    html.write_text(page.html(quick_figures, quick=True), encoding="utf-8")
    complaints: list[str] = []
    fetched: list[str] = []
    with browser_page() as opened:
        opened.on("console", lambda message: complaints.append(message.text))
        opened.on("pageerror", lambda error: complaints.append(str(error)))
        opened.on("request", lambda request: fetched.append(request.url))
        opened.goto(html.as_uri())
        opened.wait_for_function("[...document.querySelectorAll('.plot')].every(plot => plot.calcdata)")
        plots = opened.evaluate(DRAWN)
        rows = opened.locator("#summary tbody tr:not(.figure)").count()
    assert complaints == []
    assert fetched == [html.as_uri()]
    expected = [part for each in quick_figures for part in each.outcome.parts if part.kind == "figure"]
    assert len(plots) == len(expected)
    assert all(traces and all(count > 0 for _, count in traces) for traces in plots)
    counted = [s for each in quick_figures for s in each.outcome.statements if not s.what_if]
    assert rows == len(counted)
