"""What an emulated instrument really sent: the other side of what a log says, for whoever compares both."""

from __future__ import annotations

import json
import os
from tempfile import mkstemp

TRUTH_FOLDER = "RATTLE_TRUTH"
"""The environment names the folder; without it nothing is kept."""


class Truth:
    """One line of JSON for each thing told, written before it is sent: it outlives the process."""

    def __init__(self, instrument: str) -> None:
        folder = os.environ.get(TRUTH_FOLDER, "")
        self._file = mkstemp(".jsonl", f"{instrument}-", folder)[0] if folder else -1

    @property
    def kept(self) -> bool:
        return self._file >= 0

    def tell(self, **what: object) -> None:
        if self.kept:
            os.write(self._file, json.dumps(what).encode() + b"\n")  # unbuffered: kept if killed

    def close(self) -> None:
        if self.kept:
            os.close(self._file)
        self._file = -1
