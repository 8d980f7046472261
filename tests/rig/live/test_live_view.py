"""The live view against its processes: they stall, they die, and whoever offers does not notice."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import psutil
import pytest

from daq.block import SampleBlock
from daq.channel import Channel
from daq.log.records import Event
from rig.live.page_server import PageServer
from rig.live.picture import layout_of
from rig.live.view import LiveView, Processes, Progress
from rig.stream import Block, Shape
from tests.rig.synthetic_run import RATE, START_NS
from tests.tiers import first_short

MANY = tuple(Channel(f"channel_{index}", "N") for index in range(16))
QUIET = np.zeros(5120, np.float32)
CLOSE_S = 2.0

EACH = Processes._fields


@pytest.fixture
def view() -> Iterator[LiveView]:
    live = LiveView(layout_of("16 channels", MANY, MANY))
    live.open()
    yield live
    live.close(CLOSE_S)


def offer(live: LiveView, seconds: float, start_s: float = 0.0) -> float:
    """Offer so much data of 16 channels, measured and predicted, and return the slowest call in s."""
    slowest = 0.0
    for first in range(round(start_s * RATE), round((start_s + seconds) * RATE), len(QUIET)):
        for channel in MANY:
            block = SampleBlock(channel.name, first, START_NS, RATE, QUIET)
            before = time.perf_counter()
            live.offer(Block("measured", block))
            live.offer(Block("predicted", block))
            slowest = max(slowest, time.perf_counter() - before)
    return slowest


def slowest_offer(live: LiveView, seconds: float = 5.0) -> float:
    """Slowest call of the best of three rounds: what waits does so in each, a busy machine does not."""
    return min(offer(live, seconds, start_s=round_ * seconds) for round_ in range(3))


def wait_until(done: Callable[[], bool], seconds: float = 10.0) -> bool:
    deadline = time.monotonic() + seconds
    while not done():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


def closed_within_its_deadline(live: LiveView) -> bool:
    before = time.monotonic()
    live.close(CLOSE_S)
    return time.monotonic() - before < CLOSE_S + 1.0  # one second to end what did not end by itself


def processor_s(process: psutil.Process) -> float:
    spent = process.cpu_times()
    return spent.user + spent.system


def gone(process: int) -> bool:
    return not psutil.pid_exists(process) or psutil.Process(process).status() == psutil.STATUS_ZOMBIE


@pytest.mark.parametrize("which", first_short(EACH))
def test_a_stalled_viewer_costs_the_caller_neither_time_nor_memory(view: LiveView, which: str) -> None:
    stalled: int = getattr(view.processes, which)
    os.kill(stalled, signal.SIGSTOP)
    before = psutil.Process().memory_info().rss
    assert slowest_offer(view) < 0.02  # the figure asked for
    # 98 MB were offered; the queue holds 16 MiB of it, and the rest of the margin is the allocator's.
    assert psutil.Process().memory_info().rss - before < 40e6
    assert closed_within_its_deadline(view)
    assert wait_until(lambda: gone(stalled))


@pytest.mark.long
@pytest.mark.parametrize("which", EACH)
def test_a_killed_viewer_is_not_noticed_by_the_caller(view: LiveView, which: str) -> None:
    processes = view.processes
    assert view.alive
    os.kill(getattr(processes, which), signal.SIGKILL)
    assert wait_until(lambda: not view.alive)
    assert slowest_offer(view) < 0.02
    assert closed_within_its_deadline(view)
    assert wait_until(lambda: all(gone(process) for process in processes))


def test_a_stalled_page_process_makes_the_view_drop_and_count(view: LiveView) -> None:
    os.kill(view.processes.page, signal.SIGSTOP)
    offer(view, 6.0)  # 39 MB against a queue of 16 MiB and a pipe of 1 MiB
    assert view.dropped > 0


@pytest.mark.long
@pytest.mark.parametrize("which", ["page", "time_line"])
def test_reruns_server_dies_with_what_feeds_it(view: LiveView, which: str) -> None:
    os.kill(getattr(view.processes, which), signal.SIGKILL)
    assert wait_until(lambda: gone(view.processes.server))


def test_everything_listens_on_loopback_only(view: LiveView) -> None:
    addresses = {
        connection.laddr.ip
        for process in view.processes
        for connection in psutil.Process(process).net_connections(kind="inet")
        if connection.status == psutil.CONN_LISTEN
    }
    assert addresses == {"127.0.0.1"}
    assert view.url.startswith("http://127.0.0.1:")


def test_an_interrupt_at_the_terminal_does_not_reach_the_view(view: LiveView) -> None:
    # Ctrl-C goes to the terminal's foreground process group, and the view is in another session.
    assert {os.getsid(process) for process in view.processes}.isdisjoint({os.getsid(0)})


def test_a_view_that_works_closes_early_and_leaves_nothing_behind(view: LiveView) -> None:
    offer(view, 0.5)
    view.offer(Event(START_NS, "info", "sequencer", "recording", "recording started"))
    view.offer(Shape(0.1, np.zeros(5)))
    processes = view.processes
    assert closed_within_its_deadline(view)
    assert wait_until(lambda: all(gone(process) for process in processes))
    view.offer(Block("measured", SampleBlock("channel_0", 0, START_NS, RATE, QUIET)))
    view.close()


PARENT = """
import os, signal
from rig.live.picture import layout_of
from rig.live.view import LiveView
from daq.channel import Channel
view = LiveView(layout_of("orphans", [Channel("drive.force", "N")], [])).open()
print(*view.processes, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_when_the_acquisition_is_killed_its_view_ends_too() -> None:
    command = [sys.executable, "-c", PARENT]
    parent = subprocess.run(command, stdout=subprocess.PIPE, check=False, timeout=60)  # noqa: S603
    assert parent.returncode == -signal.SIGKILL
    processes = [int(text) for text in parent.stdout.split()]
    assert len(processes) == 3
    assert wait_until(lambda: all(gone(process) for process in processes))


def test_16_channels_at_51200_hz_take_under_3_percent_of_a_core_to_offer_and_half_of_one_to_show(
    view: LiveView,
) -> None:
    """What a view takes is paid for; what it drops, because a busy machine does not let it run, is not."""
    seconds, offered = 5.0, 0
    shows = [psutil.Process(process) for process in view.processes]
    before, shown_before = time.process_time(), [processor_s(each) for each in shows]
    for first in range(0, round(seconds * RATE), len(QUIET)):
        started = time.monotonic()
        offer(view, 0.1, first / RATE)
        offered += 2 * len(MANY)
        time.sleep(max(0.1 - (time.monotonic() - started), 0.0))  # the card's own pace
    offering = (time.process_time() - before) / seconds
    showing = [(processor_s(each) - shown) / seconds for each, shown in zip(shows, shown_before, strict=True)]
    taken = 1.0 - view.dropped / offered
    assert offering < 0.03 * taken  # the budget; 1.2 % as measured
    assert max(showing) < 0.5 * taken


@pytest.mark.long
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("which", ["time_line", "server"])
def test_the_page_is_told_also_once_the_time_line_is_gone_or_hangs_and_that_it_is_over(
    which: str, how: signal.Signals
) -> None:
    with PageServer(0) as page, ExitStack() as stack:
        live = stack.enter_context(LiveView(layout_of("16 channels", MANY, MANY), page_port=page.port))
        os.kill(getattr(live.processes, which), how)

        def told() -> Any:
            found = page.after(0)
            return (found and json.loads(found[1])) or {"channels": []}

        live.offer(Progress("recording", 0.1, 5.0))
        live.offer(Block("measured", SampleBlock("channel_0", 0, START_NS, RATE, QUIET + 3)))
        assert wait_until(lambda: told()["channels"] and told()["channels"][0]["level"] == 3.0)
        assert told()["stage"]["text"] == "recording"
        live.close(CLOSE_S)
        assert told()["ended"]


def test_a_view_of_no_channels_opens() -> None:
    with LiveView(layout_of("nothing", [], [])) as live:
        assert live.alive
