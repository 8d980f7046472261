"""Between a log and a recording: blocks in the order of time there, whole channels here."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import get_args

import numpy as np

from daq.block import Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.recording import Recording, Stretch, TimeBase, Track
from daq.formats.samples import CHUNK, Scratch, ScratchColumn
from daq.log.codec import encode_block
from daq.log.reader import LogReader, Origin
from daq.log.writer import LogWriter

BLOCK_S = 0.1
_ROUNDING_NS = 1
"""Some programs round the time of a block down, some to the nearest nanosecond."""

_Entry = tuple[int, Callable[[], None]]


def read_log(log: LogReader, scratch: Scratch) -> Recording:
    """Take a log apart into channels; samples go to `scratch`. Raises LogError."""
    collectors = {
        (origin, name): _Collector(origin, channel, scratch.column())
        for origin in get_args(Origin)
        for name, channel in log.channels(origin).items()
    }
    for origin, block in log.blocks():
        collectors[origin, block.channel].add(block)
    return Recording(
        tuple(collector.track() for collector in collectors.values()),
        log.metadata,
        log.events(),
        log.gaps(),
        log.clocks(),
        log.impacts(),
    )


class _Collector:
    """One channel while its blocks come."""

    def __init__(self, origin: Origin, channel: Channel, column: ScratchColumn) -> None:
        self._origin, self._channel, self._column = origin, channel, column
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
            self._stretches.append(new)
        self._column.add(block.values)

    def track(self) -> Track:
        return Track(self._origin, self._channel, tuple(self._stretches), self._column.samples())


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
