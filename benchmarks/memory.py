"""What each process of a long run keeps: the load's records, as fast as they are taken.

The resident memory of a process that frees much and keeps little moves by more in an hour of real time than
what is asked of it. Here what acquisition, twin, derivation and the two processes of the view do with records
is done, each in a process by itself, for 64 channels at 51.2 kHz and their predictions. What Python and glibc
hand out and have not got back is counted, between records, once each simulated minute: by a straight line
over the last two thirds, MB an hour. What Rerun has in its own store (mimalloc) is seen in the resident
memory alone.

Returns 1 where the first grows by 1 MB an hour or more, or the second by 60.

Usage: python -m benchmarks.memory [PART ...] [--seconds S]
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import psutil
import rerun as rr

from benchmarks.in_use import in_use_mb
from benchmarks.recording_load import CRANK, MOST_MB_AN_HOUR, MOST_RESIDENT_MB_AN_HOUR
from daq.block import NS_PER_S, Flag, SampleBlock
from daq.channel import Channel
from daq.clock import SystemClock
from daq.log.reader import CYCLE_PEAK, Origin, derived_name
from daq.log.records import Impact
from daq.log.writer import CHUNK_S, LogWriter
from daq.recorder import Recorder
from drivers.protocols.card import CardReading
from rig.derived.derivation import Derivation
from rig.files.scenario import Limit, Scenario, parse_scenario
from rig.live.blueprint import blueprint
from rig.live.page_state import PageState
from rig.live.picture import Layout, layout_of
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.scene import Scene
from rig.live.time_line_process import ViewerServer
from rig.live.view import Shown
from rig.session.acquisition import READING_S, Acquisition
from rig.session.interlock import LimitWatch
from rig.stream import Block, Record, Shape, Stream
from rig.twin.scenario_twin import twin_of
from rig.twin.worker import Drive, Predict, RecordedSpan

RATE, BLOCK_S, CYCLE_S, CHANNELS = 51_200.0, 0.15, 0.3, 64
_OF_THE_TWIN = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y",
                "crank.angle", "crank.marker")  # fmt: skip
_PICTURE = PlanarCrankPicture(0.150, 0.564, 1e-3, 1e-3, 20.0)
_ALONE = {"PYTHONMALLOC": "malloc", "MALLOC_ARENA_MAX": "1", "RUST_LOG": "off"}
"""So that it is counted in one place, but for Rerun's own; and what Rerun says of itself is not printed."""
_EVERY_S, _LEAST_S = 60.0, 600.0


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


class Minutes:
    """What is in use and resident, MB, in each simulated minute."""

    def __init__(self) -> None:
        self.used, self.resident = list[float](), list[float]()

    def due(self, at_s: float) -> bool:
        """Whether the next look is due by then."""
        return at_s >= len(self.used) * _EVERY_S

    def look(self, at_s: float) -> None:
        """To be called where nothing is under way."""
        if self.due(at_s):
            gc.collect()
            self.used.append(in_use_mb())
            ctypes.CDLL(None).malloc_trim(0)
            self.resident.append(psutil.Process().memory_info().rss / 1e6)

    def growth(self) -> list[float]:
        """MB an hour over the last two thirds, of both."""
        hours = np.arange(len(self.used)) * _EVERY_S / 3600.0
        late = slice(len(self.used) // 3, None)
        return [float(np.polyfit(hours[late], each[late], 1)[0]) for each in (self.used, self.resident)]


def live_view(seconds: float, minutes: Minutes) -> None:
    """The page."""
    shown, state = layout(), PageState(lambda _: None)
    state.take(shown)
    for at_s, record in records(shown, seconds):
        minutes.look(at_s)
        state.take(record)
        state.look()


def time_line(seconds: float, minutes: Minutes) -> None:
    shown = layout()
    with ViewerServer("64MB") as server:
        recording = rr.RecordingStream("rattle")
        recording.connect_grpc(server.sink_url, default_blueprint=blueprint(shown))
        scene = Scene(recording, shown, 3.0)
        scene.open()
        for at_s, record in records(shown, seconds):
            minutes.look(at_s)
            scene.show((record,))


def derivation(seconds: float, minutes: Minutes) -> None:
    shown = layout()
    derive = Derivation(lambda _: None, shown.origins, _scenario())
    for at_s, record in records(shown, seconds):
        minutes.look(at_s)
        if isinstance(record, Block) and record.origin != "derived":
            derive(record)


def twin(seconds: float, minutes: Minutes) -> None:
    scenario = _scenario()
    of_rig = twin_of(scenario, _OF_THE_TWIN)
    step, per_s = round(RATE * BLOCK_S), of_rig.drive.cycle_hz * 2 * np.pi / RATE

    def fed() -> Iterator[Drive | RecordedSpan]:
        for number in range(round(seconds / BLOCK_S)):
            minutes.look(number * BLOCK_S)
            first = number * step
            yield Drive(first, per_s * (first + np.arange(step)))
            yield RecordedSpan(0, first + step, 0)

    Predict(of_rig, "crank.angle", RATE, 1.0).run(fed(), lambda _: None)


class _FastCard:
    """Noise of 64 channels, as fast as it is read; looks at memory once all that came is written."""

    name, address, warnings, sample_rate = "card", "noise", (), RATE

    def __init__(self, channels: Sequence[Channel], look: Callable[[float], None]) -> None:
        self.channels, self._look, self._next = tuple(channels), look, 0
        self._noise = np.random.default_rng(1).standard_normal((8, CHANNELS, round(RATE * READING_S)))

    def arm(self) -> None: ...

    def start(self) -> None: ...

    def stop(self) -> None: ...

    def open(self) -> None: ...

    def close(self) -> None: ...

    def started_s(self) -> float | None:
        return None

    def read(self, count: int) -> CardReading:
        first, self._next = self._next, self._next + count
        self._look(first / RATE)
        values = self._noise[first // count % 8].copy()
        return CardReading(first, values, (Flag.GOOD,) * CHANNELS, SystemClock().monotonic_s())


def acquisition(seconds: float, minutes: Minutes) -> None:
    """Reader, limits and recorder; a disk that takes it all."""
    clock, stream = SystemClock(), Stream()
    channels = [Channel(f"bed.acceleration_{k}", "m/s^2") for k in range(CHANNELS)]
    limits = LimitWatch((Limit(channels[0].name, "m/s^2", None, 1e6),), RATE)
    with tempfile.TemporaryDirectory() as at, Recorder(LogWriter(Path(at) / "log.mcap"), clock) as recorder:

        def look(at_s: float) -> None:
            while recorder.waiting_bytes:
                clock.sleep(1e-3)
            if minutes.due(at_s):
                clock.sleep(2 * CHUNK_S)  # what waits in a chunk is written by then
                minutes.look(at_s)

        def record(each: Record) -> None:
            if isinstance(each, Block):
                recorder.block(each.origin, each.samples)

        for channel in channels:
            recorder.declare("measured", channel)
        stream.append(record)
        with Acquisition(_FastCard(channels, look), clock, stream, limits) as running:
            running.start_record(round(seconds * RATE))
            with running.changed:
                running.changed.wait_for(lambda: running.acquired >= seconds * RATE or running.error)
            running.check()


PARTS: dict[str, Callable[[float, Minutes], None]] = {
    "acquisition": acquisition,
    "twin": twin,
    "derivation": derivation,
    "live view": live_view,
    "time line": time_line,
}


def _scenario() -> Scenario:
    """Of the planar crank, at the load's rate."""
    return parse_scenario(re.sub(r'sample_rate = ".*"', f'sample_rate = "{RATE:g} Hz"', CRANK.read_text()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--seconds", type=float, default=1200.0)
    arguments = parser.parse_args()
    if arguments.seconds < _LEAST_S:
        parser.error(f"--seconds: at least {_LEAST_S:g}, for a line through seven minutes")
    if len(arguments.parts) == 1 and _ALONE.items() <= os.environ.items():
        return int(not _met(arguments.parts[0], arguments.seconds))
    codes = [
        subprocess.run(  # noqa: S603
            [sys.executable, "-m", "benchmarks.memory", part, "--seconds", f"{arguments.seconds:g}"],
            env=os.environ | _ALONE,
            check=False,
        ).returncode
        for part in arguments.parts or PARTS
    ]
    return int(any(codes))


def _met(part: str, seconds: float) -> bool:
    begun, minutes = time.monotonic(), Minutes()
    PARTS[part](seconds, minutes)
    used, resident = minutes.growth()
    third = len(minutes.used) // 3
    print(
        f"{part}: in use {used:+.2f} MB/h (bar {MOST_MB_AN_HOUR:g}; {minutes.used[third]:.1f} MB after a "
        f"third, {minutes.used[-1]:.1f} at the end),\n    resident {resident:+.1f} MB/h (bar "
        f"{MOST_RESIDENT_MB_AN_HOUR:g}; {minutes.resident[third]:.0f} and {minutes.resident[-1]:.0f} MB); "
        f"{time.monotonic() - begun:.0f} s",
        flush=True,
    )
    return used < MOST_MB_AN_HOUR and resident < MOST_RESIDENT_MB_AN_HOUR


if __name__ == "__main__":
    raise SystemExit(main())
