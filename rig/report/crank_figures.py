"""What a turning shaft shows over a whole run: its turns at every sample, its speed, orders and impacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import nan, pi

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.log.reader import SURROGATE, Origin
from rig.derived.order_lines import OrderLines
from rig.derived.settings import RECORD, Settings, from_record
from rig.derived.turns import Turns, turns_from
from rig.pages.content import Sentence
from rig.report.record import ORIGINS, RunRecord, Trace
from rig.report.summary import mean_and_deviation

_PIECE_S = 1.0
"""Turns are followed as in a run, which keeps but the last seconds of them."""


def counted_by(run: RunRecord, origin: Origin) -> str | None:
    """The channel that tells the shaft's angle; None where none does."""
    follower = _follower(run, origin)
    return follower.channel if follower else None


def turns_of(run: RunRecord, origin: Origin) -> NDArray[np.float64] | None:
    """Turns at every sample of an origin, shape (n,), NaN where unknown; None where nothing tells them."""
    follower = _follower(run, origin)
    if follower is None:
        return None
    channel = follower.channel
    trace = run.traces[_turning(run, origin), channel]
    turns = np.full(len(trace.values), np.nan)
    for first, end in _pieces(len(trace.values), trace.sample_rate):
        known = follower.known_until
        follower.add(SampleBlock(channel, first, 0, trace.sample_rate, trace.values[first:end]))
        if follower.known_until > known:
            turns[known : follower.known_until] = follower.at(np.arange(known, follower.known_until))
    return turns


def turned_backwards(run: RunRecord, origin: Origin) -> bool:
    """Whether the shaft's angle fell, by half a turn in all at least; marks cannot tell."""
    trace = run.traces.get((origin, run.roles.angle))
    if trace is None:
        return False
    steps = np.diff(trace.values.astype(np.float64))
    return float(steps[np.abs(steps) < pi].sum()) < -pi  # farther from sample to sample it leapt


def beside_turns(run: RunRecord, origin: Origin, channels: Sequence[str]) -> dict[str, Trace]:
    """Those of `channels` that were sampled at the rate of the shaft's turns: only these have an angle."""
    told_by = counted_by(run, origin)
    if told_by is None:
        return {}
    rate = run.traces[_turning(run, origin), told_by].sample_rate
    found = {name: run.written(origin, name) for name in channels if (origin, name) in run.traces}
    return {name: trace for name, trace in found.items() if trace.sample_rate == rate}


def order_lines(run: RunRecord, origin: Origin, channels: Sequence[str]) -> OrderLines | None:
    """Orders of `channels`, all beside the turns, over a whole run; None where nothing tells the turns."""
    turns = turns_of(run, origin)
    if turns is None or not channels:
        return None
    lines = OrderLines(averaged=None)
    for values, way in in_pieces([run.written(origin, name) for name in channels], turns):
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


def _turning(run: RunRecord, origin: Origin) -> Origin:
    """Whose angle is an origin's: a surrogate predicts over the measured one."""
    return "measured" if any(whose == origin == SURROGATE for whose, _ in run.traces) else origin


def _follower(run: RunRecord, origin: Origin) -> Turns | None:
    origin = _turning(run, origin)
    names = tuple(name for whose, name in run.traces if whose == origin)
    return turns_from(names, run.roles.angle, run.roles.marker, run.mounting.mark_rad)


def _pieces(count: int, sample_rate: float) -> Iterator[tuple[int, int]]:
    """First and end sample of each stretch of `count` samples."""
    length = max(round(_PIECE_S * sample_rate), 1)
    for first in range(0, count, length):
        yield first, min(first + length, count)


@dataclass(frozen=True, slots=True)
class SpeedFigures:
    """In rpm, below zero where the shaft turns backwards; `ripple` is the standard deviation.

    `revolutions` is how many were turned at a known speed, in all, whichever way round.
    """

    mean: float
    ripple: float
    lowest: float
    highest: float
    revolutions: float


def speeds(run: RunRecord) -> dict[str, Trace]:
    """Speeds in rpm by whose they are, of which at least one value is known."""
    return {
        run.whose(origin): run.speeds[origin]
        for origin in ORIGINS
        if origin in run.speeds and np.isfinite(run.speeds[origin].values).any()
    }


def speed_figures(speed: Trace) -> SpeedFigures:
    """Figures of a speed of which at least one value is known."""
    known = speed.values[np.isfinite(speed.values)].astype(np.float64)
    mean, ripple = mean_and_deviation(known)
    return SpeedFigures(
        mean=mean,
        ripple=ripple,
        lowest=float(known.min()),
        highest=float(known.max()),
        revolutions=abs(mean) / 60 * len(known) / speed.sample_rate,
    )


def set_rpm(run: RunRecord) -> float | None:
    """The speed that the scenario asks for; None where it says none."""
    cycle_s = run.facts.cycle_s
    return None if cycle_s is None else 60 / cycle_s


@dataclass(frozen=True, slots=True)
class GroupImpacts:
    """Impacts on one group of channels: shaft angles in degrees where they begin, peaks in `unit`, channels.

    All of shape (n,). An angle is NaN where nothing told it. `revolutions` are those of the run, NaN where
    they are not known. `counts_from` is the rise from which an impact counts, in `unit`, on the channel where
    it is least and on the one where it is largest; NaN where the log does not tell.
    """

    unit: str
    angle_deg: NDArray[np.float64]
    peak: NDArray[np.float64]
    channels: tuple[str, ...]
    revolutions: float
    counts_from: tuple[float, float]

    @property
    def a_revolution(self) -> float:
        return len(self.peak) / self.revolutions if self.revolutions > 0 else nan

    @property
    def spread(self) -> tuple[float, float]:
        """Mean and standard deviation of the peaks, NaN without an impact or a second."""
        return mean_and_deviation(self.peak)


def impacts_by_group(run: RunRecord) -> dict[str, dict[str, GroupImpacts]]:
    """Impacts by group and by whose they are; only of groups and origins whose channels the run has."""
    settings = from_record(run.metadata.get(RECORD, {}))
    turned = {whose: speed_figures(speed).revolutions for whose, speed in speeds(run).items()}
    return {
        group: {
            run.whose(origin): _of_group(
                run, origin, names, settings.get(origin), turned.get(run.whose(origin), nan)
            )
            for origin in ORIGINS
            if any((origin, name) in run.traces for name in names)
        }
        for group, names in run.roles.impacts.items()
    }


def _of_group(
    run: RunRecord, origin: Origin, names: tuple[str, ...], settled: Settings | None, revolutions: float
) -> GroupImpacts:
    chosen = [each for each in run.impacts if each.origin == origin and each.channel in names]
    turns = np.array([each.turns for each in chosen], dtype=np.float64)
    levels = {} if settled is None else settled.levels
    known = [levels[name].counts_from_n for name in names if name in levels]
    return GroupImpacts(
        unit=run.channels[names[0]].unit,
        angle_deg=360.0 * (turns % 1.0),
        peak=np.array([each.peak for each in chosen], dtype=np.float64),
        channels=tuple(each.channel for each in chosen),
        revolutions=revolutions,
        counts_from=(min(known, default=nan), max(known, default=nan)),
    )


def cut(run: RunRecord) -> list[Sentence]:
    """One sentence where a section draws but the beginning of a run, else none."""
    kept_s = run.kept_s
    return [] if kept_s is None else [Sentence(f"This is of the first {kept_s:.0f} s of the run only.")]


def left_out(run: RunRecord, channels: Sequence[str]) -> list[Sentence]:
    """Sentences where some of `channels` have a sampling rate of their own or a shaft turned backwards."""
    turning = [origin for origin in ORIGINS if counted_by(run, origin)]
    beside = {(origin, name) for origin in turning for name in beside_turns(run, origin, channels)}
    missing = [
        f"{name} ({run.whose(origin)})"
        for origin in turning
        for name in channels
        if (origin, name) in run.traces and (origin, name) not in beside
    ]
    backwards = [run.whose(origin) for origin in ORIGINS if turned_backwards(run, origin)]
    told = []
    if missing:
        rate = "Left out, sampled at another rate than what tells the angle"
        told.append(Sentence(f"{rate}: {', '.join(missing)}."))
    if backwards:
        text = "an angle that falls counts no revolutions, neither for orders nor for the mean revolution."
        told.append(Sentence(f"The crank turned backwards ({', '.join(backwards)}): {text}"))
    return told
