"""A run of a slider-crank made of numbers that are known: angle, marker, rings of a frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.reader import Origin
from daq.log.writer import LogWriter
from tests.rig.synthetic_run import START_NS

RATE, BLOCK, RPM = 25_600.0, 2560, 200.0
PER_TURN = 60.0 / RPM
START_TURN = 0.4
FRAME_HZ, RING_S = 230.0, 0.02
HITS = ((0.25, 80.0), (0.75, 50.0))
"""Where in a turn the frame is hit, and how hard in m/s2."""

CHANNELS = (
    Channel("crank_frame.acceleration_y", "m/s2"),
    Channel("crank.marker", "V"),
    Channel("crank.angle", "rad"),
)

SCENARIO = """
name = "synthetic crank"
rig = "planar_slider_crank"

[drive]
speed = "200 rpm"

[acquisition]
sample_rate = "25.6 kHz"
duration = "5 s"
"""


def samples(channel: str, seconds: float) -> np.ndarray:
    times = np.arange(round(seconds * RATE)) / RATE
    turned = START_TURN + times / PER_TURN
    random = np.random.default_rng(len(channel))
    if channel == "crank.angle":
        return np.floor(turned * 4096) / 4096 * 2 * np.pi
    if channel == "crank.marker":
        return (
            np.where(turned % 1.0 < 5 / 360, 5.0, 0.0) + random.normal(scale=0.02, size=len(times))
        ).astype("f4")
    values = random.normal(scale=0.05, size=len(times))
    for phase, size in HITS:
        since = ((turned - phase) % 1.0) * PER_TURN
        values += size * np.exp(-since / RING_S) * np.cos(2 * np.pi * FRAME_HZ * since)
    return values.astype(np.float32)


def blocks(names: Iterable[str], seconds: float) -> Iterator[SampleBlock]:
    traces = {name: samples(name, seconds) for name in names}
    for first in range(0, round(seconds * RATE), BLOCK):
        for name, values in traces.items():
            time_ns = sample_time_ns(START_NS, first, RATE)
            yield SampleBlock(name, first, time_ns, RATE, values[first : first + BLOCK])


def write_log(path: Path, seconds: float, names: Iterable[str], origins: Iterable[Origin]) -> Path:
    wanted = tuple(names)
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": SCENARIO})
        for origin in origins:
            for channel in CHANNELS:
                if channel.name in wanted:
                    log.declare(origin, channel)
            for block in blocks(wanted, seconds):
                log.add_block(origin, block, block.time_ns)
    return path
