"""What the twin's process does: it is fed with the measured drive and gives back predicted blocks.

Alignment and simulation both happen there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rig.stream import Block
from rig.twin.alignment import Alignment, reference_among
from sim_twin.twin import AnyTwin

if TYPE_CHECKING:
    from rig.twin.prediction import AlignedTwin

_ALIGN_ON_S = 1.0
"""Seconds of drive to align on; shorter runs use what they have when they end."""
_KEEP_S = 5.0


@dataclass(frozen=True, slots=True)
class Drive:
    """The measured reference from sample `first_sample` of the card on, as it is logged."""

    first_sample: int
    values: NDArray[np.floating]


@dataclass(frozen=True, slots=True)
class RecordedSpan:
    """Up to which of its samples the record goes by now; the prediction follows it.

    `begin` is the card's sample at which the record begins, `start_ns` its time. `last`: it ends here.
    `turned_off`: whole turns (rad) that the record leaves out of a reference that is an angle.
    """

    begin: int
    end_sample: int
    start_ns: int
    last: bool = False
    turned_off: float = 0.0


@dataclass(frozen=True, slots=True)
class Predict:
    """The task: takes Drive and RecordedSpan, gives Alignment, then Block and Shape.

    The twin keeps step with the measured channel `reference`.
    """

    twin: AnyTwin
    reference: str
    sample_rate: float
    settle_s: float

    def prepare(self) -> None:
        stream = self.twin.model.stream(self.twin, self.sample_rate)
        stream.drive(self.twin.drive)
        stream.advance(64)

    def run(self, items: Iterator[Drive | RecordedSpan], send: Callable[[object], None]) -> None:
        _Prediction(send, self).run(items)


class _Prediction:
    """Collects drive until it can align, then follows the record."""

    def __init__(self, send: Callable[[object], None], task: Predict) -> None:
        twin = task.twin
        self._send, self._twin, self._rate, self._settle_s = send, twin, task.sample_rate, task.settle_s
        self._reference = reference_among(twin.model.channels, (task.reference,), twin)
        cycle_s = 1.0 / twin.drive.cycle_hz
        self._enough_s = max(_ALIGN_ON_S, self._reference.cycles * cycle_s)
        self._drive: list[Drive] = []
        self._aligned: AlignedTwin | None = None

    def run(self, items: Iterator[Drive | RecordedSpan]) -> None:
        for item in items:
            if isinstance(item, RecordedSpan):
                self._follow(item)
                if item.last:
                    return
            elif self._aligned is None:
                self._drive.append(item)
                # of a long settling time the newest seconds do; the rest adds nothing to the alignment
                while (
                    sum(len(each.values) for each in self._drive[1:])
                    > max(_KEEP_S, self._enough_s) * self._rate
                ):
                    del self._drive[0]

    def _follow(self, record: RecordedSpan) -> None:
        taken = sum(len(each.values) for each in self._drive)
        if self._aligned is None and (record.last or taken >= self._enough_s * self._rate):
            from rig.twin.prediction import AlignedTwin

            seen = np.concatenate([each.values for each in self._drive]) if self._drive else np.zeros(0)
            if record.turned_off:
                seen = seen - record.turned_off
            first = self._drive[0].first_sample - record.begin if self._drive else 0
            alignment: Alignment = self._reference.align(seen, self._rate, first, self._twin.drive)
            self._aligned = AlignedTwin(self._twin, alignment, self._rate, self._settle_s)
            self._drive.clear()
            self._send(alignment)
        if self._aligned is None:
            return
        for block in self._aligned.blocks(record.end_sample, record.start_ns):
            self._send(Block("predicted", block))
        if record.end_sample:
            self._send(self._aligned.shape())
