"""The live view as the operator sees it: in Rerun's own viewer without a screen, and in Chromium."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from rerun.experimental import ViewerClient

from daq.log.records import Event
from rig.live.picture import layout_of
from rig.live.rigs.impact_beam import BeamPicture
from rig.live.view import LiveView
from rig.stream import Block, Shape
from tests.rig.browser import browser_page, needs_chromium
from tests.rig.live.native_viewer import needs_vulkan, shows_both, viewer
from tests.rig.synthetic_run import CHANNELS, START_NS, blocks

BEAM = BeamPicture(length_m=0.28, width_m=0.019, clearance_m=0.127e-3)
NAMES = {channel.name for channel in CHANNELS}
pytestmark = [pytest.mark.long, pytest.mark.browser]


@pytest.fixture
def live() -> Iterator[LiveView]:
    """A view that has been offered two seconds of a run."""
    with LiveView(layout_of("synthetic beam", CHANNELS, CHANNELS, BEAM)) as view:
        measured, predicted = (blocks(CHANNELS, origin, 2.0) for origin in ("measured", "predicted"))
        for index, (first, second) in enumerate(zip(measured, predicted, strict=True)):
            view.offer(Block("measured", first))
            view.offer(Block("predicted", second))
            view.offer(Shape(index * 0.02, 1e-4 * np.sin(index) * np.linspace(0.0, 1.0, 20)))
        view.offer(Event(START_NS, "warning", "daq_card", "overload", "range passed"))
        yield view


def views_without_both(client: ViewerClient, folder: Path, names: set[str]) -> set[str]:
    """Views of traces and spectra in which measured or predicted cannot be seen."""
    missing = set()
    for view in client.get_state().views:
        if view.view_class in ("TimeSeries", "2D") and view.name.split(" [")[0] in names:
            client.save_screenshot(str(folder / "view.png"), view.view_id)
            with Image.open(folder / "view.png") as picture:
                missing |= set() if shows_both(picture) else {view.name}
    return missing


def not_drawn(client: ViewerClient, folder: Path) -> set[str]:
    try:
        views = client.get_state().views
        shown = {view.name.split(" [")[0] for view in views if view.view_class == "TimeSeries"}
        return views_without_both(client, folder, NAMES) if shown >= NAMES else NAMES - shown
    except (RuntimeError, ConnectionError) as error:  # no picture of a view that is still being laid out
        return {str(error)}


def assert_everything_is_drawn(client: ViewerClient, folder: Path) -> None:
    deadline = time.monotonic() + 60.0
    while missing := not_drawn(client, folder):
        assert time.monotonic() < deadline, f"not drawn: {missing}"
    views = client.get_state().views
    classes = [view.view_class for view in views]
    assert {"3D", "TextLog", "TextDocument"} <= set(classes)
    assert classes.count("2D") == len(CHANNELS)
    assert [view.reports for view in views if view.reports] == []


@needs_vulkan
def test_every_channel_is_shown_as_measured_and_as_predicted(live: LiveView, tmp_path: Path) -> None:
    with viewer("--connect", live.sink_url) as client:
        assert_everything_is_drawn(client, tmp_path)


@needs_chromium
def test_the_page_shows_the_run_in_a_browser(live: LiveView) -> None:
    with browser_page() as page:
        page.goto(live.url)
        deadline = time.monotonic() + 90.0  # a browser that draws without a graphics card
        while True:
            with Image.open(io.BytesIO(page.screenshot())) as picture:
                if shows_both(picture):
                    break
            assert time.monotonic() < deadline, "the page stays blank"
