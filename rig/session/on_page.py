"""A live view that says what the screen says: on this machine's page, from before anything is connected."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rig.session.progress import Screen
from rig.session.signals import StopRequest

if TYPE_CHECKING:
    from rig.live.picture import Layout
    from rig.live.view import LiveView
    from rig.report.record import Verdict

_STAYS: Final = "the time line of the live view stays open; Enter closes it"


@contextmanager
def on_page(screen: Screen) -> Iterator[LiveView]:
    """Start a view and name its page; raises InstrumentAbsent where that cannot be served.

    The page is this machine's, which is started if it is not there, and stays.
    """
    from rig.live.page_server import (
        ensure_page,
        page_port,
        page_url,
    )  # what nobody watches need not load Rerun
    from rig.live.view import LiveView, Progress

    port = page_port()
    if port:
        ensure_page(port)
        screen.say(f"live view  {page_url(port)}")
    view = LiveView(page_port=port).start()

    def tell(text: str, done: float, total: float, unit: str, left_s: float | None) -> None:
        view.offer(Progress(text, done, total, unit, None if left_s is None else time.time() + left_s))

    screen.stages.append(tell)
    try:
        yield view
    except BaseException as error:
        view.offer(Progress(str(error) or "stopped", failed=True))
        raise
    finally:
        screen.stages.remove(tell)
        view.close()


def show(view: LiveView, layout: Layout, screen: Screen) -> None:
    """Show these channels, and name the addresses that are new; raises InstrumentAbsent without Rerun."""
    view.show(layout)
    if view.url:
        return
    view.open()
    for what, url in (("live view ", view.page_url), ("time line ", view.url)):
        if url:
            screen.say(f"{what} {url}")


def come_to(
    view: LiveView,
    screen: Screen,
    what: str,
    verdict: Verdict | None = None,
    report: Path | None = None,
    stays: bool = True,
) -> None:
    """Show what it came to; then the view `stays` until a person, if there is one, closes it."""
    from rig.live.view import Outcome

    sentences, well = ((), None) if verdict is None else (verdict.sentences, verdict.well)
    view.offer(Outcome(sentences, well, report))
    screen.stage(what)
    if not stays:
        return
    with StopRequest() as stop:
        screen.hold(_STAYS, lambda: stop.wanted)
