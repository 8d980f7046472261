"""A run that has everything a log can hold: three rates, gaps, flags, wide samples, NaN, a prediction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from daq.block import NS_PER_S, Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.formats.contents import Column, Contents
from daq.formats.recording import Recording, Track, read_log
from daq.formats.samples import Samples, Scratch
from daq.log.reader import LogReader, Origin
from daq.log.records import ClockRecord, Event, Impact
from daq.log.writer import LogWriter

START_NS = 1_790_000_000 * NS_PER_S + 123_456_789
FORCE = Channel(
    "contact.force_upper", "N", "force", "contact", "piezo, 9301B", "SN 1234", 41.666666666666664, "V"
)
YOKE = Channel("yoke.force", "N")
BASE = Channel("base.acceleration", "m/s2", "acceleration", "base")
ANGLE = Channel("crank.angle", "rad", "angle", "crank")
UNUSED = Channel("drive.force", "N")
FAST, SLOW, ODD = 51_200.0, 1000.0, 25_599.987_654_321
RUN = {"id": "run-7", "started": "2026-09-21T14:13:20Z"}
SCENARIO = 'name = "früh"\nrig = "impact_beam"\n'
EVENT = Event(START_NS + 5, "warning", "rig", "limit.warning", 'früh, "dort"\n# und so')
CLOCK = ClockRecord(START_NS, "card", 1e-3, -12.5, float("nan"))

IMPACTS = [
    Impact(START_NS + 7, "measured", FORCE.name, 40, 99, 61, 40.1, 39.9, 0.1 + 0.2, 1e-3, 1, 12.75),
    Impact(
        START_NS + 9,
        "predicted",
        FORCE.name,
        2**40,
        2**40 + 9,
        2**40 + 3,
        1e-7,
        1e-7,
        1e-300,
        0.0,
        0,
        math.nan,
    ),
]


def write_run(path: Path, metadata: Mapping[str, dict[str, str]] = MappingProxyType({})) -> Path:
    """The log, by the project's own writer, with more `metadata`."""
    with LogWriter(path) as log:
        for name, record in metadata.items():
            log.add_metadata(name, record)
        log.add_metadata("scenario", {"toml": SCENARIO})
        log.add_metadata("run", RUN)
        log.add_event(EVENT)
        log.add_clock(CLOCK)
        for impact in IMPACTS:
            log.add_impact(impact, impact.time_ns)
        for origin, channel, blocks in traces():
            log.declare(origin, channel)
            for block in blocks:
                log.add_block(origin, block, block.time_ns)
    return path


def traces() -> Iterator[tuple[Origin, Channel, list[SampleBlock]]]:
    rng = np.random.default_rng(7)
    force = rng.normal(size=51_200).astype(np.float32)
    force[[0, 1, 7000]] = np.array([np.nan, np.inf, -0.0], np.float32)
    blocks = cut(FORCE, force, FAST)
    blocks[3] = flagged(blocks[3], Flag.OVERLOAD)
    yield "measured", FORCE, [*blocks[:4], flagged(blocks[5], Flag.SAMPLES_MISSING_BEFORE), *blocks[6:]]
    yield "measured", BASE, cut(BASE, rng.normal(size=1000).astype(np.float32), SLOW)
    angle = 2e5 + np.cumsum(rng.uniform(size=25_600))
    yield "measured", ANGLE, cut(ANGLE, angle, ODD, first=300)
    yield "measured", UNUSED, []
    yield "predicted", FORCE, cut(FORCE, rng.normal(size=51_200).astype(np.float32), FAST)
    yield "nominal", YOKE, cut(YOKE, rng.normal(size=25_600).astype(np.float32), FAST, first=25_600)


def cut(channel: Channel, values: np.ndarray, rate: float, first: int = 0) -> list[SampleBlock]:
    """Blocks of 0.1 s."""
    most = round(0.1 * rate)
    return [
        SampleBlock(
            channel.name, first + at, sample_time_ns(START_NS, first + at, rate), rate, values[at : at + most]
        )
        for at in range(0, len(values), most)
    ]


def flagged(block: SampleBlock, flags: Flag) -> SampleBlock:
    return SampleBlock(
        block.channel, block.first_sample, block.time_ns, block.sample_rate, block.values, flags
    )


def recorded(path: Path, scratch: Scratch) -> Recording:
    with LogReader(path) as log:
        return read_log(log, scratch)


def everything(samples: Samples) -> np.ndarray:
    return samples.read(0, len(samples))


def by_name(contents: Contents) -> dict[str, Column]:
    return {f"{column.origin}/{column.name}": column for column in contents.columns}


def real_bytes(samples: Samples, track: Track) -> bytes:
    """The bytes of all samples that are there; what stands in a gap is nobody's business."""
    values, start = everything(samples), track.first_sample
    return b"".join(
        values[each.first_sample - start : each.end_sample - start].tobytes() for each in track.stretches
    )
