"""What goes from the acquisition to the view's processes: in order, as it was, and never waited for."""

from __future__ import annotations

import time
from collections.abc import Iterator
from math import nan
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import numpy as np
import pytest

from daq.block import Flag, SampleBlock
from daq.log.records import Event, Impact
from rig.live.view import Dropped, Sender, Shown
from rig.stream import Block, Shape

Pair = tuple[Connection, Connection]


@pytest.fixture
def pipe() -> Iterator[Pair]:
    reading, writing = Pipe()
    yield reading, writing
    reading.close()
    writing.close()


def sent(pipe: Pair, *records: Shown) -> list[Shown | None]:
    """What comes out at the other end, to the last word."""
    sender = Sender(pipe[1], 1 << 20)
    sender.start()
    for record in records:
        sender.offer(record)
    sender.close(5.0)
    return [pipe[0].recv() for _ in range(len(records) + 1)]


def test_records_come_out_in_order_and_then_that_it_was_all(pipe: Pair) -> None:
    records = [Dropped(count) for count in range(1, 100)]
    assert sent(pipe, *records) == [*records, None]


def test_a_block_arrives_as_it_was_sent(pipe: Pair) -> None:
    values = np.linspace(-1.0, 1.0, 100, dtype=np.float32)
    block = SampleBlock(
        "contact.force_upper", 2**40, 1_790_000_000_123_456_789, 51_200.25, values, Flag.OVERLOAD
    )
    found, _ = sent(pipe, Block("predicted", block))
    assert isinstance(found, Block)
    assert found.origin == "predicted"
    assert found.samples.values.dtype == np.float32
    assert np.array_equal(found.samples.values, values)
    for field in ("channel", "first_sample", "time_ns", "sample_rate", "flags"):
        assert getattr(found.samples, field) == getattr(block, field)


def test_an_unwrapped_angle_keeps_its_double_precision(pipe: Pair) -> None:
    block = SampleBlock("crank.angle", 0, 0, 1.0, np.array([1e5 + 1e-9, 2e5]))
    found, _ = sent(pipe, Block("measured", block))
    assert isinstance(found, Block)
    assert found.samples.values.tolist() == [1e5 + 1e-9, 2e5]


@pytest.mark.parametrize("turns", [12.75, nan])
def test_what_is_no_block_arrives_as_it_was_found(pipe: Pair, turns: float) -> None:
    impact = Impact(
        1_790_000_000_123_456_789, "predicted", "socket.force", 7, 20, 9, 12.5, 11.0, 1e-3, 2e-4, 1, turns
    )
    event = Event(5, "warning", "daq_card", "overload", "über dem Bereich\n")
    shape = Shape(0.25, np.array([[0.0, 0.28], [0.0, 1e-4], [1.0, 2.0]]))
    found = sent(pipe, impact, event, shape)
    assert repr(found[0]) == repr(impact)  # NaN is not equal to itself
    assert found[1] == event
    assert isinstance(found[2], Shape)
    assert np.array_equal(found[2].points_m, shape.points_m)


def test_a_reader_that_stands_still_costs_the_oldest_records_and_no_time(pipe: Pair) -> None:
    sender = Sender(pipe[1], 1 << 20)
    sender.start()
    record = Block("measured", SampleBlock("a", 0, 0, 1.0, np.zeros(1 << 14, np.float32)))  # 64 KiB
    slowest = 0.0
    for _ in range(1000):
        before = time.perf_counter()
        sender.offer(record)
        slowest = max(slowest, time.perf_counter() - before)
    # 62 MiB offered; the queue (1 MiB), the pipe (1 MiB at most) and the one being sent hold 34 of them.
    assert sender.dropped >= 1000 - 34
    assert slowest < 0.1  # against seconds, had it waited; 0.1 s leaves room for other programs' turns
    before = time.monotonic()
    sender.close(0.2)
    assert time.monotonic() - before < 1.0  # the timeout
    pipe[0].close()
    sender.close(None)


def test_a_reader_that_was_slow_goes_on_with_the_newest_samples_and_misses_no_event(pipe: Pair) -> None:
    sender = Sender(pipe[1], 64 << 20, patience_s=0.2)
    sender.start()
    big = np.zeros(1 << 16, np.float32)
    event = Event(5, "warning", "daq_card", "overload", "over its range")
    for first in range(40):  # more than the pipe holds
        sender.offer(Block("measured", SampleBlock("a", first, 0, 1.0, big)))
    sender.offer(event)
    time.sleep(0.4)
    found = [pipe[0].recv()]  # it was on its way
    deadline = time.monotonic() + 5.0
    while sender.dropped == 0 and time.monotonic() < deadline:  # else this one might be among what is too old
        time.sleep(0.01)
    sender.offer(Block("measured", SampleBlock("a", 99, 0, 1.0, big)))
    while not (isinstance(found[-1], Block) and found[-1].samples.first_sample == 99):
        found.append(pipe[0].recv())
    sender.close(1.0)
    assert event in found
    blocks = [each for each in found if isinstance(each, Block)]
    assert sender.dropped == 41 - len(blocks) >= 30
    assert Dropped(sender.dropped) in [*found, pipe[0].recv()]


def test_a_reader_that_is_gone_is_noticed_and_nothing_is_kept(pipe: Pair) -> None:
    sender = Sender(pipe[1], 1 << 20)
    sender.start()
    pipe[0].close()
    sender.offer(Dropped(0))
    deadline = time.monotonic() + 5.0
    while not sender.broken and time.monotonic() < deadline:
        time.sleep(0.01)
    assert sender.broken
    sender.offer(Dropped(0))
    assert sender.dropped == 1
    sender.close(1.0)
