"""The process that tells the operator's page what a run gives, and hands it on to the time line's."""

from __future__ import annotations

import pickle
import select
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection
from pathlib import Path

from daq.errors import InstrumentAbsent
from daq.process import give_way
from rig.live.page_server import PageServer, Teller
from rig.live.page_state import PERIOD_S, PageState
from rig.live.picture import Layout
from rig.live.view import (
    LAST_WORDS_S,
    Dropped,
    OfThePage,
    Outcome,
    Progress,
    Sender,
    Shown,
    queue_bytes,
)


def tell_page(pipe: Connection, onward: Connection, page_port: int) -> None:
    """Tell the page at `page_port`, 0: one of its own, until None comes; the first answer is its address."""
    with ExitStack() as stack:
        try:
            own = stack.enter_context(PageServer(0)) if page_port == 0 else None
        except InstrumentAbsent as error:
            pipe.send(str(error))
            return
        tell = Teller(page_port if own is None else own.port)
        stack.callback(tell.close, LAST_WORDS_S)
        pipe.send(("" if own is None else own.url,))
        give_way()
        time_line = Sender(onward)
        time_line.start()
        stack.callback(time_line.close, LAST_WORDS_S)
        state = PageState(tell)
        for pickled, frame in records(pipe, state):
            match frame:
                case Dropped(count):
                    time_line.lost_before = count
                case Outcome(report=Path() as report):
                    with suppress(OSError):  # then the page has no report, the folder of the run may
                        tell.report(report.read_bytes())
                case _ if not isinstance(frame, OfThePage):
                    if isinstance(frame, Layout):
                        time_line.maximum_bytes = queue_bytes(frame)
                    time_line.pass_on(pickled, ages=False)
        state.end()


def records(pipe: Connection, state: PageState) -> Iterator[tuple[bytes, Shown]]:
    """What comes, until None does, as it came and unpickled; the page's state has heard of it."""
    poll = select.poll()  # `pipe.poll` would make a selector each time
    poll.register(pipe, select.POLLIN)
    while True:
        try:
            while not poll.poll(PERIOD_S * 1000):
                state.look()
            pickled = pipe.recv_bytes()
            frame: Shown | None = pickle.loads(pickled)  # noqa: S301 - by our own acquisition
        except (EOFError, OSError):
            frame = None
            state.take(Progress("the run has gone without a word", failed=True))
        if frame is None:
            return
        state.take(frame)
        state.look()
        yield pickled, frame
