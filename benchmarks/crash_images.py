"""What a power loss leaves of a log: images of the disk made from the writes of a recording.

A log is written in simulated time with a sync a second; all its writes are kept in a list. An image is what a
disk may hold when the power fails at any of them: all before the last finished sync, and of each later write
everything, nothing, the first sectors of it, or garbage in one of its sectors, whatever became of the others.
Each image is recovered and compared with what had been handed to the writer.
Returns 1 if one cannot be read, a sample is wrong or unaccounted for, or more is lost than is allowed.

Usage: python -m benchmarks.crash_images [images] [--seed N]
"""

from __future__ import annotations

import argparse
import io
import tempfile
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

import numpy as np
from mcap.exceptions import EndOfFile
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.errors import LogError
from daq.log.codec import encode_block
from daq.log.reader import LogReader
from daq.log.records import Event
from daq.log.recover import recover_log
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
_IMAGES_A_LOG = 25


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


def record(path: Path, seconds: float, rng: np.random.Generator, closed: bool = False) -> Recording:
    """Write a log of `seconds` to `path`; without `closed` nothing finishes it."""
    recording = Recording()

    def synced(_: int) -> None:
        recording.syncs.append(len(recording.writes))

    with (
        mock.patch.object(Path, "open", lambda self, mode: io.BufferedWriter(_Watched(self, recording))),
        mock.patch("daq.log.writer.os.fdatasync", synced),
    ):
        log = LogWriter(path).open()
        log.add_metadata("scenario", {"toml": 'rig = "impact_beam"\n'})
        for name in _RATES:
            log.declare("measured", Channel(name, "N"))
        synced_s = 0.0
        for index in range(round(seconds / _BLOCK_S)):
            recording.now_s = (index + 1) * _BLOCK_S
            host_ns = _START_NS + round(recording.now_s * NS_PER_S)
            for name, rate in _RATES.items():
                count = round(rate * _BLOCK_S)
                first = index * count
                time_ns = _START_NS + round(first / rate * NS_PER_S)
                values = rng.normal(size=count).astype(np.float32)
                block = SampleBlock(name, first, time_ns, rate, values)
                recording.sent[name, first] = encode_block(block)
                log.add_block("measured", block, host_ns)
            if index % 7 == 3:
                log.add_event(Event(host_ns, "info", "rig", "still.there", f"block {index}"))
            if recording.now_s - synced_s >= SYNC_S:
                synced_s = recording.now_s
                log.sync()
        if closed:
            log.close()
        else:
            log._file.close()  # the power failed
            log._indexes.close()
    with path.open("rb") as file, suppress(EndOfFile):  # without `closed` it has no footer
        begin = file.tell()
        for each in StreamReader(file, emit_chunks=True).records:
            if isinstance(each, Chunk):
                recording.chunks.append((begin, file.tell()))
            begin = file.tell()
    return recording


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
    """Recover an image; returns what is wrong, "" for nothing, or "no whole chunk on the disk yet"."""
    left, recovered = folder / "left.mcap", folder / "recovered.mcap"
    recovered.unlink(missing_ok=True)
    left.write_bytes(image.content)
    try:
        report = recover_log(left, recovered)
    except LogError:
        return "cannot be read" if recording.has_a_chunk(image.content) else "no whole chunk on the disk yet"
    if not report.sound:
        return "its recovered log is not sound"
    reached = dict.fromkeys(_RATES, 0.0)
    kept: set[tuple[str, int]] = set()
    with LogReader(recovered) as log:
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
        if first / _RATES[name] < image.safe_s - BEHIND_SYNC_S:
            return f"more than {BEHIND_SYNC_S:g} s before a finished sync are lost"
        if image.safe_s and first / _RATES[name] < image.failed_s - MOST_LOST_S:
            return f"more than {MOST_LOST_S:g} s before the power failed are lost"
    return ""


def count_images(images: int, seed: int) -> Counter[str]:
    """How many of so many images were found how."""
    rng, found = np.random.default_rng(seed), Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        while found.total() < images:
            path = folder / "log.mcap"
            recording = record(path, float(rng.uniform(0.5, 6.0)), rng, bool(rng.random() < 0.3))
            path.unlink()
            for _ in range(min(_IMAGES_A_LOG, images - found.total())):
                found[examine(crashed(recording, rng), recording, folder)] += 1
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("images", nargs="?", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    found = count_images(arguments.images, arguments.seed)
    for outcome, count in found.most_common():
        print(f"{count:6} of {arguments.images}  {outcome or 'recovered; nothing wrong, all accounted for'}")
    proven = arguments.images - found["no whole chunk on the disk yet"]
    wrong = proven - found[""]
    rate = "" if wrong or not proven else f" (below {3 / proven:.2g} of those with a chunk, 95 %)"
    print(f"wrong: {wrong} of {proven} with a chunk" + rate)
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
