import os
import time
from collections.abc import Iterator
from contextlib import closing

import pytest

from rig.live.frames import Dropped, encode, read_frames
from rig.live.sender import FrameSender

Pipe = tuple[int, int]


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    reading, writing = os.pipe()
    yield reading, writing
    os.close(reading)


def test_frames_come_out_in_order_and_the_pipe_is_closed(pipe: Pipe) -> None:
    sender = FrameSender(pipe[1], 1 << 20)
    sender.start()
    for count in range(1, 100):
        sender.offer(encode(Dropped(count)))
    sender.close(5.0)
    with open(os.dup(pipe[0]), "rb") as stream:
        assert list(read_frames(stream)) == [Dropped(count) for count in range(1, 100)]


def test_a_reader_that_stands_still_costs_the_oldest_frames_and_no_time(pipe: Pipe) -> None:
    sender = FrameSender(pipe[1], 1 << 20)
    sender.start()
    frame = bytes(1 << 16)
    slowest = 0.0
    for _ in range(1000):
        before = time.perf_counter()
        sender.offer(frame)
        slowest = max(slowest, time.perf_counter() - before)
    # 62 MiB offered; the queue (1 MiB), the pipe (1 MiB) and the frame being written hold 34 of the frames.
    assert sender.dropped >= 1000 - 34
    assert slowest < 0.1  # against seconds, had it waited; 0.1 s leaves room for other programs' turns
    before = time.monotonic()
    sender.close(0.2)
    assert time.monotonic() - before < 1.0  # the timeout and one poll


def test_a_reader_that_is_gone_is_noticed_and_nothing_is_kept(pipe: Pipe) -> None:
    reading, writing = os.pipe()
    sender = FrameSender(writing, 1 << 20)
    sender.start()
    with closing(open(reading, "rb")):
        pass
    sender.offer(bytes(100))
    deadline = time.monotonic() + 5.0
    while not sender.broken and time.monotonic() < deadline:
        time.sleep(0.01)
    assert sender.broken
    sender.offer(bytes(100))
    assert sender.dropped == 1
    sender.close(1.0)
