"""Results of a benchmark that is done in parts: each is a file, and those of one program add up."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.blind.command import ROOT
from benchmarks.blind.seal import commit
from daq.disk import make_folder, write_whole
from rig.diagnosis.kept import sources_of

_DIGITS = 12


def made_by(*packages: str) -> str:
    """A digest of the sources of packages, each a folder of this project."""
    sources = [sources_of(str(ROOT / package / "__init__.py")) for package in packages]
    return hashlib.sha256("\n".join(sources).encode()).hexdigest()[:_DIGITS]


@dataclass(frozen=True, slots=True)
class Results:
    """Results of the program with a `digest`, in `folder`, where those of others may lie beside them."""

    folder: Path
    digest: str

    def found(self, name: str) -> dict[str, Any] | None:
        file = self._file(name)
        return json.loads(file.read_text()) if file.exists() else None

    def every(self, pattern: str) -> list[dict[str, Any]]:
        """Those with names of a pattern, such as `beam_*`."""
        return [json.loads(file.read_text()) for file in sorted(self.folder.glob(self._file(pattern).name))]

    def others(self) -> int:
        """How many results lie there that other programs made."""
        own, every = (len(list(self.folder.glob(f"*{end}.json"))) for end in (f"_{self.digest}", ""))
        return every - own

    def keep(self, name: str, found: Mapping[str, Any]) -> None:
        make_folder(self.folder)
        content = {"commit": commit(), "digest": self.digest, **found}
        write_whole(self._file(name), (json.dumps(content, indent=1) + "\n").encode())

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}_{self.digest}.json"
