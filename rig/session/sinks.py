"""The sinks of a run: the log and the live view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from daq.recorder import Recorder
from rig.live.view import LiveView


class LogSink:
    """Everything but the shape goes to the log."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Record a block."""
        self._recorder.block(origin, block)

    def event(self, event: Event) -> None:
        """Record an event."""
        self._recorder.event(event)

    def impact(self, impact: Impact) -> None:
        """Record an impact."""
        self._recorder.impact(impact)

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Not recorded: the log holds what was measured and its prediction."""


class ViewSink:
    """Everything is offered to the view, which may drop it."""

    def __init__(self, view: LiveView) -> None:
        self._view = view

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Offer a block."""
        self._view.offer(origin, block)

    def event(self, event: Event) -> None:
        """Offer an event."""
        self._view.offer_event(event)

    def impact(self, impact: Impact) -> None:
        """Offer an impact."""
        self._view.offer_impact(impact)

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Offer where the twin's rig is."""
        self._view.offer_shape(time_s, points)
