"""What reading a file may cost: memory over what was there before, as promised in docs/formats.md."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

MOST_BYTES = 256 << 20


@contextmanager
def bounded(most_bytes: int = MOST_BYTES) -> Iterator[None]:
    """Fail if what is done within asks for more memory; what only seems to be taken counts too."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < most_bytes, f"{peak >> 20} MiB"
