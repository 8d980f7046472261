"""A crank's turns at every sample of a run that has been read, and what is found by them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.log.reader import Origin
from rig.derived.order_lines import OrderLines
from rig.derived.turns import Turns, turns_from
from rig.report.record import RunRecord, Trace

_PIECE_S = 1.0
"""Turns are followed as in a run, which keeps but the last seconds of them."""


def counted_by(run: RunRecord, origin: Origin) -> str | None:
    """The channel that tells the crank's angle; None where none does."""
    follower = _follower(run, origin)
    return follower.channel if follower else None


def turns_of(run: RunRecord, origin: Origin) -> NDArray[np.float64] | None:
    """Turns at every sample of an origin, shape (n,), NaN where unknown; None where nothing tells them."""
    follower = _follower(run, origin)
    if follower is None:
        return None
    channel = follower.channel
    trace = run.traces[origin, channel]
    turns = np.full(len(trace.values), np.nan)
    for first, end in _pieces(len(trace.values), trace.sample_rate):
        known = follower.known_until
        follower.add(SampleBlock(channel, first, 0, trace.sample_rate, trace.values[first:end]))
        if follower.known_until > known:
            turns[known : follower.known_until] = follower.at(np.arange(known, follower.known_until))
    return turns


def turned_backwards(run: RunRecord, origin: Origin) -> bool:
    """Whether the crank's angle fell, by half a turn in all at least; marks cannot tell."""
    trace = run.traces.get((origin, run.crank.angle)) if run.crank else None
    if trace is None:
        return False
    steps = np.diff(trace.values.astype(np.float64))
    return float(steps[np.abs(steps) < pi].sum()) < -pi  # farther from sample to sample it leapt


def beside_turns(run: RunRecord, origin: Origin, channels: Sequence[str]) -> dict[str, Trace]:
    """Those of `channels` that were sampled at the rate of the crank's turns: only these have an angle."""
    told_by = counted_by(run, origin)
    if told_by is None:
        return {}
    rate = run.traces[origin, told_by].sample_rate
    found = {name: run.traces[origin, name] for name in channels if (origin, name) in run.traces}
    return {name: trace for name, trace in found.items() if trace.sample_rate == rate}


def order_lines(run: RunRecord, origin: Origin, channels: Sequence[str]) -> OrderLines | None:
    """Orders of `channels`, all beside the turns, over a whole run; None where nothing tells the turns."""
    turns = turns_of(run, origin)
    if turns is None or not channels:
        return None
    lines = OrderLines(averaged=None)
    for values, way in in_pieces([run.traces[origin, name] for name in channels], turns):
        lines.add(values, way)
    return lines


def in_pieces(
    traces: Sequence[Trace], turns: NDArray[np.float64]
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Samples of c traces, shape (c, n), with their turns, shape (n,), a stretch after the other.

    All have one sampling rate, the turns' own.
    """
    count = min(len(turns), *(len(trace.values) for trace in traces))
    for first, end in _pieces(count, traces[0].sample_rate):
        yield np.array([trace.values[first:end] for trace in traces]), turns[first:end]


def _follower(run: RunRecord, origin: Origin) -> Turns | None:
    names = tuple(name for whose, name in run.traces if whose == origin)
    return turns_from(names, run.crank.angle, run.crank.marker) if run.crank else None


def _pieces(count: int, sample_rate: float) -> Iterator[tuple[int, int]]:
    """First and end sample of each stretch of `count` samples."""
    length = max(round(_PIECE_S * sample_rate), 1)
    for first in range(0, count, length):
        yield first, min(first + length, count)
