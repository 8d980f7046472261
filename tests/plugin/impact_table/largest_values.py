"""A file format that this package adds to the exports: a line for each channel with its largest magnitude."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.errors import LogError
from daq.formats.contents import Contents, FileFormat, Warn
from daq.formats.recording import Recording
from daq.formats.samples import Scratch


def read(path: Path, scratch: Scratch) -> Contents:
    raise LogError(f"{path}: it holds no samples")


def write(recording: Recording, path: Path, warn: Warn) -> tuple[Path, ...]:
    lines = [
        f"{track.origin} {track.channel.name} {np.nanmax(np.abs(track.samples.read(0, len(track.samples))))}"
        for track in recording.tracks
        if len(track.samples)
    ]
    path.write_text("\n".join(lines) + "\n")
    return (path,)


FORMAT = FileFormat("largest_values", (".largest",), read, write)
