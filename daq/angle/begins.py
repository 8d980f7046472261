"""Where cycles begin, as far as it is known by now: what cycles of a drive and turns of a crank share."""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

_PRUNE_FROM, _PRUNE_TO = 8192, 4096
"""Begins that are kept for channels that come later than others: minutes, even of a fast drive."""
END = 1 << 62
"""Past every sample."""


class Begins(NamedTuple):
    """Begins in a stretch of samples: number of the cycle, whether what ends there is a whole cycle.

    All of length m; `offset`, shape (m,), is the sample less the first one of the stretch.
    """

    offset: NDArray[np.int64]
    number: list[int]
    sound: list[bool]


class Cycles(Protocol):
    """Cycles as a reference channel shows them, block by block; the cuts leave no trace."""

    begins: KnownBegins

    def add(self, first_sample: int, values: NDArray[np.floating], usable: bool) -> None:
        """Take the reference channel's next samples, shape (n,); what is between two calls is missing."""
        ...

    def finish(self) -> None:
        """No more samples will come."""
        ...

    def turns_at(self, sample: int) -> float:
        """Turns at a sample that has been seen: cycles counted and the phase in one; NaN if not known."""
        ...


class KnownBegins:
    """Begins in growing order; all before sample `until` are known."""

    def __init__(self) -> None:
        self.until = 0
        self.first_number: int | None = None
        self._samples: list[int] = []
        self._numbers: list[int] = []
        self._sound: list[bool] = []
        self._asked = (0, 0)
        self._answer = Begins(np.empty(0, np.int64), [], [])

    def note(self, sample: int, number: int, sound: bool = True) -> None:
        """Note a begin; one that comes before `until`, too late for others to heed it, is left out."""
        if sample < self.until or (self._samples and sample <= self._samples[-1]):
            return
        if self.first_number is None:
            self.first_number = number
        follows = bool(self._numbers) and number == self._numbers[-1] + 1
        self._samples.append(sample)
        self._numbers.append(number)
        self._sound.append(sound and follows)
        if len(self._samples) > _PRUNE_FROM:
            for row in (self._samples, self._numbers, self._sound):
                del row[:-_PRUNE_TO]

    def between(self, start: int, end: int) -> Begins:
        """Begins from sample `start` to `end` (excluded), which is not beyond `until`."""
        if (start, end) != self._asked:  # the channels of a card come in blocks of the same samples
            low, high = bisect_left(self._samples, start), bisect_left(self._samples, end)
            offset = np.array(self._samples[low:high], dtype=np.int64) - start
            self._asked = start, end
            self._answer = Begins(offset, self._numbers[low:high], self._sound[low:high])
        return self._answer
