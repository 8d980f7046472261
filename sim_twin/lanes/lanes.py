"""Many lanes in motion together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.lanes import kernel
from sim_twin.lanes.coefficients import Coefficients, coefficients
from sim_twin.lanes.lane import Lane
from sim_twin.status import Status
from sim_twin.vector import LANES, aligned

Array = NDArray[np.float64]
_AT_ONCE = 16 * 1024
"""Bytes of coefficients and motion that are stepped together; they have to stay in the first cache."""
_FAR = 1.0
"""m; no gap opens so far."""


class Lanes:
    """Runs of `lanes` side by side, each from its own start at t = 0, sampled every `step` s.

    A lane's numbers are the same bits in whatever company it runs.
    """

    def __init__(self, lanes: Sequence[Lane], step: float) -> None:
        self.step = step
        self._blocks = _blocks(lanes, step)
        self._rows = max((0 if lane.accelerations is None else len(lane.accelerations)) for lane in lanes)
        self._statuses = [Status.COMPLETED] * len(lanes)

    @property
    def statuses(self) -> tuple[Status, ...]:
        """How each lane is doing: COMPLETED, or DIVERGED from then on."""
        return tuple(self._statuses)

    def advance(self, steps: int) -> Array:
        """Return the next `steps` samples, shape (lanes, 1 + rows, steps), the first ones at t = 0.

        Row 0 is the upper minus the lower contact force in N (never both touch), then come the accelerations.
        A lane that has diverged gives NaN from the call on in which it did.
        """
        out = np.zeros((len(self._statuses), 1 + self._rows, steps))
        for block in self._blocks:
            block.advance(out)
            for lane in block.diverged():
                self._statuses[lane] = Status.DIVERGED
        for index in np.flatnonzero(~np.isfinite(out).all(axis=(1, 2))):
            self._statuses[index] = Status.DIVERGED
        out[[status is Status.DIVERGED for status in self._statuses]] = np.nan
        return out


class _Block:
    """Lanes of one kind, in groups of eight; the last group is filled up with copies of its first lane."""

    def __init__(self, lanes: Sequence[int], parts: Sequence[Coefficients], hertzian: bool) -> None:
        groups = -(-len(parts) // LANES)
        padding = groups * LANES - len(parts)
        self._place = np.array([*lanes, *[-1] * padding], dtype=np.int64)
        self._slot, self._row, self._row_gain, self._number, self._state, self._scalar = (
            _in_groups(each) for each in zip(*parts, *[parts[0]] * padding, strict=True)
        )
        self._hertzian = hertzian
        at_once = max(1, _AT_ONCE // (self._slot[0].nbytes + self._row[0].nbytes + self._state[0].nbytes))
        rows = self._row.shape[1]
        self._buffer = aligned((min(at_once, groups), 1 + rows, kernel.CHUNK, LANES))

    def advance(self, out: Array) -> None:
        # None, not an empty array: the kernel compiled without the recording is 10 % faster.
        row, row_gain = (self._row, self._row_gain) if self._row.shape[1] else (None, None)
        kernel.advance(
            self._slot, row, row_gain, self._number, self._state, self._scalar, self._buffer, self._place,
            self._hertzian, out,
        )  # fmt: skip

    def diverged(self) -> list[int]:
        far = ~(np.abs(self._scalar[:, kernel.GAP]) < _FAR).ravel()
        return [int(lane) for lane in self._place[far] if lane >= 0]


def _blocks(lanes: Sequence[Lane], step: float) -> list[_Block]:
    kinds: dict[tuple[object, ...], list[int]] = {}
    parts = [coefficients(lane, step) for lane in lanes]
    for index, (lane, part) in enumerate(zip(lanes, parts, strict=True)):
        kind = (part.slot.shape, len(part.row), lane.stops.hertz is not None)
        kinds.setdefault(kind, []).append(index)
    return [
        _Block(members, [parts[index] for index in members], bool(kind[-1]))
        for kind, members in kinds.items()
    ]


def _in_groups(each: Sequence[Array]) -> Array:
    """Lanes last, in groups of eight: shape (groups, ..., 8)."""
    shape = each[0].shape
    made = aligned((len(each) // LANES, *shape, LANES))
    made[:] = np.moveaxis(np.reshape(each, (len(each) // LANES, LANES, *shape)), 1, -1)
    return made
