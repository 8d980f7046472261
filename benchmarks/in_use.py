"""What a process has asked Python and glibc for and not given back; told by all processes of a run.

The resident memory of a process moves by what a stall has left behind in it, tens of MB; this does not.
"""

from __future__ import annotations

import ctypes
import math
import os
import random
import sys
import threading
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
_OF_PYTHON = 96
"""Bytes of an object that Python has in its own pools, about; with `PYTHONMALLOC=malloc` none is there."""
_LOOKS = 4


class _Counts(ctypes.Structure):
    """mallinfo2(3)."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks",
                     "fordblks", "keepcost")
    )  # fmt: skip


def in_use_mb() -> float:
    """Of this process, without what a native library keeps for itself."""
    count = ctypes.CDLL(None).mallinfo2
    count.restype = _Counts
    found = count()
    return float(found.uordblks + found.hblkhd + _OF_PYTHON * sys.getallocatedblocks()) / 1e6


def told_into(folder: Path, every_s: float) -> dict[str, str]:
    """Variables by which each process started with them, and its children, tells it in a file of its pid."""
    start = f"from benchmarks.in_use import Path, tell\ntell(Path({str(folder)!r}), {every_s})\n"
    (folder / "sitecustomize.py").write_text(start)  # Python imports it as it starts
    return {"PYTHONPATH": os.pathsep.join((str(folder), str(ROOT)))}


def told(folder: Path, pid: int, since_s: float, until_s: float) -> list[tuple[float, float]]:
    """Seconds since the first of these times of the monotonic clock, and MB; none of what is not Python's."""
    file = folder / f"{pid}.mb"
    lines = [line.split() for line in file.read_text().splitlines()] if file.exists() else []
    every = [(float(at_s), float(used_mb)) for at_s, used_mb in lines]
    return [(at_s - since_s, used_mb) for at_s, used_mb in every if since_s <= at_s < until_s]


def tell(folder: Path, every_s: float) -> None:
    """Begin to, in a thread: each time the least of some looks, at random times.

    Else it would be told what is on its way as well: a reading of many channels has 2 MB, and comes and goes
    as evenly as one looks. Garbage is not searched for, which would hold up the run.
    """

    def keep_telling() -> None:
        with (folder / f"{os.getpid()}.mb").open("w", buffering=1) as file:
            while True:
                least = math.inf
                for _ in range(_LOOKS):
                    time.sleep(every_s / _LOOKS * random.uniform(0.0, 2.0))  # noqa: S311
                    least = min(least, in_use_mb())
                file.write(f"{time.monotonic():.3f} {least:.3f}\n")

    threading.Thread(target=keep_telling, name="memory told", daemon=True).start()
