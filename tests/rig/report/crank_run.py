"""A recorded slider-crank, of which every number is known, with what is derived from it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from daq.block import SampleBlock
from daq.channel import Channel
from daq.log.reader import Origin
from daq.log.records import Impact
from daq.log.writer import LogWriter
from rig.derived.derivation import Derivation, derived_channels
from rig.files.scenario import parse_scenario
from rig.stream import Block, Consumer, Metadata, Record
from tests.rig.derived.turning import (
    CHANNELS,
    SPATIAL_CHANNELS,
    START_NS,
    blocks,
    encoder_rad,
    turns,
)

RIGS = {"planar_slider_crank": CHANNELS, "spatial_slider_crank": SPATIAL_CHANNELS}


def scenario(rig: str) -> str:
    acquisition = 'sample_rate = "25.6 kHz"\nduration = "6 s"'
    return f'name = "a crank"\nrig = "{rig}"\n[drive]\nspeed = "200 rpm"\n[acquisition]\n{acquisition}\n'


ENCODER = Channel("encoder.angle", "rad")
SLOW_RATE = 1000.0
"""Of what is measured beside the card."""


def logging(log: LogWriter) -> Consumer:
    """Writes what is derived."""

    def write(record: Record) -> None:
        match record:
            case Block(origin, samples):
                log.add_block(origin, samples, samples.time_ns)
            case Impact():
                log.add_impact(record, record.time_ns)
            case Metadata(name, values):
                log.add_metadata(name, values)

    return write


def write_log(
    path: Path,
    rig: str = "planar_slider_crank",
    seconds: float = 6.0,
    channels: Sequence[Channel] | None = None,
    origins: Sequence[Origin] = ("measured", "predicted"),
    derive: bool = True,
    beside: Sequence[Channel] = (),
) -> Path:
    """Write the run as a log; what is predicted turns 0.3 % faster and strikes 0.4 times as hard.

    The channels `beside` the card are measured only, as an encoder's angle at a rate of their own.
    """
    channels = RIGS[rig] if channels is None else channels
    text = scenario(rig)
    by_origin = dict.fromkeys(origins, channels)
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": text})
        for origin in origins:
            for channel in channels:
                log.declare(origin, channel)
        for channel in beside:
            log.declare("measured", channel)
            angle = encoder_rad(turns(seconds, rate=SLOW_RATE))
            log.add_block("measured", SampleBlock(channel.name, 0, START_NS, SLOW_RATE, angle), START_NS)
        wanted = parse_scenario(text, "test")
        for channel in derived_channels(by_origin, wanted) if derive else ():
            log.declare("derived", channel)
        names = {origin: [channel.name for channel in channels] for origin in origins}
        derivation = Derivation(logging(log), names, wanted)
        for origin in origins:
            for block in blocks(channels, origin, seconds):
                kept = SampleBlock(
                    block.channel,
                    block.first_sample,
                    block.time_ns,
                    block.sample_rate,
                    block.values.astype(np.float32),
                )
                log.add_block(origin, kept, kept.time_ns)
                if derive:
                    derivation(Block(origin, kept))
        if derive:
            derivation.finish()
    return path
