"""What a file format is to the rest of rattle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from daq.formats.contents import Contents
from daq.formats.recording import Recording
from daq.formats.samples import Scratch

Warn = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class FileFormat:
    """A format: the name that `--to` takes, the endings of its files, how to read one and how to write.

    `read` raises LogError for what it cannot read; its samples may stay in the file, which `Scratch` then
    holds open. `write` makes the file, or several beside it where one cannot hold several rates, never over
    another, says through `warn` what the format cannot hold, and raises RattleError; None: rattle only reads.
    """

    name: str
    suffixes: tuple[str, ...]
    read: Callable[[Path, Scratch], Contents]
    write: Callable[[Recording, Path, Warn], tuple[Path, ...]] | None = None
