"""The page of a monitor in a browser: every channel is there, nothing is cut, no text lies on another."""

from __future__ import annotations

import json
import time
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.block import Flag
from drivers.ni_daq.channels import CardChannel
from drivers.ni_daq.sensors import described
from drivers.protocols.card import CardReading
from rig.live.page_server import PageServer
from rig.session.at_rest import Sensors
from rig.session.on_rest_page import rest_state
from tests.rig.browser import SIZES, browser_page, faults_of_texts, needs_chromium

pytestmark = [pytest.mark.browser, needs_chromium]
RATE, BLOCK = 6400.0, 480
RUN = {
    "title": "a run",
    "stage": {"text": "connecting", "done": 0, "total": 0, "unit": "s"},
    "ended": False,
    "newest": [None, None],
    "cycle_s": None,
    "bin_s": 0.25,
    "trend_s": [0, 4],
    "colours": {},
    "channels": [],
    "figures": [],
    "events": [],
    "dropped": 0,
    "swept": None,
    "sketch": None,
    "explore": "",
}
ASKS = "contact.force_upper: press or tap there, the way that it is to count positive"


@cache
def watched(count: int) -> Any:
    """So many channels at rest, one tapped, one with hum, one open, one that drifts, and an encoder."""
    forces = [
        CardChannel(
            f"contact.force_{number}",
            f"cDAQ1Mod{number // 4 + 1}/ai{number % 4}",
            "force_iepe",
            0.02,
            200.0,
            unit="N",
            serial=f"LW-{4700 + number}",
        )
        for number in range(count - 1)
    ]
    angle = CardChannel("crank.angle", "cDAQ1Mod9/ctr0", "encoder", unit="rad")
    sensors = Sensors(
        [*forces, angle], [described(each) for each in forces] + [described(forces[0])], RATE, {}
    )
    noise = np.random.default_rng(2)
    seen = []
    for block in range(180):
        first = block * BLOCK
        at = np.arange(first, first + BLOCK) / RATE
        rows = noise.normal(0.0, 0.02, (count, BLOCK))
        rows[1] += 0.3 * np.sin(2 * np.pi * 50 * at) + 0.1 * np.sin(2 * np.pi * 150 * at)
        rows[3] += 0.2 * at
        rows[0] += 60.0 * np.exp(-200 * np.maximum(at - 6.0, 0.0)) * (at >= 6.0)
        rows[-1] = 0.1 * at
        flags = [Flag.GOOD] * count
        flags[2] = Flag.OPEN_SENSOR
        tap = sensors.take(CardReading(first, rows, tuple(flags), 0.0))
        if tap is not None:
            seen.append(("info", f"tap: {sensors.tapped(tap)}"))
    seen.append(("warning", "contact.force_2: open sensor"))
    return SimpleNamespace(sensors=sensors, seen=seen, newest_unix_s=time.time())


@pytest.mark.parametrize(
    ("count", "asks"),
    [
        (6, True),
        pytest.param(16, False, marks=pytest.mark.long),
        pytest.param(40, False, marks=pytest.mark.long),
    ],
)
def test_every_channel_is_told_and_nothing_is_cut(count: int, asks: bool, tmp_path: Path) -> None:
    says = ASKS if asks else "nothing is driven"
    with PageServer(0) as server, browser_page() as page:
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            state = rest_state("steel beam, 20 Hz", says, asks, watched(count))
            server.tell(json.dumps(state).encode(), time.time())
            page.goto(server.url)
            page.wait_for_url("**/monitor", timeout=20_000)
            page.wait_for_function("() => looks.length > 0", timeout=20_000)
            page.screenshot(path=tmp_path / f"page_{width}.png")
            rows = page.evaluate("() => [...document.querySelectorAll('tbody tr')].map(row => row.innerText)")
            assert len(rows) == count
            assert "50 Hz" in rows[1]
            assert "150 Hz" in rows[1]
            assert "open sensor" in rows[2]
            assert "/min" in rows[3]
            assert page.locator("li").first.inner_text() == "contact.force_2: open sensor"
            assert "contact.force_0 +6" in page.locator("li").nth(1).inner_text()
            assert (page.locator("body.asks").count() == 1) is asks
            assert faults_of_texts(page, "td, th, li, header, footer") == []


def test_a_run_that_comes_takes_the_page_over() -> None:
    with PageServer(0) as server, browser_page() as page:
        state = rest_state("beam", "nothing is driven", False, watched(6))
        server.tell(json.dumps(state).encode(), time.time())
        page.goto(f"{server.url}monitor")
        page.wait_for_function("() => looks.length > 0", timeout=20_000)
        server.tell(json.dumps(RUN).encode(), time.time())
        page.wait_for_url(server.url, timeout=20_000)
