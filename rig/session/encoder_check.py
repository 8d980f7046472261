"""An encoder against the card's mark of crank angle zero: is it late, and how is it mounted?"""

from __future__ import annotations

import json
from math import sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.angle import AtMark, Skew, angles_at_marks, find_skew
from daq.block import NS_PER_S, SampleBlock
from daq.errors import LogError
from daq.log import LogReader
from rig.session.encoder_record import ENCODER_CHANNEL
from rig.session.shaft_speed import shaft_reading, shows_marks

Array = NDArray[np.float64]


def encoder_at_marks(
    encoder_s: Array, encoder_rad: Array, mark_s: Array, count_rad: float, sample_rate: float
) -> Skew | None:
    """What an encoder shows where the card sees the mark, in one run; None where both never met.

    Times in s on the run's time base, `encoder_s` (n,) and `mark_s` (m,); the card samples at `sample_rate`.
    """
    return find_skew([_at_marks(encoder_s, encoder_rad, mark_s, count_rad, sample_rate)])


def logged_at_marks(path: Path) -> AtMark:
    """The same of a recorded run; raises LogError where it lacks the encoder, or what shows the crank."""
    with LogReader(path) as log:
        channels = log.channels("measured")
        encoder = channels.pop(ENCODER_CHANNEL, None)
        if encoder is None:
            raise LogError(f"{path}: no {ENCODER_CHANNEL} in it")
        # An angle is only as good as its zero; the marker is the crank's own.
        shown = [each for each in channels.values() if shows_marks(each)] or list(channels.values())
        name, _ = shaft_reading(shown, 1.0)
        if name is None:
            raise LogError(f"{path}: no angle or marker of the crank in it")
        if _zero_is_anywhere(log, name):
            what = "its counter has no index mark, so that its zero is another one in every run"
            raise LogError(f"{path}: {name} cannot tell where the encoder stands: {what}")
        card = [block for _, block in log.blocks("measured", [name])]
        positions = [block for _, block in log.blocks("measured", [ENCODER_CHANNEL])]
        if not card or not positions:
            raise LogError(f"{path}: {name} or {ENCODER_CHANNEL} has no samples")
        start_ns, rate = card[0].time_ns, card[0].sample_rate
        encoder_s = np.concatenate([_times_s(block, start_ns) for block in positions])
        encoder_rad = np.concatenate([block.values.astype(np.float64) for block in positions])
        _, reading = shaft_reading([channels[name]], rate)
        if reading is None or encoder.scale is None:
            raise LogError(f"{path}: {ENCODER_CHANNEL} does not say what one count is")
        for block in card:
            reading.take(block.first_sample - card[0].first_sample, block.values.astype(np.float64))
        return _at_marks(encoder_s, encoder_rad, np.array(reading.marks) / rate, encoder.scale, rate)


def _zero_is_anywhere(log: LogReader, name: str) -> bool:
    """Whether the run says of an angle that nothing makes it absolute."""
    try:
        chain = json.loads(log.metadata.get("run", {}).get(f"chain.{name}", "{}"))
    except ValueError:
        return False
    pulses = chain.get("pulses") if isinstance(chain, dict) else None
    return isinstance(pulses, dict) and pulses.get("index") is False


def _times_s(block: SampleBlock, start_ns: int) -> Array:
    return (block.time_ns - start_ns) / NS_PER_S + np.arange(len(block)) / block.sample_rate


def _at_marks(encoder_s: Array, encoder_rad: Array, mark_s: Array, count_rad: float, rate: float) -> AtMark:
    # Blocks are placed by the clock models of their moment; where these moved back, times overlap a little.
    known = encoder_s >= np.maximum.accumulate(encoder_s)
    return angles_at_marks(encoder_s[known], encoder_rad[known], mark_s, count_rad, 1.0 / (rate * sqrt(12.0)))
