"""A log read once, with what every section of a report needs."""

from __future__ import annotations

import functools
import math
import tomllib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.derived_names import CRANK_SPEED, derived_name
from daq.log.reader import LogReader, Origin
from daq.log.records import Event, Gap, Impact
from rig.files.quantity import QuantityError, si_value
from rig.report.roles import LOWER, UPPER, Roles, roles_of
from rig.stream import Block, Consumer, Record, Stream

ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")
"""In the order in which they are drawn, the last on top."""

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
        values = block.values.astype(np.float64)
        square_sum = float(values @ values)
        if not math.isfinite(square_sum):
            values = values[np.isfinite(values)]
            square_sum = float(values @ values)
        self.samples += len(block)
        self.finite += len(values)
        self.square_sum += square_sum
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
    """A run as its log tells it; `speeds` of the crank are in rpm, as they were derived."""

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
    impacts: list[Impact]
    speeds: dict[Origin, Trace]

    @property
    def facts(self) -> ScenarioFacts:
        """What its scenario says."""
        return scenario_facts(self.scenario)

    @property
    def roles(self) -> Roles:
        """What its channels are to the rig that its scenario names."""
        return roles_of(self.facts.rig, self.channels)

    @property
    def repaired(self) -> bool:
        """True where the prediction has effects and the nominal twin lies beside it."""
        return any(origin == "nominal" for origin, _ in self.traces)

    def whose(self, origin: Origin) -> str:
        """The origin as a report names it: beside a nominal twin, the prediction is the repaired one."""
        return "repaired" if self.repaired and origin == "predicted" else origin

    @property
    def kept_s(self) -> float | None:
        """How much of a long run, from its beginning, the traces hold; None where they hold all of it."""
        cut = [key for key, trace in self.traces.items() if len(trace.values) < self.tallies[key].end_sample]
        kept = (len(self.traces[key].values) / self.traces[key].sample_rate for key in cut)
        return min(kept, default=None)

    def contact_forces(self, origin: Origin) -> tuple[Trace, Trace] | None:
        """Upper and lower contact force, where the rig has such a pair of stops and the run both."""
        upper, lower = (self.traces.get((origin, stop)) for stop in self.roles.stops or ("", ""))
        return None if upper is None or lower is None else (upper, lower)


class RunCollector:
    """A run's record from a stream as it passes: a consumer of a replay, or of `read_run`.

    Blocks of a channel come in their order. Of what is derived a record has impacts and the crank's speed.
    """

    def __init__(self, reader: LogReader) -> None:
        self._reader = reader
        self._declared = {origin: reader.channels(origin) for origin in ORIGINS}
        keys: list[tuple[Origin, str]] = [
            (origin, name) for origin in ORIGINS for name in self._declared[origin]
        ]
        self._limits = {key: _limit(key[1], len(keys)) for key in keys}
        self._tallies: dict[tuple[Origin, str], Tally] = defaultdict(Tally)
        self._blocks: dict[tuple[Origin, str], list[SampleBlock]] = defaultdict(list)
        self._whose_speed = {derived_name(origin, CRANK_SPEED): origin for origin in ORIGINS}
        self._speeds: dict[Origin, list[SampleBlock]] = defaultdict(list)
        self._impacts: list[Impact] = []

    def __call__(self, record: Record) -> None:
        match record:
            case Block("derived", samples) if samples.channel in self._whose_speed:
                self._speeds[self._whose_speed[samples.channel]].append(samples)
            case Block(origin, samples) if (origin, samples.channel) in self._limits:
                key = origin, samples.channel
                self._tallies[key].add(samples)
                if samples.end_sample <= self._limits[key]:
                    self._blocks[key].append(samples)
            case Impact():
                self._impacts.append(record)

    def record(self) -> RunRecord:
        """The run, from the blocks so far; raises LogError."""
        reader = self._reader
        return RunRecord(
            path=reader.path,
            complete=reader.complete,
            damage=reader.damage,
            library=reader.library,
            scenario=reader.scenario,
            metadata=reader.metadata,
            channels={**self._declared["measured"], **_missing_from(self._declared)},
            traces={key: _joined(blocks) for key, blocks in self._blocks.items()},
            tallies=dict(self._tallies),
            events=reader.events(),
            gaps=reader.gaps(),
            impacts=list(self._impacts),
            speeds={origin: _joined(blocks) for origin, blocks in self._speeds.items()},
        )


def read_run(log: Path, consumers: Sequence[Consumer] = ()) -> RunRecord:
    """Read a log in one pass, of which `consumers` get every block and impact too.

    Raises LogError if it is none or damaged in its middle.
    """
    with LogReader(log) as reader:
        collector = RunCollector(reader)
        stream = Stream([collector, *consumers])
        for origin, block in reader.blocks((*ORIGINS, "derived")):
            stream(Block(origin, block))
        for impact in reader.impacts():
            stream(impact)
        return collector.record()


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


@dataclass(frozen=True, slots=True)
class ScenarioFacts:
    """Name, rig and drive in the operator's words; `cycle_s` is one cycle of the drive, None if unknown."""

    name: str = ""
    rig: str = ""
    drive: str = ""
    cycle_s: float | None = None


@functools.lru_cache(maxsize=8)
def scenario_facts(toml: str) -> ScenarioFacts:
    """Read them from a scenario's TOML text, which another program may have written."""
    try:
        scenario = tomllib.loads(toml)
    except tomllib.TOMLDecodeError:
        return ScenarioFacts()
    drive = scenario.get("drive", {})
    drive = drive if isinstance(drive, dict) else {}
    hertz = _quantity(drive.get("frequency"), "Hz") or _quantity(drive.get("speed"), "rad/s") / math.tau
    return ScenarioFacts(
        name=str(scenario.get("name", "")),
        rig=str(scenario.get("rig", "")),
        drive=", ".join(f"{key} {value}" for key, value in drive.items()),
        cycle_s=1.0 / hertz if hertz > 0 and math.isfinite(1.0 / hertz) else None,
    )


def _quantity(value: object, unit: str) -> float:
    if isinstance(value, (int, float)):
        return float(value)
    try:
        return si_value(str(value), unit)
    except QuantityError:
        return 0.0
