"""Samples of one channel that need not be in memory: in an array, in a scratch file, with gaps, scaled."""

from __future__ import annotations

import os
import tempfile
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from daq.errors import LogError, RattleError


class _Closable(Protocol):
    def close(self) -> None: ...


Held = TypeVar("Held", bound=_Closable)
CHUNK = 1 << 18
"""Samples that are held at once: 1 MB of float32."""
_COLUMNS_OF_CHUNKS = 64
_ARRAY = 1 << 6
"""Samples of which an array takes the memory, however short it is."""
MOST_SAMPLES = 1 << 29
"""Near three hours at 51.2 kHz; a damaged or hostile sample index must not fill the disk."""


class Samples(Protocol):
    """Numbers that can be read piece by piece."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Precision: float32 or float64."""

    def __len__(self) -> int: ...

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        """Samples `start` to `stop`, shape (stop - start,); raises LogError if the file does not."""


def precision(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """float32 where it holds every value of `dtype`, else float64; raises LogError for what is no number."""
    if dtype.kind not in "fiub":
        raise LogError(f"values of type {dtype} are no samples")
    return np.dtype("<f4") if np.can_cast(dtype, np.float32, "safe") else np.dtype("<f8")


def chunks(samples: Samples) -> Iterator[NDArray[np.floating]]:
    """All samples in arrays of at most `CHUNK`."""
    for start in range(0, len(samples), CHUNK):
        yield samples.read(start, min(start + CHUNK, len(samples)))


@dataclass(frozen=True, slots=True)
class Spooled:
    """`count` samples at byte `offset` of an open file."""

    file: int
    offset: int
    count: int
    dtype: np.dtype[Any]

    def __len__(self) -> int:
        return self.count

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        """Read from the file, in the byte order of this machine."""
        size = self.dtype.itemsize
        data = os.pread(self.file, (stop - start) * size, self.offset + start * size)
        if len(data) != (stop - start) * size:
            raise LogError(f"the file ends within its samples ({len(data) // size} of {stop - start})")
        return np.frombuffer(data, self.dtype).astype(self.dtype.newbyteorder("="), copy=False)


class Pieces:
    """Samples put together from pieces, each at its index; NaN where no piece is.

    `pieces` are (index of the first sample, samples) in order, the first of them at 0. Raises LogError if
    they overlap, or span more than `MOST_SAMPLES`.
    """

    def __init__(self, pieces: Sequence[tuple[int, Samples]]) -> None:
        self._pieces = tuple(piece for piece in pieces if len(piece[1]))
        self._starts = [start for start, _ in self._pieces]
        ends = [start + len(samples) for start, samples in self._pieces]
        if any(end > start for end, start in zip(ends, self._starts[1:], strict=False)):
            raise LogError("samples come twice")
        self._length = ends[-1] if ends else 0
        if self._length > MOST_SAMPLES:
            raise LogError(f"spans {self._length} samples, which is more than a record can have")
        self.dtype = np.result_type(*(samples.dtype for _, samples in self._pieces), np.float32)

    def __len__(self) -> int:
        return self._length

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        """Read from all pieces that lie there."""
        values = np.full(stop - start, np.nan, self.dtype)
        for begin, samples in self._pieces[max(bisect_right(self._starts, start) - 1, 0) :]:
            if begin >= stop:
                break
            low, high = max(start, begin), min(stop, begin + len(samples))
            if low < high:
                values[low - start : high - start] = samples.read(low - begin, high - begin)
        return values


@dataclass(frozen=True, slots=True)
class Window:
    """Part of other samples."""

    samples: Samples
    start: int
    stop: int

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.samples.dtype

    def __len__(self) -> int:
        return self.stop - self.start

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        return self.samples.read(self.start + start, self.start + stop)


@dataclass(frozen=True, slots=True)
class Scaled:
    """Samples times a factor, computed in float64 and kept in their own precision."""

    samples: Samples
    factor: float

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.samples.dtype

    def __len__(self) -> int:
        return len(self.samples)

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        values = self.samples.read(start, stop)
        with np.errstate(over="ignore", invalid="ignore"):
            return (values.astype(np.float64) * self.factor).astype(values.dtype)


class Scratch:
    """A nameless file beside the target that keeps samples while they are put into another order.

    As large as the samples are; it lies beside the target, for a temporary folder is often in memory.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._size = self._columns = 0
        self._held = ExitStack()

    def __enter__(self) -> Scratch:
        try:
            self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)
        except OSError as error:
            raise RattleError(f"cannot write to {self._folder}: {error.strerror}") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._held.close()
        self._file.close()

    def hold(self, file: Held) -> Held:
        """Keep a file or anything else with a `close` until the samples in it are no longer needed."""
        self._held.callback(file.close)
        return file

    def keep(self, values: NDArray[Any]) -> Spooled:
        """Append numbers of shape (n,) as float32 or float64; raises RattleError if the disk is full."""
        spooled = Spooled(self._file.fileno(), self._size, len(values), precision(values.dtype))
        try:
            for start in range(0, len(values), CHUNK):
                data = memoryview(values[start : start + CHUNK].astype(spooled.dtype).tobytes())
                self._size += len(data)
                while data:
                    data = data[self._file.write(data) :]
        except OSError as error:
            raise RattleError(f"cannot write to {self._folder}: {error.strerror}") from error
        return spooled

    def column(self) -> ScratchColumn:
        """Return a channel whose samples come little by little."""
        self._columns += 1
        return ScratchColumn(self)

    @property
    def patience(self) -> int:
        """Samples that a column may hold before it writes them: together 128 MB at the most."""
        return max(_COLUMNS_OF_CHUNKS * CHUNK // max(self._columns, _COLUMNS_OF_CHUNKS), _ARRAY)


class ScratchColumn:
    """Collects the samples of one channel in scratch."""

    def __init__(self, scratch: Scratch) -> None:
        self._scratch = scratch
        self._waiting: list[NDArray[Any]] = []
        self._waiting_count = self._kept_count = 0
        self._pieces: list[tuple[int, Samples]] = []

    def __len__(self) -> int:
        return self._kept_count + self._waiting_count

    def add(self, values: NDArray[Any]) -> None:
        """Append samples, shape (n,)."""
        if not len(values):
            return
        self._waiting.append(values)
        self._waiting_count += len(values)
        if self._waiting_count + _ARRAY * len(self._waiting) >= self._scratch.patience:
            self._flush()

    def skip(self, count: int) -> None:
        """Leave a gap of `count` samples."""
        self._flush()
        self._kept_count += count

    def samples(self) -> Samples:
        self._flush()
        return Pieces(self._pieces)

    def _flush(self) -> None:
        if self._waiting:
            self._pieces.append((self._kept_count, self._scratch.keep(np.concatenate(self._waiting))))
        self._kept_count += self._waiting_count
        self._waiting, self._waiting_count = [], 0
