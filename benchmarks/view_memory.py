"""What the live view keeps of a long run: the load's records, as fast as they are taken.

The resident memory of a process that frees much and keeps little moves by more in an hour of real time than
what is asked of it. Here what each of the two processes of the view does with records is done, one after the
other in this one, for 64 channels at 51.2 kHz and their predictions. What Python and glibc hand out and have
not got back is counted, between records, once each simulated minute: by a straight line over the last two
thirds, MB an hour. What Rerun has in its own store (mimalloc) is seen in the resident memory alone.

Returns 1 where the first grows by 1 MB an hour or more, or the second by 60.

Usage: python -m benchmarks.view_memory [--seconds S]
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import numpy as np
import psutil
import rerun as rr

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.log.reader import CYCLE_PEAK, Origin, derived_name
from daq.log.records import Impact
from rig.live.blueprint import blueprint
from rig.live.page_state import PageState
from rig.live.picture import Layout, layout_of
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.scene import Scene
from rig.live.time_line_process import ViewerServer
from rig.live.view import Shown
from rig.stream import Block, Shape

RATE, BLOCK_S, CYCLE_S, CHANNELS = 51_200.0, 0.15, 0.3, 64
MOST_MB_AN_HOUR, MOST_RESIDENT_MB_AN_HOUR = 1.0, 60.0
_OF_THE_TWIN = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y",
                "crank.angle", "crank.marker")  # fmt: skip
_PICTURE = PlanarCrankPicture(0.150, 0.564, 1e-3, 1e-3, 20.0)
_BY_MALLOC = {"PYTHONMALLOC": "malloc", "MALLOC_ARENA_MAX": "1", "RUST_LOG": "off"}
"""So that it is counted in one place, but for Rerun's own; and what Rerun says of itself is not printed."""
_EVERY_S = 60.0


class _Counts(ctypes.Structure):
    """mallinfo2(3)."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks",
                     "fordblks", "keepcost")
    )  # fmt: skip


def in_use_mb() -> float:
    """What this process has asked for and not given back."""
    gc.collect()
    count = ctypes.CDLL(None).mallinfo2
    count.restype = _Counts
    found = count()
    return float(found.uordblks + found.hblkhd) / 1e6


def layout() -> Layout:
    """Of the planar crank with more accelerometers than its twin predicts."""
    units = {"crank.angle": "rad", "crank.marker": "V"}
    predicted = [Channel(name, units.get(name, "m/s^2")) for name in _OF_THE_TWIN]
    beside = [Channel(f"bed.acceleration_{k}", "m/s^2") for k in range(CHANNELS - len(predicted))]
    return layout_of("load", [*predicted, *beside], predicted, picture=_PICTURE, cycle_s=CYCLE_S)


def records(shown: Layout, seconds: float) -> Iterator[tuple[float, Shown]]:
    """What a run of so many seconds gives, with the time of each."""
    rng, length = np.random.default_rng(1), round(RATE * BLOCK_S)
    noise = rng.standard_normal((8, length)).astype(np.float32)
    for number in range(round(seconds / BLOCK_S)):
        at_s, first = number * BLOCK_S, number * length
        time_ns = round(at_s * NS_PER_S)
        for origin, names in shown.origins.items():
            for k, name in enumerate(names):
                values = noise[(number + k) % 8].copy()
                if name == "crank.angle":
                    values = (first + np.arange(length)) / RATE * 2 * np.pi / CYCLE_S
                yield at_s, Block(origin, SampleBlock(name, first, time_ns, RATE, values))
                if number % 2 == 0:
                    yield at_s, _peak(origin, name, number, time_ns)
        at_pin = np.array([[0.0, 0.0], [0.15, 0.0], [0.15, 0.0], [0.71, 0.0], [0.71, 0.0]])
        yield at_s, Shape(at_s, at_pin)
        end, turns = first + 50, at_s / CYCLE_S
        struck = Impact(
            time_ns, "measured", _OF_THE_TWIN[0], first, end, end - 20, 100.0, 90.0, 0.1, 1e-3, 0, turns
        )
        yield at_s, struck


def _peak(origin: Origin, name: str, number: int, time_ns: int) -> Block:
    values = np.array([1.0])
    return Block(
        "derived",
        SampleBlock(derived_name(origin, name, CYCLE_PEAK), number // 2, time_ns, 1 / CYCLE_S, values),
    )


def growth(
    take: Callable[[Shown], object], shown: Layout, seconds: float
) -> tuple[list[float], list[float], list[float]]:
    """MB an hour over the last two thirds in use and resident, and both in each minute."""
    used, resident = list[float](), list[float]()
    for at_s, record in records(shown, seconds):
        if at_s >= len(used) * _EVERY_S:
            used.append(in_use_mb())
            ctypes.CDLL(None).malloc_trim(0)  # as these processes do
            resident.append(psutil.Process().memory_info().rss / 1e6)
        take(record)
    hours = np.arange(len(used)) * _EVERY_S / 3600.0
    late = slice(len(used) // 3, None)
    slopes = [float(np.polyfit(hours[late], each[late], 1)[0]) for each in (used, resident)]
    return slopes, used, resident


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seconds", type=float, default=1200.0)
    seconds = parser.parse_args().seconds
    if any(os.environ.get(name) != value for name, value in _BY_MALLOC.items()):
        arguments = [sys.executable, "-m", "benchmarks.view_memory", *sys.argv[1:]]
        os.execve(sys.executable, arguments, os.environ | _BY_MALLOC)  # noqa: S606
    shown, met = layout(), True
    state = PageState(lambda _: None)
    state.take(shown)

    def page(record: Shown) -> None:
        state.take(record)
        state.look()

    with ExitStack() as stack:
        server = stack.enter_context(ViewerServer("64MB"))
        recording = rr.RecordingStream("rattle")
        recording.connect_grpc(server.sink_url, default_blueprint=blueprint(shown))
        scene = Scene(recording, shown, 3.0)
        scene.open()
        for name, take in (("live view", page), ("time line", lambda record: scene.show((record,)))):
            begun = time.monotonic()
            slopes, used, resident = growth(take, shown, seconds)
            met &= slopes[0] < MOST_MB_AN_HOUR and slopes[1] < MOST_RESIDENT_MB_AN_HOUR
            third = len(used) // 3
            print(
                f"{name}: in use {slopes[0]:+.2f} MB/h (bar {MOST_MB_AN_HOUR:g}; {used[third]:.1f} MB after "
                f"a third, {used[-1]:.1f} at the end), resident {slopes[1]:+.1f} MB/h (bar "
                f"{MOST_RESIDENT_MB_AN_HOUR:g}; {resident[third]:.0f} and {resident[-1]:.0f} MB of both); "
                f"{time.monotonic() - begun:.0f} s",
                flush=True,
            )
    return int(not met)


if __name__ == "__main__":
    raise SystemExit(main())
