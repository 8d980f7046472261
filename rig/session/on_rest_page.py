"""What is seen of a bench at rest, on this machine's page, as one text a few times a second."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Final

import numpy as np

from daq.clock import Clock
from rig.session.at_rest import Shown
from rig.session.monitor import Monitor
from rig.session.progress import Screen

_STEPS: Final = 1000
_COLUMNS: Final = 200
_PERIOD_S: Final = 0.2
_LAST_WORDS_S: Final = 1.5
_HIGH: Final = 40.0
"""Times its noise: so high a plot is at least, lest noise fill it."""


Show = Callable[[str, str, bool, Monitor], None]
"""Tells the page: of which scenario, what goes on or, if so, is asked, and what is watched. Never waits."""


@contextmanager
def on_rest_page(screen: Screen, clock: Clock) -> Iterator[Show]:
    """This machine's page, which is started if it is not there and named; raises InstrumentAbsent."""
    from rig.live.page_server import PageServer, Teller, ensure_page, page_port, page_url

    with ExitStack() as stack:
        if port := page_port():
            ensure_page(port)
        else:
            port = stack.enter_context(PageServer(0)).port
        screen.say(f"live view  {page_url(port)}")
        tell, due_s = Teller(port), 0.0
        stack.callback(tell.close, _LAST_WORDS_S)
        state = dict[str, Any]()
        stack.callback(
            lambda: tell(_text(state | {"ended": True, "asks": False, "says": "ended"})) if state else None
        )

        def show(title: str, says: str, asks: bool, watched: Monitor) -> None:
            nonlocal due_s
            if (now_s := clock.monotonic_s()) >= due_s:
                due_s = now_s + _PERIOD_S
                state.update(rest_state(title, says, asks, watched))
                tell(_text(state))

        yield show


def _text(state: dict[str, Any]) -> bytes:
    return json.dumps(state, separators=(",", ":")).encode()


def rest_state(title: str, says: str, asks: bool, watched: Monitor) -> dict[str, Any]:
    """What the page shows."""
    sensors = watched.sensors
    shown = sensors.shown()
    trends = [*sensors.trends, *(() for _ in shown[len(sensors.trends) :])]
    return {
        "page": "monitor",
        "title": title,
        "says": says,
        "asks": asks,
        "ended": False,
        "newest": watched.newest_unix_s,
        "rows": [_row(each, list(trend)) for each, trend in zip(shown, trends, strict=False)],
        "seen": list(watched.seen)[-40:],
    }


def _row(shown: Shown, trend: Sequence[tuple[float, float]]) -> dict[str, Any]:
    most = max(abs(shown.least), abs(shown.most))
    share = most / shown.range if math.isfinite(shown.range) and math.isfinite(most) else None
    return {
        "name": shown.name,
        "physical": shown.physical,
        "state": shown.state,
        "sheet": shown.sheet,
        "share": share,
        "trend": _steps(np.array(trend).reshape(-1, 2), shown),
        **shown.words,
    }


def _steps(trend: Any, shown: Shown) -> list[list[int]]:
    """Least and largest of each column, as whole steps from the plot's lower edge to its upper one."""
    trend = trend[np.isfinite(trend).all(axis=1)]
    if not len(trend):
        return [[], []]
    parts = np.array_split(trend, min(len(trend), _COLUMNS))
    low, high = (np.array([f(part[:, k]) for part in parts]) for k, f in ((0, np.min), (1, np.max)))
    middle = (float(low.min()) + float(high.max())) / 2
    least = _HIGH * shown.noise if math.isfinite(shown.noise) else 0.0
    reach = max(float(np.ptp([low.min(), high.max()])), least, 1e-12) / 2
    return [np.rint(((each - middle) / reach + 1) * _STEPS / 2).astype(int).tolist() for each in (low, high)]
