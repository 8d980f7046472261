"""Single flipped bits anywhere in a log, finished and crashed: how many of them are told.

Returns 1 unless all are: `verify` of a finished log has to find it not sound, and who reads one, as a report
does, has to be told or to read what was written; a crashed one has to say more than that it was cut.

Usage: python -m benchmarks.bit_flips [flips] [--seed N]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.crash_images import record
from daq.errors import LogError
from daq.log.front import CUT
from daq.log.reader import LogReader
from daq.log.recover import verify_log

_SECONDS = 2.0


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


def untold_flips(closed: bool, flips: int, seed: int) -> list[int]:
    """Bits that can be flipped without a word, of so many tried in a log that was closed or not."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        record(path, _SECONDS, rng, closed)
        written = bytearray(path.read_bytes())
        if told(path, closed):
            raise RuntimeError("the log was damaged before a bit of it was flipped")
        whole = read(path)
        bits = rng.choice(8 * len(written), min(flips, 8 * len(written)), replace=False)
        untold = []
        for bit in map(int, bits):
            written[bit // 8] ^= 1 << bit % 8
            path.write_bytes(written)
            if not told(path, closed) or (closed and read(path) not in (None, whole)):
                untold.append(bit)
            written[bit // 8] ^= 1 << bit % 8
        return untold


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("flips", nargs="?", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    wrong = 0
    for closed in (True, False):
        count = arguments.flips // 2
        untold = untold_flips(closed, count, arguments.seed)
        wrong += len(untold)
        print(
            f"{'finished' if closed else 'crashed'}: {count - len(untold)} of {count} told; untold: {untold}"
        )
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
