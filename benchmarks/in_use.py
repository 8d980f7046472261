"""What a process has asked Python and glibc for and not given back, by itself or told from all of a run's.

The resident memory of a process moves by what a stall has left behind in it, tens of MB; this does not.
"""

from __future__ import annotations

import ctypes
import gc
import os
import threading
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
BY_MALLOC = {"PYTHONMALLOC": "malloc", "MALLOC_ARENA_MAX": "1"}
"""So that it is counted in one place, but for what a native library keeps for itself."""
_STARTED_S = 30.0


class _Counts(ctypes.Structure):
    """mallinfo2(3)."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks",
                     "fordblks", "keepcost")
    )  # fmt: skip


def in_use_mb() -> float:
    """Of this process; under the variables of `BY_MALLOC`."""
    gc.collect()
    count = ctypes.CDLL(None).mallinfo2
    count.restype = _Counts
    found = count()
    return float(found.uordblks + found.hblkhd) / 1e6


def told_into(folder: Path, every_s: float) -> dict[str, str]:
    """Variables by which each process started with them, and its children, tells it in a file of its pid."""
    start = f"from benchmarks.in_use import Path, tell\ntell(Path({str(folder)!r}), {every_s})\n"
    (folder / "sitecustomize.py").write_text(start)  # Python imports it as it starts
    return {**BY_MALLOC, "PYTHONPATH": os.pathsep.join((str(folder), str(ROOT)))}


def told(folder: Path, pid: int, since_s: float, until_s: float) -> list[float]:
    """MB, between these times of the monotonic clock; nothing of a process that is none of Python's."""
    file = folder / f"{pid}.mb"
    lines = [line.split() for line in file.read_text().splitlines()] if file.exists() else []
    return [float(used_mb) for at_s, used_mb in lines if since_s <= float(at_s) < until_s]


def tell(folder: Path, every_s: float) -> None:
    """Begin to, in a thread; what there is by then is not searched each time, which would take 0.4 s."""

    def keep_telling() -> None:
        time.sleep(_STARTED_S)
        gc.freeze()
        with (folder / f"{os.getpid()}.mb").open("w", buffering=1) as file:
            while True:
                time.sleep(every_s)
                file.write(f"{time.monotonic():.3f} {in_use_mb():.3f}\n")

    threading.Thread(target=keep_telling, name="memory told", daemon=True).start()
