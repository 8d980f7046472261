"""A log read once, with what every section of a report needs."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.log.reader import LogReader, Origin
from daq.log.records import Event, Gap

ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")
"""In the order in which they are drawn, the last on top."""
UPPER, LOWER = "contact.force_upper", "contact.force_lower"

_KEPT_SAMPLES = 64_000_000
"""All traces together (256 MB). A longer run is drawn from its beginning; its numbers are of all of it."""

_KEPT_CONTACT_SAMPLES = 25_000_000
"""Each contact force: eight minutes at 51.2 kHz, for the statistics of half cycles."""


@dataclass(slots=True)
class Tally:
    """Numbers of one trace, added up block by block; the sums are of finite samples."""

    samples: int = 0
    finite: int = 0
    square_sum: float = 0.0
    minimum: float = math.inf
    maximum: float = -math.inf
    end_sample: int = 0
    overloaded_blocks: int = 0
    sample_rate: float = 0.0

    def add(self, block: SampleBlock) -> None:
        """Count a block in."""
        values = block.values[np.isfinite(block.values)].astype(np.float64)
        self.samples += len(block)
        self.finite += len(values)
        self.square_sum += float(values @ values)
        self.minimum = float(values.min(initial=self.minimum))
        self.maximum = float(values.max(initial=self.maximum))
        self.end_sample = max(self.end_sample, block.end_sample)
        self.overloaded_blocks += bool(block.flags & Flag.OVERLOAD)
        self.sample_rate = block.sample_rate


@dataclass(frozen=True, slots=True)
class Trace:
    """One channel of one origin: samples from index 0 on, shape (n,), NaN where missing."""

    values: NDArray[np.float32]
    sample_rate: float

    def window(self, start_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Times in s since sample 0 and samples between two times, both of shape (m,)."""
        first = max(round(start_s * self.sample_rate), 0)
        values = self.values[first : max(round(end_s * self.sample_rate), first)]
        return (first + np.arange(len(values))) / self.sample_rate, values


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run as its log tells it."""

    path: Path
    complete: bool
    damage: str
    library: str
    scenario: str
    metadata: dict[str, dict[str, str]]
    channels: dict[str, Channel]
    traces: dict[tuple[Origin, str], Trace]
    tallies: dict[tuple[Origin, str], Tally]
    events: list[Event]
    gaps: list[Gap]

    @property
    def repaired(self) -> bool:
        """True where the prediction has effects and the nominal twin lies beside it."""
        return any(origin == "nominal" for origin, _ in self.traces)

    def whose(self, origin: Origin) -> str:
        """The origin as a report names it: beside a nominal twin, the prediction is the repaired one."""
        return "repaired" if self.repaired and origin == "predicted" else origin

    def contact_forces(self, origin: Origin) -> tuple[Trace, Trace] | None:
        """Upper and lower contact force, where the run has both."""
        upper, lower = self.traces.get((origin, UPPER)), self.traces.get((origin, LOWER))
        return None if upper is None or lower is None else (upper, lower)


@dataclass(slots=True)
class _Collector:
    """Blocks of the traces while a log is being read."""

    limits: dict[tuple[Origin, str], int]
    tallies: dict[tuple[Origin, str], Tally] = field(default_factory=lambda: defaultdict(Tally))
    blocks: dict[tuple[Origin, str], list[SampleBlock]] = field(default_factory=lambda: defaultdict(list))

    def add(self, origin: Origin, block: SampleBlock) -> None:
        key = origin, block.channel
        self.tallies[key].add(block)
        if block.end_sample <= self.limits[key]:
            self.blocks[key].append(block)

    def traces(self) -> dict[tuple[Origin, str], Trace]:
        return {key: _joined(blocks) for key, blocks in self.blocks.items()}


def read_run(log: Path) -> RunRecord:
    """Read a log in one pass; raises LogError if it is none or damaged in its middle."""
    with LogReader(log) as reader:
        declared = {origin: reader.channels(origin) for origin in ORIGINS}
        keys: list[tuple[Origin, str]] = [(origin, name) for origin in ORIGINS for name in declared[origin]]
        collector = _Collector({key: _limit(key[1], len(keys)) for key in keys})
        for origin, block in reader.blocks(ORIGINS):
            collector.add(origin, block)
        return RunRecord(
            path=log,
            complete=reader.complete,
            damage=reader.damage,
            library=reader.library,
            scenario=reader.scenario,
            metadata=reader.metadata,
            channels={**declared["measured"], **_missing_from(declared)},
            traces=collector.traces(),
            tallies=dict(collector.tallies),
            events=reader.events(),
            gaps=reader.gaps(),
        )


def _missing_from(declared: dict[Origin, dict[str, Channel]]) -> dict[str, Channel]:
    return {
        name: channel for name, channel in declared["predicted"].items() if name not in declared["measured"]
    }


def _limit(channel: str, traces: int) -> int:
    return _KEPT_CONTACT_SAMPLES if channel in (UPPER, LOWER) else _KEPT_SAMPLES // traces


def _joined(blocks: list[SampleBlock]) -> Trace:
    values = np.full(max(block.end_sample for block in blocks), np.nan, dtype=np.float32)
    for block in blocks:
        values[block.first_sample : block.end_sample] = block.values
    return Trace(values, blocks[0].sample_rate)
