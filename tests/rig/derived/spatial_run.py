"""What the sensors of a healthy spatial slider-crank show, simulated once."""

from __future__ import annotations

from functools import cache

import numpy as np

from daq.block import SampleBlock
from tests.rig.diagnosis.measured_log import BLOCK, RATE, START_NS, recording

SOCKET, GUIDE = "socket.force", "slider.force_7"
SPATIAL = """
name = "spatial crank, 230 rpm"
rig = "spatial_slider_crank"

[drive]
speed = "230 rpm"

[acquisition]
sample_rate = "25.6 kHz"
settle = "0.5 s"
duration = "2.6 s"
"""


TEN_REVOLUTIONS_S = 2.6


@cache
def spatial_blocks(tens: int = 1) -> list[dict[str, SampleBlock]]:
    """Blocks of 0.1 s by channel; so many times ten revolutions."""
    channels, samples = recording(SPATIAL.replace("2.6 s", f"{tens * TEN_REVOLUTIONS_S:g} s"))
    values = samples.astype(np.float32)
    return [
        {
            channel.name: SampleBlock(channel.name, first, START_NS, RATE, row[first : first + BLOCK])
            for channel, row in zip(channels, values, strict=True)
        }
        for first in range(0, values.shape[1], BLOCK)
    ]
