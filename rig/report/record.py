"""A log read once, with what every section of a report needs."""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag, SampleBlock, sample_time_ns, values_of
from daq.channel import Channel
from daq.errors import ConfigurationError, RattleError
from daq.log.reader import CRANK_SPEED, SURROGATE, LogReader, Origin, derived_name
from daq.log.records import Event, Gap, Impact
from rig.derived.derivation import derivation_of
from rig.derived.settings import role_of, says_impacts
from rig.files.faults import read_toml
from rig.files.quantity import QuantityError, si_value
from rig.files.scenario import parse_scenario
from rig.pages.words import as_written
from rig.rigs import RIGS
from rig.stream import Block, Consumer, Metadata, Record, Stream
from rig.twin.alignment import AS_USUAL, Mounting
from rig.twin.chains import mounting_of
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.channel_table import Role
from sim_twin.sensors import SensorChain


@dataclass(frozen=True, slots=True)
class Roles:
    """Names of channels by what they are.

    `angle` is where an encoder tells a shaft's angle, else `marker` does; "" without a shaft. `vibration`
    shows how the rig vibrates rather than how it moves. `unwrapped` are angles that grow as long as a run
    lasts. `stops` are the forces on either side of a play, `impacts` groups of channels whose impacts are
    told together.
    """

    angle: str
    marker: str
    vibration: tuple[str, ...]
    unwrapped: frozenset[str]
    stops: tuple[str, str] | None
    impacts: Mapping[str, tuple[str, ...]]

    @property
    def turns(self) -> bool:
        """Whether a shaft does, so that things are shown over its angle."""
        return bool(self.angle or self.marker)


ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")
"""Those that have a shaft's angle, impacts and speeds, in the order in which they are drawn."""
DRAWN: tuple[Origin, ...] = (*ORIGINS, SURROGATE)
"""All, the last on top. A surrogate goes by the measured angle."""

_KEPT_SAMPLES = 64_000_000
"""All traces together (256 MB). A longer run is drawn from its beginning; its numbers are of all of it."""

_REACH, _HOLES = 1 << 20, 16
"""Samples up to which a trace may begin, and how many may be missing for each that is there."""
_NOISY, _STRUCK = 3.0, 20.0
"""Times the noise of a healthy rig's sensor: what shows more, or ever reaches so much, moves."""


@dataclass(slots=True)
class Tally:
    """Numbers of one trace in the channel's unit, added up block by block; sums are of finite samples."""

    samples: int = 0
    finite: int = 0
    square_sum: float = 0.0
    largest: float = 0.0
    end_sample: int = 0
    overloaded_blocks: int = 0
    sample_rate: float = 0.0

    def add(self, block: SampleBlock) -> None:
        values = block.values.astype(np.float64)
        square_sum = float(values @ values)
        if not math.isfinite(square_sum):
            values = values[np.isfinite(values)]
            square_sum = float(values @ values)
        self.samples += len(block)
        self.finite += len(values)
        self.square_sum += square_sum
        self.largest = float(np.abs(values).max(initial=self.largest))
        self.end_sample = max(self.end_sample, block.end_sample)
        self.overloaded_blocks += bool(block.flags & Flag.OVERLOAD)
        self.sample_rate = block.sample_rate

    @property
    def missing(self) -> int:
        """Samples that never came."""
        return max(self.end_sample - self.samples, 0)

    @property
    def rms(self) -> float:
        """NaN where no sample is finite."""
        return math.sqrt(self.square_sum / self.finite) if self.finite else math.nan

    @property
    def peak(self) -> float:
        """Largest magnitude, NaN where no sample is finite."""
        return self.largest if self.finite else math.nan


@dataclass(frozen=True, slots=True)
class Trace:
    """One channel of one origin: samples from index 0 on, shape (n,), NaN where missing.

    That one lies `begins_s` after sample 0 of the card, where it is of an instrument beside it.
    """

    values: NDArray[np.float32]
    sample_rate: float
    begins_s: float = 0.0

    def window(self, start_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Times in s since sample 0 of the card and samples between two times, both of shape (m,)."""
        first, end = (round((at - self.begins_s) * self.sample_rate) for at in (start_s, end_s))
        first = max(first, 0)
        values = self.values[first : max(end, first)]
        return self.begins_s + (first + np.arange(len(values))) / self.sample_rate, values

    @property
    def end_s(self) -> float:
        """Since sample 0 of the card."""
        return self.begins_s + len(self.values) / self.sample_rate


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a run lies within what healthy rigs do, None where nobody can tell.

    `sentences` say so, then where and by how much, and what to do next.
    """

    well: bool | None
    sentences: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A run as its log tells it; `speeds` of the crank are in rpm, as they were derived.

    `begins_ns` is the time of sample 0. An origin that stands for something else has its name in `names`.
    Traces, numbers, impacts and speeds are of its first `until_stop_s` where it was stopped before its time.
    """

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
    until_stop_s: float | None
    impacts: list[Impact]
    speeds: dict[Origin, Trace]
    verdict: Verdict | None = None
    begins_ns: int | None = None
    names: Mapping[Origin, str] = field(default_factory=dict)

    @property
    def facts(self) -> ScenarioFacts:
        return scenario_facts(self.scenario)

    @property
    def roles(self) -> Roles:
        """The roles of the channels; of a rig that nobody knows here, few."""
        kind = RIGS.get(self.facts.rig)
        crank = kind.crank if kind else None
        return Roles(
            angle=crank.angle if crank else "",
            marker=crank.marker if crank else "",
            vibration=tuple(name for name in self.channels if not crank or name not in crank.plain),
            unwrapped=frozenset(name for name in self.channels if role_of(name) is Role.ANGLE),
            stops=kind.stops if kind else None,
            impacts=kind.channels.heard(self.channels) if kind else {},
        )

    @property
    def mounting(self) -> Mounting:
        """How what shows the cycles is mounted."""
        kind = RIGS.get(self.facts.rig)
        return mounting_of(self.metadata.get("run", {}), kind.channels) if kind else AS_USUAL

    def unit(self, name: str) -> str:
        """A channel's, as people write it."""
        return as_written(self.channels[name].unit)[1]

    def written(self, origin: Origin, name: str) -> Trace:
        """A trace in `unit`."""
        trace, factor = self.traces[origin, name], as_written(self.channels[name].unit)[0]
        return trace if factor == 1.0 else replace(trace, values=np.float32(factor) * trace.values)

    @property
    def duration_s(self) -> float:
        return max((each.end_sample / each.sample_rate for each in self.tallies.values()), default=0.0)

    @property
    def measured(self) -> dict[str, Tally]:
        return {
            name: self.tallies["measured", name]
            for name in self.channels
            if ("measured", name) in self.tallies
        }

    @property
    def overloaded_blocks(self) -> int:
        """Measured blocks with an overload, over all channels."""
        return sum(tally.overloaded_blocks for tally in self.measured.values())

    @property
    def missing(self) -> int:
        """Measured samples that never came, over all channels."""
        return sum(tally.missing for tally in self.measured.values())

    @property
    def measured_gaps(self) -> int:
        """How many gaps measured channels have, that behind a stop among them."""
        return sum(gap.origin in ("", "measured") for gap in self.gaps)  # older logs do not say whose

    def noise(self, name: str) -> float:
        """Rms that a healthy rig's sensor shows of a channel where nothing moves; 0 where nobody knows."""
        return _sensor_noise(self.scenario, tuple(self.channels)).get(name, 0.0)

    @property
    def still(self) -> frozenset[str]:
        """Channels of which every prediction is 0 throughout, and that show no more than sensor noise."""
        largest: dict[str, float] = {}
        for (origin, name), tally in self.tallies.items():
            if origin != "measured":
                largest[name] = max(largest.get(name, 0.0), tally.largest)
        measured = self.measured
        return frozenset(
            name
            for name, most in largest.items()
            if most == 0.0 and not (name in measured and _shows_more(measured[name], self.noise(name)))
        )

    @property
    def repaired(self) -> bool:
        """True where the prediction has effects and the nominal twin lies beside it."""
        return any(origin == "nominal" for origin, _ in self.traces)

    def whose(self, origin: Origin) -> str:
        """The origin as a report names it: beside a nominal twin, the prediction is the repaired one."""
        if origin in self.names:
            return self.names[origin]
        if origin == SURROGATE:
            return "surrogate"
        return "repaired" if self.repaired and origin == "predicted" else origin

    @property
    def kept_s(self) -> float | None:
        """How much of a long run, from its beginning, the traces hold; None where they hold all of it."""
        cut = [key for key, trace in self.traces.items() if len(trace.values) < self.tallies[key].end_sample]
        kept = (len(self.traces[key].values) / self.traces[key].sample_rate for key in cut)
        return min(kept, default=None)


class RunCollector:
    """A run's record from a stream as it passes: a consumer of a replay, or of `read_run`.

    Blocks of a channel come in their order. Of what is derived a record has impacts and the crank's speed.
    """

    def __init__(self, reader: LogReader) -> None:
        self._reader, self._stopped_ns = reader, reader.stopped_ns
        self._declared = {origin: reader.channels(origin) for origin in DRAWN}
        keys: list[tuple[Origin, str]] = [
            (origin, name) for origin in DRAWN for name in self._declared[origin]
        ]
        self._keys, self._limit = frozenset(keys), _KEPT_SAMPLES // max(len(keys), 1)
        self._tallies: dict[tuple[Origin, str], Tally] = defaultdict(Tally)
        self._blocks: dict[tuple[Origin, str], _Kept] = defaultdict(_Kept)
        self._whose_speed = {derived_name(origin, CRANK_SPEED): origin for origin in ORIGINS}
        self._speeds: dict[Origin, _Kept] = defaultdict(_Kept)
        self._impacts: list[Impact] = []
        self._settled: dict[str, dict[str, str]] = {}
        self._begins_ns: int | None = None

    def __call__(self, record: Record) -> None:
        match record:
            case Block(origin, whole) if len(samples := whole.before(self._stopped_ns)):
                key = origin, samples.channel
                if self._begins_ns is None and origin != "derived":
                    self._begins_ns = sample_time_ns(
                        samples.time_ns, -samples.first_sample, samples.sample_rate
                    )
                if origin == "derived" and samples.channel in self._whose_speed:
                    _keep(self._speeds[self._whose_speed[samples.channel]], samples, _KEPT_SAMPLES)
                elif key in self._keys:
                    self._tallies[key].add(samples)
                    _keep(self._blocks[key], samples, self._limit)
            case Impact() if self._stopped_ns is None or record.time_ns < self._stopped_ns:
                self._impacts.append(record)
            case Metadata(name, values):
                self._settled[name] = dict(values)

    def record(self) -> RunRecord:
        reader, measured = self._reader, self._declared["measured"]
        begins_ns = self._begins_ns or 0
        return RunRecord(
            path=reader.path,
            complete=reader.complete,
            damage=reader.damage,
            library=reader.library,
            scenario=reader.scenario,
            metadata=reader.metadata | self._settled,
            channels=measured | self._declared["predicted"] | measured,  # the measured first, and as they are
            traces={
                key: _joined(each.blocks, begins_ns) for key, each in self._blocks.items() if each.blocks
            },
            tallies=dict(self._tallies),
            events=reader.events(),
            gaps=reader.gaps(),
            until_stop_s=reader.until_stop_s,
            impacts=list(self._impacts),
            speeds={
                key: _joined(each.blocks, begins_ns) for key, each in self._speeds.items() if each.blocks
            },
            begins_ns=self._begins_ns,
        )


def _shows_more(seen: Tally, noise: float) -> bool:
    return seen.rms > _NOISY * noise or seen.largest > _STRUCK * noise


def read_run(log: Path, consumers: Sequence[Consumer] = ()) -> RunRecord:
    """Read a log in one pass, of which `consumers` get every block and impact too.

    Impacts that it lacks, or has by an earlier rule, are found on the way. Raises LogError if it is none or
    damaged in its middle.
    """
    with LogReader(log) as reader:
        collector = RunCollector(reader)
        stream = Stream([collector, *consumers])
        derivation = None
        if not says_impacts(reader):
            derivation = derivation_of(
                reader, lambda found: None if isinstance(found, Block) else stream(found)
            )
            stream.append(derivation)
        for origin, block in reader.blocks((*DRAWN, "derived")):
            stream(Block(origin, block))
        if derivation is not None:
            derivation.finish()
        else:
            for impact in reader.impacts():
                stream(impact)
        return collector.record()


@dataclass(slots=True)
class _Kept:
    """Blocks of a trace, and how many samples they have."""

    blocks: list[SampleBlock] = field(default_factory=list)
    samples: int = 0


def _keep(kept: _Kept, block: SampleBlock, limit: int) -> None:
    """Up to `limit` samples, and to no hole that is far longer than what is before it."""
    if block.end_sample <= min(limit, _REACH + _HOLES * kept.samples):
        kept.blocks.append(block)
        kept.samples += len(block)


def _joined(blocks: list[SampleBlock], begins_ns: int) -> Trace:
    end, first = max(block.end_sample for block in blocks), blocks[0]
    zero_ns = sample_time_ns(first.time_ns, -first.first_sample, first.sample_rate)
    return Trace(values_of(blocks, 0, end, np.float32), first.sample_rate, (zero_ns - begins_ns) / NS_PER_S)


@dataclass(frozen=True, slots=True)
class ScenarioFacts:
    """Name, rig, drive and `notes` in the operator's words.

    `cycle_s` is one cycle of the drive, None if unknown; `settings` are the keys of [model], [drive] and
    [acquisition], such as drive.speed, with what stands there.
    """

    name: str = ""
    rig: str = ""
    drive: str = ""
    cycle_s: float | None = None
    notes: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)


_TABLES = ("model", "drive", "acquisition", "notes")


@functools.lru_cache(maxsize=8)
def scenario_facts(toml: str) -> ScenarioFacts:
    """Read them from a scenario's TOML text, which another program may have written."""
    try:
        scenario = read_toml(toml, "scenario")
    except ConfigurationError:
        return ScenarioFacts()
    tables = {name: found if isinstance(found := scenario.get(name), dict) else {} for name in _TABLES}
    drive = tables["drive"]
    hertz = _quantity(drive.get("frequency"), "Hz") or _quantity(drive.get("speed"), "rad/s") / math.tau
    return ScenarioFacts(
        name=str(scenario.get("name", "")),
        rig=str(scenario.get("rig", "")),
        drive=", ".join(f"{key} {value}" for key, value in drive.items()),
        cycle_s=1.0 / hertz if hertz > 0 and math.isfinite(1.0 / hertz) else None,
        notes={key: str(value) for key, value in tables.pop("notes").items()},
        settings={f"{name}.{key}": str(each) for name in tables for key, each in tables[name].items()},
    )


@functools.lru_cache(maxsize=8)
def _sensor_noise(toml: str, channels: tuple[str, ...]) -> Mapping[str, float]:
    """Rms by channel as the twin of a scenario has it; none where no twin can be set up."""
    try:
        sensors = twin_of(parse_scenario(toml), channels).sensors
    except RattleError:
        return {}
    return {name: each.noise for name, each in sensors.items() if isinstance(each, SensorChain)}


def _quantity(value: object, unit: str) -> float:
    try:
        return float(value) if isinstance(value, int | float) else si_value(str(value), unit)
    except (QuantityError, OverflowError):
        return 0.0
