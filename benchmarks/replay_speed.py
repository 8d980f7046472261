"""`rattle replay --speed 0` of sixteen channels, measured and predicted: how many times real time it is.

The log is a synthetic beam: sines, contacts that ring, noise and the steps of a 24-bit converter on what is
measured. Returns 1 if the replay is not 50 times as fast as the run was.
"""

from __future__ import annotations

import argparse
import io
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.clock import SystemClock
from daq.log.reader import Origin
from daq.log.writer import LogWriter
from rig.session.progress import Screen
from rig.session.replay import replay_log

RATE, BLOCK = 51_200.0, 5120
START_NS = 1_790_000_000_000_000_000
BAR = 50.0
DRIVE_HZ, CONTACT_S = 20.0, 1e-3
STEP = 200.0 / 2**23
LATE: Final[Mapping[Origin, int]] = {"measured": 0, "predicted": 3}
"""Blocks by which an origin comes later."""
NAMES = (
    "drive.force",
    "contact.force_upper",
    "contact.force_lower",
    "yoke.force",
    "base.acceleration",
    *(f"beam.acceleration_{percent:02d}" for percent in range(5, 93, 8)),
)
SCENARIO = """\
name = "sixteen channels"
rig = "impact_beam"
[drive]
frequency = "20 Hz"
amplitude = "9 N"
[acquisition]
sample_rate = "51.2 kHz"
duration = "60 s"
"""


@dataclass(frozen=True, slots=True)
class Speed:
    """Times real time, by the wall clock and by the processor time of all threads."""

    wall: float
    processor: float


def main() -> int:
    arguments = _arguments()
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        write_log(log, arguments.seconds)
        mib = log.stat().st_size / 2**20
        print(f"log                    2 x {len(NAMES)} channels, {arguments.seconds:g} s, {mib:.0f} MiB")
        _replay(log, arguments.seconds)  # the file in memory, the kernels compiled
        speeds = [_replay(log, arguments.seconds) for _ in range(arguments.repetitions)]
        commands = [_command(log) for _ in range(arguments.repetitions)]
    best, median = max(each.wall for each in speeds), statistics.median(each.wall for each in speeds)
    print(f"times real time        median {median:.1f}, best {best:.1f} of {len(speeds)} (bar {BAR:g})")
    processor = statistics.median(each.processor for each in speeds)
    print(f"per processor second   {processor:.1f} s of the record")
    print(f"the whole command      {statistics.median(commands):.1f} s, with start-up and summary")
    print(f"load                   {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    return 0 if median >= BAR else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--repetitions", type=int, default=5)
    return parser.parse_args()


def _replay(log: Path, seconds: float) -> Speed:
    out = io.StringIO()
    wall, processor = time.perf_counter(), time.process_time()
    replay_log(log, 0.0, None, Screen(Console(file=out)), SystemClock())
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    assert "derived" in out.getvalue()
    return Speed(seconds / wall, seconds / processor)


def _command(log: Path) -> float:
    """Seconds that `rattle replay` takes, as a user starts it."""
    started = time.perf_counter()
    command = [sys.executable, "-m", "rig.start", "replay", str(log), "--speed", "0"]
    subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - our own
    return time.perf_counter() - started


def write_log(path: Path, seconds: float) -> None:
    """As a run writes it: a prediction comes some blocks after its measurement."""
    traces = {origin: _traces(origin) for origin in LATE}
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": SCENARIO})
        for origin in traces:
            for name in NAMES:
                log.declare(origin, Channel(name, "N" if "force" in name else "m/s2"))
        for number in range(round(seconds * RATE / BLOCK) + max(LATE.values())):
            for origin, block in _due(number, round(seconds * RATE / BLOCK), traces):
                log.add_block(origin, block, START_NS + number * 100_000_000)


def _due(
    number: int, blocks: int, traces: dict[Origin, NDArray[np.float32]]
) -> Iterator[tuple[Origin, SampleBlock]]:
    for origin, late in LATE.items():
        if 0 <= number - late < blocks:
            first = (number - late) * BLOCK
            for name, row in zip(NAMES, traces[origin], strict=True):
                values = row[first % len(row) : first % len(row) + BLOCK]
                yield origin, SampleBlock(name, first, sample_time_ns(START_NS, first, RATE), RATE, values)


def _traces(origin: Origin) -> NDArray[np.float32]:
    """Ten seconds of every channel, shape (channels, n), to be repeated: whole cycles of the drive."""
    random = np.random.default_rng(len(origin))
    times = np.arange(round(10 * RATE)) / RATE
    rows = []
    for number, name in enumerate(NAMES):
        values = _values(name, number, times, random)
        if origin == "measured":
            values = np.rint((values + random.normal(scale=0.05, size=len(times))) / STEP) * STEP
        rows.append(values.astype(np.float32))
    return np.array(rows)


def _values(
    name: str, number: int, times: NDArray[np.float64], random: np.random.Generator
) -> NDArray[np.float64]:
    if name == "drive.force":
        return 9.0 * np.sin(2 * np.pi * DRIVE_HZ * times)
    late_s = {"contact.force_upper": 0.005, "contact.force_lower": 0.030}.get(name)
    if late_s is not None:
        return _contacts(times, late_s, random)
    ringing = np.exp(-((times * 2 * DRIVE_HZ) % 1.0) * 8) * np.sin(2 * np.pi * (300 + 90 * number) * times)
    return 20.0 * ringing * np.repeat(random.uniform(0.5, 1.0, len(times) // 1280), 1280)


def _contacts(times: NDArray[np.float64], late_s: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Five contacts in each cycle, of which the first is the hardest."""
    phase = times % (1 / DRIVE_HZ)
    size = np.repeat(random.uniform(20.0, 50.0, len(times) // 2560), 2560)
    force = np.zeros(len(times))
    for bounce in range(5):
        x = (phase - late_s - 0.002 * bounce) / CONTACT_S
        force += size * 0.7**bounce * np.where((x > 0) & (x < 1), np.sin(np.pi * np.clip(x, 0, 1)), 0.0)
    return force


if __name__ == "__main__":
    sys.exit(main())
