"""The operator's page in a browser: everything is there, nothing is cut, no text lies on another."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from daq.block import SampleBlock
from daq.channel import Channel
from daq.log.records import Event
from rig.bounds import Bounds
from rig.derived.derivation import Derivation, derived_channels
from rig.files.scenario import Scenario, parse_scenario
from rig.live.page_server import PageServer
from rig.live.page_state import PageState
from rig.live.picture import Picture, layout_of
from rig.live.rigs.impact_beam import BeamPicture
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.rigs.spatial_slider_crank import SpatialCrankPicture
from rig.live.view import Elsewhere, Levels, Progress, Swept
from rig.stream import Block, Shape, Stream
from tests.rig import synthetic_run
from tests.rig.browser import PLACES, SIZES, TRACED, browser_page, faults_of_texts, needs_chromium
from tests.rig.derived import turning
from tests.rig.synthetic_run import CHANNELS, blocks

pytestmark = [pytest.mark.browser, needs_chromium]
COUNTS = [5, 16, 64]
BEAM = BeamPicture(length_m=0.28, width_m=0.019, clearance_m=0.127e-3)
CRANK_SPEED = 2 * np.pi * turning.SPEED_HZ
PLANAR = PlanarCrankPicture(0.150, 0.564, 1e-3, 1e-3, CRANK_SPEED)
SPATIAL = SpatialCrankPicture(
    0.05, 0.19, 3.2e-3, 1.2, (0.0, 0.0, 0.0), 6.5e-3, 25e-3, 0.25e-3, 0.25e-3, CRANK_SPEED
)
SWEPT = Swept(
    "drive.frequency",
    ("8 Hz", "34 Hz"),
    np.linspace(0.0, 1.0, 27).tolist(),
    {
        title: {
            whose: [(high + at, high + at + 8.0, high + at + 4.0) if at < 18 else None for at in range(27)]
            for whose, high in (("measured", 30.0), ("predicted", 31.0))
        }
        for title in (
            "initial peak, N",
            "largest peak, N",
            "contact.force_upper peaks, N",
            "contact.force_upper rms, N",
        )
    },
)
ACQUISITION = '[acquisition]\nsample_rate = "25.6 kHz"\nduration = "5 s"\n'
CRANK_SCENARIO = f'[drive]\nspeed = "200 rpm"\n{ACQUISITION}'

DRAWN = """colours => [...document.querySelectorAll(".cell")].map(cell => {
  const canvas = cell.querySelector("canvas"), { width, height } = canvas;
  const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
  const between = width * (canvas.clientWidth - GAP / 2) * 0.55 / canvas.clientWidth;
  return [cell.querySelector("b").textContent, colours.flatMap(colour => {
    const counts = [0, 0];
    for (let at = 0; at < data.length; at += 4)
      if (data[at + 3] > 100 && colour.every((each, part) => Math.abs(data[at + part] - each) < 30))
        counts[+((at / 4) % width > between)]++;
    return counts;
  })];
})"""
"""Pixels of each colour in the newest cycle and in the trend."""
Tell = Callable[[PageState], None]


def beam_channels(count: int) -> list[Channel]:
    more = [Channel(f"beam.acceleration_{number}", "m/s2") for number in range(1, count - 4)]
    return [*synthetic_run.CHANNELS, *more]


def beam_run(state: PageState, count: int, seconds: float = 2.0) -> None:
    """The synthetic beam while it is recorded, with limits."""
    channels = beam_channels(count)
    scenario = parse_scenario(f"{synthetic_run.SCENARIO}\n{ACQUISITION}")
    bounds = {channel.name: Bounds(100.0) for channel in channels}
    bounds["contact.force_upper"] = Bounds(100.0, 30.0, 50.0)
    if count == COUNTS[1]:
        state.take(SWEPT)
    fill(state, channels, scenario, BEAM, bounds, synthetic_run.blocks, seconds)


def crank_run(state: PageState, picture: PlanarCrankPicture | SpatialCrankPicture) -> None:
    channels = turning.CHANNELS if picture is PLANAR else turning.SPATIAL_CHANNELS
    scenario = parse_scenario(f'name = "turning"\nrig = "{picture.rig}"\n{CRANK_SCENARIO}')
    fill(state, list(channels), scenario, picture, {}, turning.blocks, 4.0)


def fill(
    state: PageState,
    channels: list[Channel],
    scenario: Scenario,
    picture: Picture,
    bounds: dict[str, Bounds],
    blocks: Callable[..., Iterator[Any]],
    seconds: float,
) -> None:
    origins: dict[Any, list[Channel]] = {"measured": channels, "predicted": channels}
    found = derived_channels(origins, scenario)
    cycle_s = 1 / scenario.drive.cycle_hz
    state.take(
        layout_of(scenario.name, channels, channels, picture, derived=found, bounds=bounds, cycle_s=cycle_s)
    )
    state.take(Event(synthetic_run.START_NS, "warning", "daq_card", "overload", "yoke.force: overload"))
    state.take(Event(synthetic_run.START_NS, "info", "drive", "drive.on", "drive on at 20 Hz, 9 N " * 8))
    names = {origin: [channel.name for channel in each] for origin, each in origins.items()}
    derivation = Derivation(state.take, names, scenario)  # type: ignore[arg-type]
    stream = Stream([state.take, derivation])  # type: ignore[list-item]
    both = (blocks(channels, origin, seconds) for origin in origins)
    for number, (first, second) in enumerate(zip(*both, strict=True)):
        stream(Block("measured", first))
        stream(Block("predicted", second))
        if picture is BEAM:
            shape = 1.2e-4 * np.sin(0.37 * number) * np.linspace(0.0, 1.0, 20) ** 1.5
            stream(Shape(first.end_sample / first.sample_rate, shape))
    derivation.finish()
    state.take(Progress("recording", seconds, 5.0, ends_s=time.time() + 5.0 - seconds))


def shown(page: Page, server: PageServer, fill_state: Callable[[PageState], None]) -> dict[str, Any]:
    """Tell the page what a run comes to, and wait until it has drawn that."""
    states: list[bytes] = []
    state = PageState(states.append)
    state.take(Elsewhere("http://127.0.0.1:1/"))
    fill_state(state)
    state.look()
    page.evaluate("() => { looks.length = 0; }")
    server.tell(states[-1], time.time())
    page.wait_for_function("() => looks.length > 0", timeout=20_000)
    told: dict[str, Any] = json.loads(states[-1])
    return told


def assert_every_trace_is_drawn(page: Page, told: dict[str, Any]) -> None:
    colours = [told["colours"][each] for each in ("measured", "predicted")]
    drawn = dict(page.evaluate(DRAWN, colours))
    assert set(drawn) == {channel["name"] for channel in told["channels"]}
    assert not {name: counts for name, counts in drawn.items() if min(counts) < 15}
    assert page.evaluate(TRACED) == len(drawn)


@pytest.fixture
def server() -> Iterator[PageServer]:
    with PageServer(0) as serving:
        yield serving


@pytest.mark.parametrize(
    ("size", "count"),
    [
        pytest.param(size, count, marks=[] if (size, count) == (SIZES[0], 16) else [pytest.mark.long])
        for size in SIZES
        for count in COUNTS
    ],
)
def test_every_channel_has_its_traces_and_no_text_is_cut(
    server: PageServer, size: tuple[int, int], count: int, tmp_path: Path
) -> None:
    with browser_page() as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.goto(server.url)
        told = shown(page, server, lambda state: beam_run(state, count))
        page.wait_for_timeout(150)  # one picture of the rig in slow motion
        page.screenshot(path=tmp_path / "page.png")
        assert len(told["channels"]) == count
        assert_every_trace_is_drawn(page, told)
        assert faults_of_texts(page, PLACES) == []
        assert page.locator("#worst").inner_text().startswith("highest level: contact.force_upper, 80 %")
        assert re.fullmatch(r"\d\.\d s left", page.locator("#left").inner_text())
        scale = page.locator(".cell").nth(1).locator(".scale, .edge").filter(visible=True)
        assert re.findall(r"-?\d+", "".join(scale.all_inner_texts())) in (["-5", "45"], ["45", "-5"])
        assert (
            page.evaluate("() => parseFloat(getComputedStyle(document.querySelector('.head')).fontSize)") > 9
        )


@pytest.mark.long
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("picture", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_the_cranks_turn_measured_and_predicted(
    server: PageServer,
    size: tuple[int, int],
    picture: PlanarCrankPicture | SpatialCrankPicture,
    tmp_path: Path,
) -> None:
    with browser_page() as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.goto(server.url)
        told = shown(page, server, lambda state: crank_run(state, picture))
        page.wait_for_timeout(150)
        page.screenshot(path=tmp_path / "page.png")
        assert_every_trace_is_drawn(page, told)
        assert faults_of_texts(page, PLACES) == []
        assert {whose for whose, _ in told["sketch"]["frames"][0]} == {"measured", "predicted"}
        assert page.locator("#news").is_visible()
        assert (
            "bar:" not in page.locator("footer").inner_text()
        )  # none of these channels has a range or a limit


@pytest.mark.parametrize("size", SIZES[:1])
def test_before_the_run_it_says_armed_and_shows_levels(
    server: PageServer, size: tuple[int, int], tmp_path: Path
) -> None:
    def armed(state: PageState) -> None:
        channels = beam_channels(16)
        bounds = {channel.name: Bounds(50.0, 20.0, 40.0) for channel in channels}
        state.take(layout_of("steel beam", channels, channels, BEAM, bounds=bounds, cycle_s=0.05))
        state.take(Levels(time.time_ns(), [1.0 + number for number in range(16)]))
        state.take(Progress("armed: Enter at the terminal starts"))

    with browser_page() as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.goto(server.url)
        assert page.locator("#stage").inner_text().startswith("waiting for a run")
        shown(page, server, armed)
        page.screenshot(path=tmp_path / "page.png")
        assert page.locator("#stage").inner_text() == "armed: Enter at the terminal starts"
        assert page.locator(".peak").last.inner_text() == "16 m/s²"
        assert page.locator("#news").is_hidden()  # nothing has happened: no empty box
        assert "bar:" in page.locator("footer").inner_text()
        assert faults_of_texts(page, PLACES) == []


def test_a_page_that_waits_is_answered_and_one_whose_run_or_server_is_gone_says_so(
    server: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.live.page_server._HELD_S", 0.05)
    with browser_page() as page:
        page.clock.install()
        page.goto(server.url)

        def lost_after(seconds: int) -> str:
            """What the page says then, once the server has had its chance to answer."""
            page.clock.fast_forward(1000 * seconds)
            page.wait_for_timeout(300)
            page.clock.run_for(200)
            return page.locator("#lost").inner_text()

        shown(page, server, lambda state: state.take(Progress("recording", 12.0)))
        assert (
            page.locator("#stage").inner_text() == "recording: 12 s"
        )  # until Enter: nobody knows of how many
        assert lost_after(40).startswith("no word for 4")
        shown(page, server, lambda state: state.end())
        assert lost_after(60) == ""
        monkeypatch.setattr("rig.live.page_server._HELD_S", 600.0)
        page.wait_for_timeout(300)  # what was asked before is still answered
        assert lost_after(60) == "the page's server does not answer: rattle live"


@pytest.mark.parametrize(
    ("progress", "left"),
    [
        (Progress("recording", 3, 60, "impacts"), ""),  # until the first ones nobody knows
        (Progress("recording", 3, 60, "impacts", ends_s=0.0), ""),
        (Progress("warming up", ends_s=2e9 + 125.0), "2 min 5 s left"),
        (Progress("warming up", ends_s=2e9 + 8.0), "8 s left"),
    ],
)
def test_the_page_says_how_long_is_left_where_that_is_known(
    server: PageServer, progress: Progress, left: str
) -> None:
    with browser_page() as page:
        page.clock.install(time=2e9)
        page.clock.pause_at(2e9 + 0.001)
        page.goto(server.url)
        page.clock.resume()
        page.clock.set_fixed_time(2e9)
        shown(page, server, lambda state: state.take(progress))
        assert page.locator("#left").inner_text() == left
        assert page.locator("#stage").inner_text().startswith(progress.text)


def test_what_is_not_drawn_yet_is_not_said_to_be(server: PageServer) -> None:
    def begun(state: PageState, seconds: float) -> None:
        state.take(layout_of("steel beam", CHANNELS, CHANNELS, BEAM, cycle_s=0.05))
        for origin in ("measured", "predicted"):
            for first in blocks(CHANNELS, origin, seconds):
                state.take(Block(origin, first))

    both = "measured predicted"
    with browser_page() as page:
        page.goto(server.url)
        for seconds, drawn in ((0.0, ("", "")), (0.03, ("", both)), (0.2, (both, both))):
            shown(page, server, partial(begun, seconds=seconds))
            cell = page.locator(".cell").first
            assert (cell.get_attribute("data-cycle"), cell.get_attribute("data-trend")) == drawn
            edges = page.locator(".cell .edge.high").first.inner_text()
            assert bool(edges) == (seconds > 0)


def test_the_page_says_how_far_the_newest_that_is_drawn_lies_behind(server: PageServer) -> None:
    def late(state: PageState) -> None:
        state.take(layout_of("steel beam", CHANNELS, CHANNELS, BEAM, cycle_s=0.05))
        for origin, ago_s in (("measured", 0.5), ("predicted", 20.0)):
            zeros, at_ns = np.zeros(5120, np.float32), time.time_ns() - round((ago_s + 0.1) * 1e9)
            state.take(Block(origin, SampleBlock("drive.force", 0, at_ns, 51_200.0, zeros)))
        state.take(Levels(time.time_ns(), [1.0] * len(CHANNELS)))

    with browser_page() as page:
        page.goto(server.url)
        shown(page, server, late)
        measured, prediction = re.findall(r"[\d.]+", page.locator("#behind").inner_text())
        assert 0.5 <= float(measured) < 10.0
        assert float(prediction) == pytest.approx(float(measured) + 19.5, abs=0.15)
        _, measured_s, _, predicted_s = page.evaluate("() => looks.at(-1)")
        assert predicted_s - measured_s == pytest.approx(19.5, abs=0.05)
