"""What may come of a file that anybody may have written: as much as of an honest one, and no more.

Reading is paid for in bytes. One that is unpacked costs one, one that is held in memory `_HELD`, and of those
that are only passed on `_PASSED` cost one; a record, however short, costs what an object takes. A file pays
256 MiB and 256 times its size. An hour of 64 channels needs twice its size; of zeros, which a twin at rest
gives, near a thousand times, passed on.
"""

from __future__ import annotations

import os
from pathlib import Path

from daq.errors import LogError

_FREE_BYTES = 256 << 20
_BYTES_A_BYTE = 256
_HELD = 4
_PASSED = 8
_RECORD = 1 << 10
MOST_DESCRIPTION_BYTES = 16 << 20
"""Channels, metadata: as objects they take ten times as much."""
MOST_COLUMNS = 4096


class Allowance:
    """What one pass over an open file may still take."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._left = _FREE_BYTES + _BYTES_A_BYTE * os.fstat(descriptor).st_size

    def spend(self, unpacked: int = 0, held: int = 0, records: int = 0, passed: int = 0) -> None:
        """To be called before the bytes are there; raises LogError, from then on always."""
        self._left -= unpacked + _HELD * held + _RECORD * records + passed // _PASSED
        if self._left < 0:
            raise LogError(f"{self._path}: more would come of it than of any honest recording of its size")
