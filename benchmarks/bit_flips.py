"""Single flipped bits anywhere in a log, finished and crashed: how many of them are told.

Half of the bits are drawn from all of the file, most of which are samples, half evenly from its parts.
Returns 1 unless all are told: `verify` of a finished log has to find it not sound, and who reads one, as a
report does, has to be told or to read what was written; a crashed one has to say more than that it was cut.

Usage: python -m benchmarks.bit_flips [flips] [--seed N]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import NoneType

import numpy as np
from mcap.records import Channel, Chunk, Footer, Header, MessageIndex, Metadata, Schema

from benchmarks.crash_images import record, records
from daq.errors import LogError
from daq.log.front import CUT
from daq.log.reader import LogReader
from daq.log.recover import verify_log

_SECONDS = 2.0
_PARTS: dict[type, str] = {
    NoneType: "checksums",
    Header: "header",
    Metadata: "metadata",
    Chunk: "chunks",
    MessageIndex: "message indexes",
    Schema: "schemas and channels",
    Channel: "schemas and channels",
    Footer: "footer",
}
"""By record; the others are the summary. Chunks begin with their own schemas and channels, packed."""


def read(path: Path) -> object:
    """All that a report takes from a log; None where it is told that something is wrong with it."""
    try:
        with LogReader(path) as log:
            found = log.metadata, log.topic_metadata(), list(log.messages())
            return found if log.complete and not log.damage else None
    except LogError:
        return None


def told(path: Path, closed: bool) -> bool:
    """Whether something is found wrong with a log beside that it was cut."""
    if closed:
        return not verify_log(path).sound
    with LogReader(path) as log:
        return log.damage not in ("", CUT)


def bytes_of_parts(content: bytes) -> dict[str, list[int]]:
    """Where the bytes of each part of a log are."""
    parts: dict[str, list[int]] = {}
    for each, begin, end in records(content):
        parts.setdefault(_PARTS.get(type(each), "summary"), []).extend(range(begin, end))
    return parts


def drawn(content: bytes, flips: int, rng: np.random.Generator) -> Iterator[tuple[str, int]]:
    """So many bits, each with the part that it is in; fewer where a part has not as many."""
    parts = bytes_of_parts(content)
    part_of = {place: name for name, places in parts.items() for place in places}
    bits = {*map(int, rng.choice(8 * len(content), flips // 2, replace=False))}
    for places in parts.values():
        share = min(flips // 2 // len(parts), 8 * len(places))
        some = rng.choice(8 * len(places), share, replace=False)
        bits |= {8 * places[each // 8] + each % 8 for each in map(int, some)}
    return ((part_of[bit // 8], bit) for bit in sorted(bits))


def flipped(closed: bool, flips: int, seed: int) -> dict[str, list[tuple[int, bool]]]:
    """By part: bits that were flipped in a log that was closed or not, and whether each was told."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        record(path, _SECONDS, rng, closed)
        written = bytearray(path.read_bytes())
        if told(path, closed):
            raise RuntimeError("the log was damaged before a bit of it was flipped")
        whole = read(path)
        found: dict[str, list[tuple[int, bool]]] = {}
        for part, bit in drawn(bytes(written), flips, rng):
            written[bit // 8] ^= 1 << bit % 8
            path.write_bytes(written)
            seen = told(path, closed) and not (closed and read(path) not in (None, whole))
            found.setdefault(part, []).append((bit, seen))
            written[bit // 8] ^= 1 << bit % 8
        return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("flips", nargs="?", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    tried = wrong = 0
    for closed in (True, False):
        for part, bits in flipped(closed, arguments.flips // 2, arguments.seed).items():
            untold = [bit for bit, seen in bits if not seen]
            tried, wrong = tried + len(bits), wrong + len(untold)
            log = "finished" if closed else "crashed"
            print(f"{log:<9}{part:<21}{len(bits) - len(untold):>5} of {len(bits)} told; untold: {untold}")
    print(f"untold: {wrong} of {tried}")
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
