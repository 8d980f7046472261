"""What a power loss leaves of a log: images of the disk made from the writes of a recording.

A log is written in simulated time with a sync a second; all its writes are kept in a list. An image is what a
disk may hold when the power fails at any of them: all before the last finished sync, and of each later write
everything, nothing, the first sectors of it, or garbage in one of its sectors, whatever became of the others.
Each image is recovered and compared with what had been handed to the writer: samples, gaps, events, clocks,
impacts and metadata. As many images are made as have a chunk whole; how many had none is told beside.
Returns 1 if one cannot be read, anything is wrong, a sample unaccounted for, or more lost than is allowed.

Usage: python -m benchmarks.crash_images [images] [--seed N]
"""

from __future__ import annotations

import argparse
import io
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from unittest import mock

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.records import Chunk, Footer, McapRecord
from mcap.stream_reader import StreamReader

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.errors import LogError
from daq.log.codec import decode_record, encode_block
from daq.log.reader import LogReader
from daq.log.records import CHECKSUM_OPCODE, ClockRecord, Event, Gap, Impact
from daq.log.recover import LOST, RECOVERED, UNWRITTEN, recover_log
from daq.log.writer import LogWriter
from daq.recorder import SYNC_S

BEHIND_SYNC_S = 0.4
"""A chunk of 0.25 s may be open while a sync is made, and a block of 0.1 s have come since."""
MOST_LOST_S = 1.5
"""Promised, before the power failed: what came since the last sync, and that."""
_SECTOR = 512
_START_NS = 1_790_000_000 * NS_PER_S
_BLOCK_S = 0.1
_RATES = {"contact.force_upper": 5120.0, "base.acceleration": 5120.0, "tachometer.speed": 10.0}
_WITH_GAPS, _IMPACTED = "base.acceleration", "contact.force_upper"
_BESIDE = ("/event", "/gap", "/clock", "/impact")
_IMAGES_A_LOG = 25
_CHECKSUM_BYTES = 13
NO_CHUNK = "no whole chunk on the disk yet"


@dataclass(frozen=True, slots=True)
class Write:
    """One write to the file, and when, s since sample 0."""

    offset: int
    data: bytes
    at_s: float


@dataclass(slots=True)
class Recording:
    """All writes of a log, how many of them each finished sync covers, and what was to be written."""

    writes: list[Write] = field(default_factory=list)
    syncs: list[int] = field(default_factory=lambda: [0])
    sent: dict[tuple[str, int], bytes] = field(default_factory=dict)
    messages: dict[tuple[object, ...], float] = field(default_factory=dict)
    metadata: dict[tuple[object, ...], float] = field(default_factory=dict)
    """What was written beside samples, and when, s since sample 0."""
    now_s: float = 0.0
    chunks: list[tuple[int, int]] = field(default_factory=list)
    """Where each begins and ends in the file."""

    def has_a_chunk(self, content: bytes) -> bool:
        """Whether one stands whole where it was written."""
        written = b"".join(write.data for write in self.writes)
        return any(content[begin:end] == written[begin:end] for begin, end in self.chunks)


class _Watched(io.FileIO):
    """A file that notes its writes."""

    def __init__(self, path: Path, recording: Recording) -> None:
        super().__init__(path, "xb")
        self._recording = recording

    def write(self, data: object) -> int:
        offset = self.tell()
        count = super().write(data)  # type: ignore[arg-type]
        written = bytes(memoryview(data)[:count])  # type: ignore[arg-type]
        self._recording.writes.append(Write(offset, written, self._recording.now_s))
        return count


class _NotingWriter(LogWriter):
    """Notes what it writes beside samples."""

    def __init__(self, path: Path, recording: Recording) -> None:
        super().__init__(path)
        self._recording = recording

    def add_message(self, topic: str, data: bytes, log_ns: int, publish_ns: int) -> None:
        super().add_message(topic, data, log_ns, publish_ns)
        if topic in _BESIDE:
            self._recording.messages[topic, log_ns, data] = self._recording.now_s

    def add_metadata(self, name: str, record: Mapping[str, str]) -> None:
        super().add_metadata(name, record)
        self._recording.metadata[name, *record.items()] = self._recording.now_s


def record(path: Path, seconds: float, rng: np.random.Generator, closed: bool = False) -> Recording:
    """Write a log of `seconds` to `path`; without `closed` nothing finishes it."""
    recording = Recording()

    def synced(_: int) -> None:
        recording.syncs.append(len(recording.writes))

    with (
        mock.patch.object(Path, "open", lambda self, mode: io.BufferedWriter(_Watched(self, recording))),
        mock.patch("daq.log.writer.os.fdatasync", synced),
    ):
        log = _NotingWriter(path, recording).open()
        log.add_metadata("scenario", {"toml": 'rig = "impact_beam"\n'})
        for name in _RATES:
            log.declare("measured", Channel(name, "N"))
        synced_s = 0.0
        for index in range(round(seconds / _BLOCK_S)):
            recording.now_s = (index + 1) * _BLOCK_S
            host_ns = _START_NS + round(recording.now_s * NS_PER_S)
            _add_beside_samples(log, index, host_ns)
            for name, rate in _RATES.items():
                count = round(rate * _BLOCK_S)
                first = index * count
                time_ns = _START_NS + round(first / rate * NS_PER_S)
                if name == _WITH_GAPS and index % 9 == 4:
                    log.add_gap(Gap(time_ns, name, first, count, "the card overran"), host_ns)
                    continue
                values = rng.normal(size=count).astype(np.float32)
                block = SampleBlock(name, first, time_ns, rate, values)
                recording.sent[name, first] = encode_block(block)
                log.add_block("measured", block, host_ns)
            if recording.now_s - synced_s >= SYNC_S:
                synced_s = recording.now_s
                log.sync()
        if closed:
            log.close()
        else:
            log._file.close()  # the power failed
            log._indexes.close()
    content = path.read_bytes()
    recording.chunks = [(begin, end) for each, begin, end in records(content) if isinstance(each, Chunk)]
    return recording


def records(content: bytes) -> Iterator[tuple[McapRecord | None, int, int]]:
    """Each record of a log as the MCAP package reads it, where it begins and ends; None is our checksum."""
    stream, at = BytesIO(content), 0
    with suppress(EndOfFile):  # a crashed one has no footer
        for each in StreamReader(stream, emit_chunks=True).records:
            while content[at] == CHECKSUM_OPCODE:
                yield None, at, (at := at + _CHECKSUM_BYTES)
            end = len(content) if isinstance(each, Footer) else stream.tell()
            yield each, at, (at := end)
    if at < len(content):
        yield None, at, len(content)


def _add_beside_samples(log: LogWriter, index: int, host_ns: int) -> None:
    """Some of each kind: what a run tells as it goes, and what describes it, which comes a little later."""
    if index == 2:
        log.add_metadata("run", {"id": "run-7", "card": "emulated"})
    if index % 7 == 3:
        log.add_event(Event(host_ns, "info", "rig", "still.there", f"block {index}"))
    if index % 10 == 1:
        log.add_clock(ClockRecord(host_ns, "card", 1e-3, index * 0.1, 1e-5))
    if index % 5 == 2:
        first, name = index * round(_RATES[_IMPACTED] * _BLOCK_S), _IMPACTED
        impact = Impact(host_ns, "measured", name, first, first + 9, first + 4, 40.1, 39.9, 0.3, 1e-3, 1, 0.5)
        log.add_impact(impact, host_ns)


@dataclass(frozen=True, slots=True)
class Image:
    """What is on the disk, up to when (s) a sync had made everything safe, and when the power failed."""

    content: bytes
    safe_s: float
    failed_s: float


def crashed(recording: Recording, rng: np.random.Generator) -> Image:
    """The disk after a power loss at a random write."""
    reached = int(rng.integers(1, len(recording.writes) + 1))
    safe = max(sync for sync in recording.syncs if sync <= reached)
    disk = bytearray()
    for number, write in enumerate(recording.writes[:reached]):
        data = write.data if number < safe else _as_left(write.data, rng)
        end = write.offset + len(data)
        disk.extend(bytes(max(end - len(disk), 0)))
        disk[write.offset : end] = data
    return Image(
        bytes(disk), recording.writes[safe - 1].at_s if safe else 0.0, recording.writes[reached - 1].at_s
    )


def _as_left(data: bytes, rng: np.random.Generator) -> bytes:
    """What became of a write that no sync had finished."""
    match rng.integers(4):
        case 0:
            return b""
        case 1:
            return data[: int(rng.integers(len(data) // _SECTOR + 1)) * _SECTOR]
        case 2:
            at = int(rng.integers(len(data)))
            garbage = rng.bytes(min(_SECTOR, len(data) - at))
            return data[:at] + garbage + data[at + len(garbage) :]
    return data


def examine(image: Image, recording: Recording, folder: Path) -> str:
    """Recover an image; returns what is wrong, "" for nothing, or `NO_CHUNK` for nothing in one without."""
    left, recovered = folder / "left.mcap", folder / "recovered.mcap"
    recovered.unlink(missing_ok=True)
    left.write_bytes(image.content)
    nothing_wrong = "" if recording.has_a_chunk(image.content) else NO_CHUNK
    try:
        report = recover_log(left, recovered)
    except LogError:
        return nothing_wrong or "cannot be read"
    if not report.sound:
        return "its recovered log is not sound"
    with LogReader(recovered) as log:
        metadata = [(name, *each.items()) for name, each in log.metadata.items() if name != RECOVERED]
        wrong = (
            _wrong_samples(log, image, recording)
            or _wrong_beside(metadata, recording.metadata, image)
            or _wrong_beside(_messages_beside(log), recording.messages, image)
        )
    return wrong or nothing_wrong


def _wrong_samples(log: LogReader, image: Image, recording: Recording) -> str:
    reached = dict.fromkeys(_RATES, 0.0)
    kept: set[tuple[str, int]] = set()
    for _, block in log.blocks("measured"):
        key = block.channel, block.first_sample
        if encode_block(block) != recording.sent.get(key):
            return "a sample that was not sent"
        kept.add(key)
        reached[block.channel] = block.end_sample / block.sample_rate
    gaps = [(gap.channel, range(gap.first_sample, gap.first_sample + gap.count)) for gap in log.gaps()]
    for name, first in recording.sent.keys() - kept:
        told = any(name == channel and first in missing for channel, missing in gaps)
        if first / _RATES[name] < reached[name] and not told:
            return "a sample unaccounted for"
        if lost := _lost_too_much(first / _RATES[name], image):
            return lost
    return ""


def _messages_beside(log: LogReader) -> list[tuple[object, ...]]:
    """Without the gaps that the recovery itself made."""
    return [
        (topic, log_ns, data)
        for topic, log_ns, _, _, data in log.messages(_BESIDE)
        if topic != "/gap" or decode_record(Gap, data).cause not in (LOST, UNWRITTEN)
    ]


def _wrong_beside(
    left: Sequence[tuple[object, ...]], written: Mapping[tuple[object, ...], float], image: Image
) -> str:
    """What is left has to be as it was written, and in that order."""
    remaining = iter(written)
    if not all(each in remaining for each in left):
        return "what was not written, or in another order"
    lost = (_lost_too_much(at_s, image) for each, at_s in written.items() if each not in left)
    return next(filter(None, lost), "")


def _lost_too_much(at_s: float, image: Image) -> str:
    """Whether what came then should have been there."""
    if at_s < image.safe_s - BEHIND_SYNC_S:
        return f"more than {BEHIND_SYNC_S:g} s before a finished sync are lost"
    if image.safe_s and at_s < image.failed_s - MOST_LOST_S:
        return f"more than {MOST_LOST_S:g} s before the power failed are lost"
    return ""


def count_images(images: int, seed: int) -> Counter[str]:
    """How many images were found how, until so many with a whole chunk were tried."""
    rng, found = np.random.default_rng(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        while found.total() - found[NO_CHUNK] < images:
            path = folder / "log.mcap"
            recording = record(path, float(rng.uniform(0.5, 6.0)), rng, bool(rng.random() < 0.3))
            path.unlink()
            for _ in range(min(_IMAGES_A_LOG, images + found[NO_CHUNK] - found.total())):
                found[examine(crashed(recording, rng), recording, folder)] += 1
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("images", nargs="?", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    found = count_images(arguments.images, arguments.seed)
    for outcome, count in found.most_common():
        print(f"{count:6} of {found.total()}  {outcome or 'recovered; nothing wrong, all accounted for'}")
    wrong = arguments.images - found[""]
    rate = "" if wrong else f" (below {3 / arguments.images:.2g} of those with a chunk, 95 %)"
    print(f"wrong: {wrong} of {arguments.images} with a chunk{rate}")
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
