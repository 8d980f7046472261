"""What a file of any program holds: columns that say what they know of themselves, and not more; and what a
format is to the rest of rattle."""

from __future__ import annotations

import csv
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from lzma import LZMAError
from pathlib import Path
from tokenize import TokenError
from typing import IO, BinaryIO
from zipfile import BadZipFile

import numpy as np
import pyarrow as pa
from scipy.io.matlab import MatReadError

from daq.allowance import MOST_COLUMNS
from daq.block import is_rate
from daq.errors import DAMAGED, LogError, RattleError
from daq.formats.description import Described, Description
from daq.formats.recording import Recording, Stretch
from daq.formats.samples import CHUNK, Pieces, Samples, Scratch
from daq.log.reader import Origin

_OWN_ERRORS = (TypeError, AttributeError, AssertionError, SyntaxError, struct.error, *DAMAGED)
_FOREIGN_ERRORS = (BadZipFile, TokenError, LZMAError, zlib.error, csv.Error, pa.ArrowException, MatReadError)
"""What the TDMS, MAT, Parquet, CSV and NumPy packages raise on damaged input."""
Warn = Callable[[str], None]
_LARGEST_DEVIATION = 0.1
"""Of a sample interval; a time column that a program rounded stays within, a lost sample does not."""
RATE_NAMES = ("sample_rate", "samplerate", "fs")
TIME_NAMES = ("time", "t", "time_s")
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""What other programs call the rate and the column of times, in lower case; its units, in s."""


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn what a package raises on a damaged file into LogError with the file's name."""
    try:
        yield
    except LogError as error:
        named = str(error).startswith(f"{path}: ")
        raise LogError(str(error) if named else f"{path}: {error}") from error
    except FileNotFoundError as error:
        raise LogError(f"{path}: {error.strerror}") from error
    except Exception as error:
        # nptdms raises at times what has no class of its own
        known = isinstance(error, (*_OWN_ERRORS, *_FOREIGN_ERRORS)) or type(error) is Exception
        if isinstance(error, RattleError) or not known:
            raise
        reason = " ".join(str(error).split())[:200]
        kind = "" if isinstance(error, pa.ArrowException) else f"{type(error).__name__}: "
        raise LogError(f"{path}: cannot be read ({kind}{reason})") from error


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """A file for reading; whatever goes wrong with it becomes LogError."""
    with readable(path), path.open("rb") as file:
        yield file


def exists_already(path: Path) -> RattleError:
    """What to raise rather than write over a file."""
    return RattleError(f"{path} exists already; name another file")


@contextmanager
def new_file(path: Path) -> Iterator[IO[bytes]]:
    """Create a file, never over another, and remove it again if it is not completed; raises RattleError."""
    try:
        file = path.open("xb")
    except FileExistsError as error:
        raise exists_already(path) from error
    except OSError as error:
        raise RattleError(f"cannot create {path}: {error.strerror}") from error
    try:
        with file:
            yield file
    except BaseException as error:
        path.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, RattleError):
            raise RattleError(f"cannot write {path}: {error.strerror or error}") from error
        raise


@dataclass(frozen=True, slots=True)
class StatedRate:
    """A sample rate as a file states it: `likeliest`, but `low` to `high` Hz, for text has few digits."""

    low: float
    likeliest: float
    high: float

    def allows(self, sample_rate: float) -> bool:
        """True if the file may mean this rate."""
        return self.low <= sample_rate <= self.high

    def is_sure_over(self, count: int) -> bool:
        """True if after `count` samples nobody can be half a sample off."""
        return (self.high - self.low) / 2 * count < self.likeliest / 2

    @classmethod
    def exactly(cls, sample_rate: float) -> StatedRate:
        """A rate written in full; raises LogError if it is no rate."""
        _check(sample_rate, "sample rate")
        return cls(sample_rate, sample_rate, sample_rate)

    @classmethod
    def of_increment(cls, increment: float, half_unit: float) -> StatedRate:
        """From the time between samples in s, true to `half_unit`; raises LogError if it is none."""
        _check(increment - half_unit, "time between samples")
        return cls(1 / (increment + half_unit), 1 / increment, 1 / (increment - half_unit))


def _check(value: float, what: str) -> None:
    if not is_rate(value):
        raise LogError(f"{value:g} is no {what}")


@dataclass(frozen=True, slots=True)
class Column:
    """One channel as a file gives it; None is what the file does not say.

    `stretches` are there only if rattle wrote the file: then they say everything about time. Else `start_ns`
    is the time of the first sample, or `start_s` its seconds on a time axis without a date. `details` are the
    metadata of the channel but for its unit.
    """

    name: str
    samples: Samples
    origin: Origin = "measured"
    unit: str | None = None
    rate: StatedRate | None = None
    start_ns: int | None = None
    start_s: float = 0.0
    stretches: tuple[Stretch, ...] | None = None
    details: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Contents:
    """A file's columns, what else it says of the run, and `notes` on what was left out or assumed."""

    columns: tuple[Column, ...]
    rest: Recording = field(default_factory=lambda: Recording(()))
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        if len(self.columns) > MOST_COLUMNS:
            raise LogError(f"{len(self.columns)} channels are more than the {MOST_COLUMNS} that are read")


def described_column(described: Described, samples: Samples) -> Column:
    """A column of a file that rattle wrote."""
    metadata = described.channel.metadata()
    unit = metadata.pop("unit")
    return Column(
        described.channel.name,
        samples,
        described.origin,
        unit,
        stretches=described.stretches,
        details=metadata,
    )


def described_contents(description: Description, found: Mapping[str, Samples]) -> Contents:
    """Columns of a file that rattle wrote, `found` by `Track.name`; raises LogError if one is not there."""
    missing = [track.name for track in description.tracks if track.stretches and track.name not in found]
    if missing:
        raise LogError(f"its description names {', '.join(missing)}, which it does not hold")
    columns = [described_column(track, found.get(track.name) or Pieces(())) for track in description.tracks]
    return Contents(tuple(columns), description.rest)


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """What a column of times comes to: the rate, and the time of the first sample on that axis."""

    rate: StatedRate | None
    start_s: float


def time_axis(times: Samples, seconds: float = 1.0) -> TimeAxis:
    """Read a column of times, in units of `seconds`; raises LogError if they do not run evenly.

    One time alone has no rate. The rate is as sure as a tenth of a sample at either end allows.
    """
    count = len(times)
    if not count:
        raise LogError("its time column is empty")
    first, last = (float(times.read(at, at + 1)[0]) * seconds for at in (0, count - 1))
    if not math.isfinite(first) or not math.isfinite(last):
        raise LogError("its time column begins or ends with what is no number")
    if count == 1:
        return TimeAxis(None, first)
    if last <= first:
        raise LogError(f"its time column runs from {first:g} s to {last:g} s: not forward")
    interval = (last - first) / (count - 1)
    for start in range(0, count, CHUNK):
        values = times.read(start, min(start + CHUNK, count))
        steps = (values.astype(np.float64) * seconds - first) / interval - np.arange(
            start, start + len(values)
        )
        wrong = np.flatnonzero(~(np.abs(steps) <= _LARGEST_DEVIATION))
        if len(wrong):
            raise LogError(
                f"its time column is not even: row {start + int(wrong[0]) + 1} is"
                f" {steps[wrong[0]]:.3g} intervals off, where {_LARGEST_DEVIATION} may come from rounding"
            )
    uncertain = interval * 2 * _LARGEST_DEVIATION / (count - 1)
    return TimeAxis(StatedRate.of_increment(interval, uncertain), first)


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
    one_rate: bool = False
    """Whether a file of it is a table, which holds channels of one rate."""
