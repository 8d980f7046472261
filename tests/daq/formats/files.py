"""Files read and written by their ending, and the signal that other programs put into theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.formats import format_of
from daq.formats.contents import Column, Contents
from daq.formats.recording import Recording
from daq.formats.samples import Scratch

RATE, COUNT = 51_200.0, 4000
SINE = np.sin(2 * np.pi * 50 * np.arange(COUNT) / RATE)


def read(path: Path, scratch: Scratch) -> Contents:
    return format_of(path).read(path, scratch)


def only(path: Path, scratch: Scratch) -> Column:
    (column,) = read(path, scratch).columns
    return column


def export(recording: Recording, path: Path) -> None:
    write = format_of(path).write
    assert write is not None
    write(recording, path, lambda _: None)
