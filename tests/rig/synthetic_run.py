"""A run made of sines and half-sine pulses: enough for views and reports, and every number of it is known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.reader import Origin
from daq.log.records import Event
from daq.log.writer import LogWriter

RATE = 51_200.0
BLOCK = 5120
START_NS = 1_790_000_000_000_000_000
DRIVE_HZ = 20.0
PEAK_N: dict[Origin, float] = {"measured": 40.0, "nominal": 20.0, "predicted": 36.0}
CONTACT_S = 1e-3

CHANNELS = (
    Channel("drive.force", "N"),
    Channel("contact.force_upper", "N"),
    Channel("contact.force_lower", "N"),
    Channel("yoke.force", "N"),
    Channel("base.acceleration", "m/s2"),
)

SCENARIO = """
name = "synthetic beam"
rig = "impact_beam"

[drive]
frequency = "20 Hz"
amplitude = "9 N"
"""


def samples(channel: str, origin: Origin, seconds: float) -> NDArray[np.float32]:
    """Two contacts in each half cycle of the drive, the second half as strong; noise elsewhere."""
    times = np.arange(round(seconds * RATE)) / RATE
    seed = sum(f"{origin}{channel}".encode())
    noise = np.random.default_rng(seed).normal(scale=0.02, size=len(times))
    size = PEAK_N[origin]
    match channel:
        case "drive.force":
            values = 0.2 * size * np.sin(2 * np.pi * DRIVE_HZ * times)
        case "contact.force_upper":
            values = _pulses(times, 0.005, size)
        case "contact.force_lower":
            values = _pulses(times, 0.030, size)
        case "yoke.force":
            values = _pulses(times, 0.005, size) - _pulses(times, 0.030, size)
        case _:
            values = np.zeros_like(times)
    return (values + noise).astype(np.float32)


def _pulses(times: NDArray[np.float64], after_s: float, peak_n: float) -> NDArray[np.float64]:
    phase = times % (1 / DRIVE_HZ)
    first, second = (phase - after_s) / CONTACT_S, (phase - after_s - 0.003) / CONTACT_S
    each = (
        strength * np.where((x > 0) & (x < 1), np.sin(np.pi * np.clip(x, 0, 1)), 0.0)
        for x, strength in ((first, 1.0), (second, 0.5))
    )
    return peak_n * sum(each, np.zeros_like(times))


def blocks(channels: Iterable[Channel], origin: Origin, seconds: float) -> Iterator[SampleBlock]:
    """Blocks of 0.1 s of all channels, in the order in which a card would deliver them."""
    traces = {channel.name: samples(channel.name, origin, seconds) for channel in channels}
    for first in range(0, round(seconds * RATE), BLOCK):
        for name, values in traces.items():
            time_ns = sample_time_ns(START_NS, first, RATE)
            yield SampleBlock(name, first, time_ns, RATE, values[first : first + BLOCK])


def write_log(
    path: Path,
    seconds: float = 1.0,
    channels: Iterable[Channel] = CHANNELS,
    origins: Iterable[Origin] = ("measured", "predicted"),
    scenario: str = SCENARIO,
    bench: Mapping[str, str] = MappingProxyType({}),
    metadata: Mapping[str, dict[str, str]] = MappingProxyType({}),
) -> Path:
    """Write the run as a log, with what `bench` adds to its record `run`, and more records."""
    with LogWriter(path) as log:
        for origin in origins:
            for channel in channels:
                log.declare(origin, channel)
        log.add_metadata("scenario", {"toml": scenario})
        log.add_metadata("run", {"id": "run-7", "started": "2026-09-21T14:13:20Z", **bench})
        for name, record in metadata.items():
            log.add_metadata(name, record)
        log.add_event(Event(START_NS, "info", "sequencer", "recording", "recording started"))
        for origin in origins:
            for block in blocks(channels, origin, seconds):
                log.add_block(origin, block, block.time_ns)
    return path


def damaged(block: SampleBlock) -> SampleBlock:
    """Return the block with an overload and some samples that are no numbers."""
    values = block.values.copy()
    values[100:200] = np.nan
    return SampleBlock(
        block.channel,
        block.first_sample,
        block.time_ns,
        block.sample_rate,
        values,
        Flag.OVERLOAD | Flag.NOT_FINITE,
    )
