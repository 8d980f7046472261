"""The report as an operator sees it: opened in Chromium, asked what it has drawn."""

from pathlib import Path
from typing import Any

import pytest

from daq.channel import Channel
from rig.report.page import write_report
from rig.report.record import read_run
from tests.rig.browser import browser_page, faults_of_report, needs_chromium
from tests.rig.live.test_page import COUNTS, beam_channels
from tests.rig.synthetic_run import CHANNELS, RATE, write_log

pytestmark = [pytest.mark.browser, needs_chromium]

DRAWN = """() => Object.fromEntries([...document.querySelectorAll(".plot")].map(plot => [plot.id,
    plot.calcdata.map(points => ({
        name: points[0].trace.name, channel: points[0].trace.meta, type: points[0].trace.type,
        count: points.length, highest: Math.max(...points.map(point => point.y ?? point.s ?? 0)),
    }))]))"""


def opened(html: Path) -> tuple[dict[str, list[dict[str, Any]]], list[str], list[str]]:
    """What the plots hold, what the console said, and what was asked of the network."""
    complaints: list[str] = []
    fetched: list[str] = []
    with browser_page() as page:
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: fetched.append(request.url))
        page.goto(html.as_uri())
        page.wait_for_function("[...document.querySelectorAll('.plot')].every(plot => plot.calcdata)")
        drawn = page.evaluate(DRAWN)
        assert page.locator(".plot .main-svg").count() > 0
    return drawn, complaints, fetched


def test_every_channel_is_drawn_as_measured_and_as_predicted(tmp_path: Path) -> None:
    html = tmp_path / "report.html"
    write_report(read_run(write_log(tmp_path / "run.mcap")), html)
    drawn, complaints, fetched = opened(html)
    expected = {(channel.name, origin) for channel in CHANNELS for origin in ("measured", "predicted")}
    for plot in ("plot-overlays", "plot-spectra"):
        lines = [line for line in drawn[plot] if line["count"] > 20]
        assert {(line["channel"], line["name"]) for line in lines} == expected
    bars = [trace["name"] for trace in drawn["plot-peaks"] if trace["type"] == "bar"]
    assert bars == ["measured", "predicted"] * 2
    assert complaints == []
    assert fetched == [html.as_uri()]


def test_the_first_impacts_are_drawn_sample_by_sample(tmp_path: Path) -> None:
    html = tmp_path / "report.html"
    write_report(read_run(write_log(tmp_path / "run.mcap")), html)
    drawn, _, _ = opened(html)
    upper = [line for line in drawn["plot-overlays"] if line["channel"] == "contact.force_upper"]
    measured = next(line for line in upper if line["name"] == "measured")
    predicted = next(line for line in upper if line["name"] == "predicted")
    assert measured["highest"] == pytest.approx(40.0, rel=3e-3)
    assert predicted["highest"] == pytest.approx(36.0, rel=3e-3)
    assert measured["count"] > 2e-3 * RATE


@pytest.mark.long
@pytest.mark.parametrize("count", COUNTS)
def test_no_text_of_a_report_is_cut_or_lies_on_another(tmp_path: Path, count: int) -> None:
    html = tmp_path / "report.html"
    write_report(read_run(write_log(tmp_path / "run.mcap", 0.5, beam_channels(count))), html)
    assert faults_of_report(html, texts=10 * count) == []


def test_markup_in_a_channel_name_runs_nothing_and_links_nowhere(tmp_path: Path) -> None:
    name = (
        "<a href='http://example.org'>x</a><img src=x onerror=console.error('run')><script>console.error(1)"
    )
    html = tmp_path / "report.html"
    write_report(read_run(write_log(tmp_path / "run.mcap", 0.2, [Channel(name, "<b>N</b>")])), html)
    with browser_page() as page:
        complaints: list[str] = []
        page.on("console", lambda message: complaints.append(message.text))
        page.goto(html.as_uri())
        page.wait_for_selector(".plot .main-svg", state="attached")
        assert page.locator("svg a").count() == 0
        assert page.locator("img").count() == 0
    assert complaints == []
