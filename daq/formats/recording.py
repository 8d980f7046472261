"""A run as formats exchange it: whole channels one after another; and between that and a log."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import get_args

import numpy as np

from daq.allowance import Allowance
from daq.block import LATEST, NS_PER_S, Flag, SampleBlock, is_rate, sample_time_ns
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.samples import CHUNK, MOST_SAMPLES, Samples, Scratch, ScratchColumn, Window
from daq.log.codec import encode_block
from daq.log.reader import LogReader, Origin
from daq.log.records import ClockRecord, Event, Gap, Impact
from daq.log.recover import origin_of_copy
from daq.log.writer import LogWriter

BLOCK_S = 0.1
_SAME_SAMPLE = 1e-3
"""Of a sample interval: so much earlier than a time counts as at that time."""
_ROUNDING_NS = 1
"""Some programs round the time of a block down, some to the nearest nanosecond."""
_Entry = tuple[int, Callable[[], object]]


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Sample `sample` was taken at `time_ns` (Unix epoch), the others at `sample_rate` Hz from there."""

    sample: int
    time_ns: int
    sample_rate: float

    def __post_init__(self) -> None:
        if not is_rate(self.sample_rate):
            raise LogError(f"a sample rate of {self.sample_rate:g} Hz")

    def at(self, sample: int) -> int:
        """Time of a sample in ns since the Unix epoch."""
        return sample_time_ns(self.time_ns, sample - self.sample, self.sample_rate)

    def first_at(self, time_ns: int) -> int:
        """The first sample at a time or after it."""
        return self.sample + math.ceil((time_ns - self.time_ns) * self.sample_rate / NS_PER_S - _SAME_SAMPLE)

    @property
    def zero_ns(self) -> int:
        """Time of sample 0: the start of recording."""
        return self.at(0)

    def agrees(self, other: TimeBase) -> bool:
        """True if both give each sample the same time, but for rounding to a nanosecond."""
        return self.sample_rate == other.sample_rate and abs(self.zero_ns - other.zero_ns) <= 1


@dataclass(frozen=True, slots=True)
class Stretch:
    """`count` consecutive samples from index `first_sample` on, with one time base and the same flags."""

    first_sample: int
    count: int
    base: TimeBase
    flags: Flag = Flag.GOOD

    @property
    def end_sample(self) -> int:
        """Index of the first sample after it."""
        return self.first_sample + self.count

    @property
    def time_ns(self) -> int:
        """Time of its first sample."""
        return self.base.at(self.first_sample)


@dataclass(frozen=True, slots=True)
class Track:
    """One channel from its first sample to its last.

    `samples` begin at the first stretch and end with the last, with NaN in the gaps between stretches.
    """

    origin: Origin
    channel: Channel
    stretches: tuple[Stretch, ...]
    samples: Samples

    def __post_init__(self) -> None:
        check_stretches(self.name, self.stretches, len(self.samples))

    @property
    def name(self) -> str:
        """Origin and name: `measured/contact.force_upper`."""
        return f"{self.origin}/{self.channel.name}"

    @property
    def first_sample(self) -> int:
        """Index of the first sample; 0 if there is none."""
        return self.stretches[0].first_sample if self.stretches else 0

    @property
    def end_sample(self) -> int:
        """Index of the first sample after it; 0 if there is none."""
        return self.stretches[-1].end_sample if self.stretches else 0

    @property
    def flags(self) -> Flag:
        """The flags of all stretches together."""
        return union(stretch.flags for stretch in self.stretches)

    def gaps(self) -> list[tuple[int, int]]:
        """Index and count of samples that are missing between stretches."""
        pairs = zip(self.stretches, self.stretches[1:], strict=False)
        return [
            (one.end_sample, two.first_sample - one.end_sample)
            for one, two in pairs
            if two.first_sample > one.end_sample
        ]

    def strays(self) -> str:
        """By how much its times lie off the start and rate of its first sample; empty within half a sample.

        A device whose clock was set strays, and so may one whose clock was fitted better and better.
        """
        if not self.stretches:
            return ""
        base = self.stretches[0].base
        off_ns = max(
            abs(base.at(at) - stretch.base.at(at))
            for stretch in self.stretches
            for at in (stretch.first_sample, stretch.end_sample)
        )
        if off_ns * base.sample_rate <= NS_PER_S / 2:
            return ""
        off = f"{off_ns / 1e6:.3g} ms off the start and rate of its first sample"
        return f"{self.name}: its times lie up to {off}"


@dataclass(frozen=True, slots=True)
class Recording:
    """A run: its tracks and what its log says besides."""

    tracks: tuple[Track, ...]
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    events: Sequence[Event] = ()
    gaps: Sequence[Gap] | None = None
    """The gap ledger; None where none was kept, so that it has to follow from the samples."""
    clocks: Sequence[ClockRecord] = ()
    impacts: Sequence[Impact] = ()
    start_ns: int | None = None
    """The start of recording, as its log has it; None: sample 0 of the first track."""

    @property
    def zero_ns(self) -> int:
        """From when its times are counted."""
        if self.start_ns is not None:
            return self.start_ns
        return next((track.stretches[0].base.zero_ns for track in self.tracks if track.stretches), 0)

    @property
    def run_id(self) -> str:
        """Name of the run, as its log has it."""
        return self.metadata.get("run", {}).get("id", "")


def union(flags: Iterable[Flag]) -> Flag:
    """All flags together."""
    together = Flag.GOOD
    for each in flags:
        together |= each
    return together


def check_stretches(name: str, stretches: Sequence[Stretch], length: int) -> None:
    """Raise LogError unless stretches lie in order, in the reach of a log, and span `length` samples."""
    end = stretches[0].first_sample if stretches else 0
    if end < 0:
        raise LogError(f"{name}: sample {end} lies before the start of recording")
    for stretch in stretches:
        if stretch.count <= 0 or stretch.first_sample < end:
            raise LogError(f"{name}: sample {stretch.first_sample} comes twice or never (next is {end})")
        end = stretch.end_sample
        if not 0 <= stretch.time_ns <= stretch.base.at(end) < LATEST:
            raise LogError(f"{name}: no log holds a time of {stretch.time_ns} ns since 1970")
    span = end - stretches[0].first_sample if stretches else 0
    if span > MOST_SAMPLES:
        raise LogError(f"{name}: spans {span} samples, which is more than a record can have")
    if span != length:
        raise LogError(f"{name}: {length} samples where {span} are described")


def read_log(
    log: LogReader,
    scratch: Scratch,
    origins: tuple[Origin, ...] | None = None,
    names: Collection[str] | None = None,
) -> Recording:
    """Take a log apart into channels (default: all); samples go to `scratch`. Raises LogError."""
    allowance = log.allowance()
    collectors = {
        (origin, name): _Collector(origin, channel, scratch.column(), allowance)
        for origin in origins or get_args(Origin)
        for name, channel in log.channels(origin).items()
        if names is None or name in names
    }
    for origin, block in log.blocks(origins, names):
        collectors[origin, block.channel].add(block)
    return Recording(
        tuple(collector.track() for collector in collectors.values()),
        {**log.metadata, **origin_of_copy(log)},
        log.events(),
        log.gaps(),
        log.clocks(),
        [each for each in log.impacts() if (each.origin, each.channel) in collectors],
        log.zero_ns,
    )


class _Collector:
    """One channel while its blocks come."""

    def __init__(self, origin: Origin, channel: Channel, column: ScratchColumn, allowance: Allowance) -> None:
        self._origin, self._channel, self._column = origin, channel, column
        self._allowance = allowance
        self._stretches: list[Stretch] = []

    def add(self, block: SampleBlock) -> None:
        if not len(block):
            return
        last = self._stretches[-1] if self._stretches else None
        base = TimeBase(block.first_sample, block.time_ns, block.sample_rate)
        if last is not None:
            if block.first_sample < last.end_sample:
                raise LogError(f"/{self._origin}/{block.channel}: sample {block.first_sample} comes twice")
            strays_ns = abs(last.base.at(block.first_sample) - block.time_ns)
            if base.sample_rate == last.base.sample_rate and strays_ns <= _ROUNDING_NS:
                base = last.base
            self._column.skip(block.first_sample - last.end_sample)
        new = Stretch(block.first_sample, len(block), base, block.flags)
        follows = (new.first_sample, new.base, new.flags)
        if last is not None and (last.end_sample, last.base, last.flags) == follows:
            self._stretches[-1] = Stretch(last.first_sample, last.count + new.count, base, last.flags)
        else:
            self._allowance.spend(records=1)
            self._stretches.append(new)
        # some formats hold a channel as one array, with what is missing
        since = last.end_sample if last is not None else block.first_sample
        missing = (block.first_sample - since) * block.values.itemsize
        self._allowance.spend(held=missing, passed=block.values.nbytes)
        self._column.add(block.values)

    def track(self) -> Track:
        return Track(self._origin, self._channel, tuple(self._stretches), self._column.samples())


def within(recording: Recording, start_s: float, end_s: float) -> Recording:
    """What lies between two times, in s since the start of recording; its gaps follow from its samples."""
    start_ns = recording.zero_ns + round(start_s * NS_PER_S)
    end_ns = recording.zero_ns + round(end_s * NS_PER_S) if end_s < math.inf else LATEST
    tracks = tuple(_cut(track, start_ns, end_ns) for track in recording.tracks)
    impacts = [each for each in recording.impacts if start_ns <= each.time_ns < end_ns]
    return replace(recording, tracks=tracks, gaps=None, impacts=impacts)


def _cut(track: Track, start_ns: int, end_ns: int) -> Track:
    stretches = []
    for each in track.stretches:
        first, end = (
            min(max(each.base.first_at(time_ns), each.first_sample), each.end_sample)
            for time_ns in (start_ns, end_ns)
        )
        if first < end:
            stretches.append(replace(each, first_sample=first, count=end - first))
    ends = (stretches[0].first_sample, stretches[-1].end_sample) if stretches else (track.first_sample,) * 2
    window = Window(track.samples, *(at - track.first_sample for at in ends))
    return replace(track, stretches=tuple(stretches), samples=window)


def write_log(recording: Recording, writer: LogWriter) -> None:
    """Write a recording as a log in the order of time; raises LogError, RecorderFailed."""
    for name, record in recording.metadata.items():
        writer.add_metadata(name, record)
    for track in recording.tracks:
        writer.declare(track.origin, track.channel)
    record_gaps = recording.gaps is None
    streams: list[Iterable[_Entry]] = [_blocks(track, writer, record_gaps) for track in recording.tracks]
    records: list[_Entry] = []
    for event in recording.events:
        records.append((event.time_ns, partial(writer.add_event, event)))
    for gap in recording.gaps or ():
        records.append((gap.time_ns, partial(writer.add_gap, gap, gap.time_ns)))
    for clock in recording.clocks:
        records.append((clock.time_ns, partial(writer.add_clock, clock)))
    for impact in recording.impacts:
        records.append((impact.time_ns, partial(writer.add_impact, impact, impact.time_ns)))
    streams.append(sorted(records, key=lambda entry: entry[0]))
    for _, write in heapq.merge(*streams, key=lambda entry: entry[0]):
        write()


def _blocks(track: Track, writer: LogWriter, record_gaps: bool) -> Iterator[_Entry]:
    for block in blocks_of(track):
        host_ns = sample_time_ns(block.time_ns, len(block), block.sample_rate)
        with np.errstate(all="ignore"):  # samples that are no numbers have no rms
            data = encode_block(block)
        yield host_ns, partial(writer.add_encoded_block, track.origin, block, data, host_ns, record_gaps)


def blocks_of(track: Track) -> Iterator[SampleBlock]:
    """Blocks of at most 0.1 s, none across a gap or a change of flags; what is no number is flagged."""
    for stretch in track.stretches:
        most = max(1, min(round(BLOCK_S * stretch.base.sample_rate), CHUNK))
        ahead = max(1, CHUNK // most) * most
        for begin in range(stretch.first_sample, stretch.end_sample, ahead):
            end = min(begin + ahead, stretch.end_sample)
            values = track.samples.read(begin - track.first_sample, end - track.first_sample)
            for first in range(begin, end, most):
                part = values[first - begin : first - begin + most]
                finite = bool(np.isfinite(part).all())
                flags = stretch.flags if finite else stretch.flags | Flag.NOT_FINITE
                time_ns, rate = stretch.base.at(first), stretch.base.sample_rate
                yield SampleBlock(track.channel.name, first, time_ns, rate, part, flags)
