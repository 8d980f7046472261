"""Results of a benchmark that is done in parts: each is a file, and those of one program add up."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grimp

from benchmarks.blind.command import ROOT
from daq.disk import make_folder, write_whole

_DIGITS = 12
_PACKAGES = ("daq", "drivers", "rig", "sim_twin", "benchmarks.blind")
TRUTHS = tuple(
    f"benchmarks.blind.{part}" for part in ("beam", "crank", "spatial", "logs", "operating_points")
)
"""What recordings of the truth engines hang on."""


def commit() -> str:
    """The commit of this checkout, with "+" behind it where tracked files differ; "unknown" without git."""
    try:
        head, changed = (
            _git(*arguments) for arguments in (("rev-parse", "HEAD"), ("diff", "--name-only", "HEAD"))
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head + ("+" if changed else "")


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603, S607 - our own
    return done.stdout.strip()


def made_by(modules: Iterable[str], files: Iterable[str] = ()) -> str:
    """A digest of the sources of modules, or packages, with all of ours that they import, and of files.

    So that a change of what a result does not hang on costs it nothing. What is imported by its name in a
    table has to be named.
    """
    graph, needed = grimp.build_graph(*_PACKAGES, cache_dir=None), set[str]()
    for each in (one for module in modules for one in (module, *graph.find_descendants(module))):
        needed |= {each, *graph.find_upstream_modules(each)}
    sources = [(name, _source(name).read_bytes()) for name in sorted(needed)]
    digest = hashlib.sha256(repr(sources).encode())
    for file in files:
        digest.update((ROOT / file).read_bytes())
    return digest.hexdigest()[:_DIGITS]


def _source(module: str) -> Path:
    path = ROOT / module.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


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

    def others(self, pattern: str) -> int:
        """How many results with names of a pattern lie there that other programs made."""
        every = self.folder.glob(f"{pattern}_{'?' * _DIGITS}.json")
        return sum(file.stem[-_DIGITS:] != self.digest for file in every)

    def keep(self, name: str, found: Mapping[str, Any]) -> None:
        make_folder(self.folder)
        content = {"commit": commit(), "digest": self.digest, **found}
        write_whole(self._file(name), (json.dumps(content, indent=1) + "\n").encode())

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}_{self.digest}.json"
