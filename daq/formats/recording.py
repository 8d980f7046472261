"""A run as formats exchange it: channels one after another, each with its whole record."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from daq.block import NS_PER_S, Flag, sample_time_ns
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.samples import MOST_SAMPLES, Samples
from daq.log.reader import Origin
from daq.log.records import ClockRecord, Event, Gap, Impact

_LATEST_NS = 1 << 63


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Sample `sample` was taken at `time_ns` (Unix epoch), the others at `sample_rate` Hz from there."""

    sample: int
    time_ns: int
    sample_rate: float

    def __post_init__(self) -> None:
        if not 0 < self.sample_rate < math.inf:
            raise LogError(f"a sample rate of {self.sample_rate:g} Hz")

    def at(self, sample: int) -> int:
        """Time of a sample in ns since the Unix epoch."""
        return sample_time_ns(self.time_ns, sample - self.sample, self.sample_rate)

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
        if not 0 <= stretch.time_ns <= stretch.base.at(end) < _LATEST_NS:
            raise LogError(f"{name}: no log holds a time of {stretch.time_ns} ns since 1970")
    span = end - stretches[0].first_sample if stretches else 0
    if span > MOST_SAMPLES:
        raise LogError(f"{name}: spans {span} samples, which is more than a record can have")
    if span != length:
        raise LogError(f"{name}: {length} samples where {span} are described")
