"""What reading a file may cost: memory over what was there before, as promised in docs/formats.md."""

from __future__ import annotations

import re
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

MOST_BYTES = 256 << 20
_COUNTED, _USUAL_S = 2_000_000, 0.07


@contextmanager
def bounded(most_bytes: int = MOST_BYTES) -> Iterator[None]:
    """Fail if what is done within asks for more memory; what only seems to be taken counts too.

    Of what packages take by themselves, only what they use counts.
    """
    before = used_bytes()
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < most_bytes, f"{peak >> 20} MiB"
    assert (more := most_used_bytes() - before) < most_bytes, f"{more >> 20} MiB used"


def used_bytes() -> int:
    """What this process uses now, from which on `most_used_bytes` is counted anew."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return most_used_bytes()


def most_used_bytes() -> int:
    found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    return int(found[1]) << 10 if found else 0


def slowness() -> float:
    """How many times as long this processor takes for Python as one of which times are told, 1 at least.

    As it is just now: what runs beside it on the same core makes it slower.
    """
    begun = time.process_time()
    for number in range(_COUNTED):
        _ = number * number
    return max(1.0, (time.process_time() - begun) / _USUAL_S)
