"""Where every block passes: measured or predicted, live or replayed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.log.reader import Origin
from daq.log.records import Event, Impact


class Sink(Protocol):
    """Something that wants blocks: a recorder, a live view. It must not wait."""

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Take a block."""
        ...

    def event(self, event: Event) -> None:
        """Take an event."""
        ...

    def impact(self, impact: Impact) -> None:
        """Take an impact that was found in the blocks."""
        ...

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Take where the twin's rig is (points in m) at a time (s since sample 0)."""
        ...


class Hub:
    """Hands everything to every sink, in the order in which they were given."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self._sinks = tuple(sinks)

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Pass a block on."""
        for sink in self._sinks:
            sink.block(origin, block)

    def event(self, event: Event) -> None:
        """Pass an event on."""
        for sink in self._sinks:
            sink.event(event)

    def impact(self, impact: Impact) -> None:
        """Pass an impact on."""
        for sink in self._sinks:
            sink.impact(impact)

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Pass a shape on."""
        for sink in self._sinks:
            sink.shape(time_s, points)
