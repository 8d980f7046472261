"""An encoder against the card's mark of crank angle zero: is it late, and how is it mounted?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.angle.skew import AtMark, RecordingSkew, angles_at_marks
from daq.block import NS_PER_S, Flag, SampleBlock
from daq.errors import LogError
from daq.log.reader import LogReader
from rig.rigs import shows_marks
from rig.session.encoder_record import ENCODER_CHANNEL, ENCODER_DEVICE
from rig.session.shaft_speed import shaft_reading
from rig.twin.chains import chain_of, stages_of

Array = NDArray[np.float64]

_FEWEST_PLACED = 10
"""Blocks, of a tenth of a second each, from which on their places make a pace."""
_MOST_PLACED = 400
"""The pace is found from all pairs of them."""
_COVERED_SIGMAS = 1.96
"""What a 95 % half width is of a standard deviation."""


@dataclass(frozen=True, slots=True)
class Pace:
    """When a recorded encoder took its positions: the one with index i at `first_s` + i `period_s`.

    Seconds since the first sample of the card's record.
    """

    first_s: float
    period_s: float

    def without(self, skew: RecordingSkew) -> Pace | None:
        """When the shaft stood where the positions say: the pace less the skew; None where that is open."""
        if skew.skew_s is None or skew.rate is None:
            return None
        late_s = skew.skew_s + skew.rate * (self.first_s - skew.at_s)
        return Pace(self.first_s - late_s, self.period_s * (1.0 - skew.rate))


def refuse_several_rigs(paths: Sequence[Path]) -> None:
    """Raise LogError for emulated rigs that were drawn apart: each has its encoder mounted another way."""
    seeds: dict[str, Path] = {}
    for path in paths:
        with LogReader(path) as log:
            seeds.setdefault(log.metadata.get("run", {}).get("emulation_seed", ""), path)
    if len(seeds) > 1:
        told = ", ".join(f"{path.name} (seed {seed or 'none'})" for seed, path in seeds.items())
        raise LogError(
            f"not of one rig: {told}; an emulated rig keeps its encoder only with one [emulation] seed"
        )


def logged_at_marks(path: Path) -> tuple[AtMark, Pace, float]:
    """What the encoder of a recorded run shows at the marks, and when it took its positions.

    The last is by how much (s) the card showed the marks later than they were, as the log says of the chain;
    it is taken out of their times. Raises LogError where the run lacks the encoder, or what shows the crank.
    """
    with LogReader(path) as log:
        channels = log.channels("measured")
        encoder = channels.pop(ENCODER_CHANNEL, None)
        if encoder is None:
            raise LogError(f"{path}: no {ENCODER_CHANNEL} in it")
        # An angle is only as good as its zero; the marker is the crank's own.
        shown = [channels[each] for each in channels if shows_marks(each)] or list(channels.values())
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
        pace = _pace(positions, start_ns)
        index = np.concatenate([block.first_sample + np.arange(len(block)) for block in positions])
        encoder_rad = np.concatenate([block.values.astype(np.float64) for block in positions])
        _, reading = shaft_reading([channels[name]], rate)
        if reading is None or encoder.scale is None:
            raise LogError(f"{path}: {ENCODER_CHANNEL} does not say what one count is")
        marks: list[float] = []
        for block in card:
            reading.take(block.first_sample - card[0].first_sample, block.values.astype(np.float64))
            marks.extend(reading.marks)
            reading.marks.clear()
        late_s = stages_of(log.metadata.get("run", {}), name).delay
        encoder_s, mark_s = pace.first_s + index * pace.period_s, np.array(marks) / rate - late_s
        # standard uncertainty of where the run places the encoder's clock, if it says anything of it
        said = [record.uncertainty_s for record in log.clocks() if record.device == ENCODER_DEVICE]
        placed_s = said[-1] / _COVERED_SIGMAS if said else 0.0
        return at_marks(encoder_s, encoder_rad, mark_s, encoder.scale, rate, placed_s), pace, late_s


def _zero_is_anywhere(log: LogReader, name: str) -> bool:
    """Whether the run says of an angle that nothing makes it absolute."""
    try:
        pulses = chain_of(log.metadata.get("run", {}), name).part("pulses")
    except LogError:
        return False
    return pulses.get("index") is False


def _pace(blocks: Sequence[SampleBlock], start_ns: int) -> Pace:
    """The encoder's own even pace; each block was placed by the clock models of its moment."""
    by_clock = [block for block in blocks if not block.flags & Flag.CLOCK_NOT_LOCKED]
    trusted = by_clock if len(by_clock) >= _FEWEST_PLACED else blocks
    some = [trusted[at] for at in np.unique(np.linspace(0, len(trusted) - 1, _MOST_PLACED).astype(int))]
    first = np.array([block.first_sample for block in some], np.float64)
    placed_s = np.array([(block.time_ns - start_ns) / NS_PER_S for block in some])
    if len(some) < _FEWEST_PLACED:
        period_s = 1.0 / blocks[0].sample_rate
        return Pace(float(placed_s[0] - first[0] * period_s), period_s)
    from scipy import stats  # only logs are looked at so, never a run that goes on

    line = stats.theilslopes(placed_s, first)
    return Pace(float(line.intercept), float(line.slope))


def at_marks(
    encoder_s: Array, encoder_rad: Array, mark_s: Array, count_rad: float, rate: float, placed_s: float = 0.0
) -> AtMark:
    """What an encoder shows where the card, which samples at `rate`, sees the mark.

    Times in s on the run's time base, `encoder_s` (n,) and `mark_s` (m,); `placed_s` is the standard
    uncertainty of where that places the encoder's clock.
    """
    # What is placed live may overlap a little where a model has moved back.
    known = encoder_s >= np.maximum.accumulate(encoder_s)
    mark_uncertainty_s = 1.0 / (rate * sqrt(12.0))
    return angles_at_marks(
        encoder_s[known], encoder_rad[known], mark_s, count_rad, mark_uncertainty_s, placed_s
    )
