"""Measured logs that a twin wrote: healthy or not, whole or damaged."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.writer import LogWriter
from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.diagnosis.subject import Named

Array = NDArray[np.float64]
Damage = Callable[[SampleBlock], SampleBlock | None]
RATE = 25_600.0
START_NS = 1_790_000_000_000_000_000
BLOCK_S = 0.1
BLOCK = round(BLOCK_S * RATE)
_SETTLE_S = 0.5

BEAM = """
name = "beam, 20 Hz"
rig = "impact_beam"

[drive]
frequency = "20 Hz"
amplitude = "9 N"

[acquisition]
sample_rate = "25.6 kHz"
settle = "0.5 s"
duration = "1.5 s"
"""
CRANK = """
name = "crank, 200 rpm"
rig = "planar_slider_crank"

[drive]
speed = "200 rpm"

[acquisition]
sample_rate = "25.6 kHz"
settle = "0.5 s"
duration = "4 s"
"""


def recording(
    scenario: str, effects: Sequence[Named] = (), seed: int = 1
) -> tuple[tuple[Channel, ...], Array]:
    """Channels of a healthy rig with effects in, and what its instruments show, (channels, n)."""
    parsed = parse_scenario(scenario)
    nominal = twin_of(parsed)
    model, rng = nominal.model, np.random.default_rng(seed)
    twin = model.draw_healthy(model.with_effects(nominal, effects), rng, rng)
    stream = model.stream(twin, RATE, rng)
    stream.drive(twin.drive, float(rng.uniform(0, 2 * np.pi)))
    stream.advance(round(_SETTLE_S * RATE))
    return predicted_channels(twin), stream.advance(round(parsed.acquisition.duration * RATE))


def write(
    path: Path,
    recorded: tuple[tuple[Channel, ...], Array],
    scenario: str | None,
    without: Collection[str] = (),
    damage: Damage = lambda block: block,
    rate: float = RATE,
    record: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Write a recording as a measured log, with a `run` record.

    `damage` changes its blocks of 0.1 s, or drops them (None).
    """
    channels, samples = recorded
    kept = [(c, row) for c, row in zip(channels, samples, strict=True) if c.name not in without]
    with LogWriter(path) as log:
        if scenario is not None:
            log.add_metadata("scenario", {"toml": scenario})
        if record:
            log.add_metadata("run", dict(record))
        for channel, _ in kept:
            log.declare("measured", channel)
        for first in range(0, samples.shape[1], round(BLOCK_S * rate)):
            for channel, row in kept:
                block = damage(_block(channel.name, first, row, rate))
                if block is not None:
                    log.add_block("measured", block, block.time_ns)
    return path


def _block(name: str, first: int, row: Array, rate: float) -> SampleBlock:
    values = row[first : first + round(BLOCK_S * rate)]
    # an unwrapped angle is too long for float32
    kept = values if name == "crank.angle" else values.astype(np.float32)
    return SampleBlock(name, first, sample_time_ns(START_NS, first, rate), rate, kept)


def flagged(block: SampleBlock, flags: Flag, values: NDArray[np.floating] | None = None) -> SampleBlock:
    """The block with flags and perhaps other values."""
    new = block.values if values is None else values
    return SampleBlock(block.channel, block.first_sample, block.time_ns, block.sample_rate, new, flags)
