"""Derives in a thread of its own, so that nobody who hands over a block ever waits for it."""

from __future__ import annotations

import queue
import sys
import threading
import traceback
from contextlib import suppress
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.clock import Clock
from daq.errors import RecorderFailed
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from daq.signals.running_figures import warm_up
from rig.derived.sink import DerivedSink, Onward

QUEUE_BLOCKS = 16_384
"""About 13 s of 64 channels, measured and predicted, in blocks of 0.1 s (4 bytes a sample: 330 MB)."""
_LAST_S = 20.0
_IDLE_S = 0.1


class InBackground:
    """A `DerivedSink` behind a queue. The first fault, or a queue that is full, ends it with an event.

    What was recorded does not depend on it: a replay of the log derives all of it.
    """

    def __init__(self, derived: DerivedSink, onward: Onward, clock: Clock) -> None:
        self._derived, self._onward, self._clock = derived, onward, clock
        self._queue: queue.Queue[tuple[Origin, SampleBlock] | None] = queue.Queue(QUEUE_BLOCKS)
        self._thread = threading.Thread(target=self._run, name="derived", daemon=True)
        self._stopped = threading.Event()
        self.high_water = 0

    def __enter__(self) -> InBackground:
        warm_up()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._thread.join(_LAST_S)

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Queue a block; returns at once."""
        if self._stopped.is_set():
            return
        try:
            self._queue.put_nowait((origin, block))
        except queue.Full:
            self._stop("it is slower than the data")
        self.high_water = max(self.high_water, self._queue.qsize())

    def event(self, event: Event) -> None:
        """Nothing follows from an event."""

    def impact(self, impact: Impact) -> None:
        """Nothing follows from an impact."""

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Nothing follows from a shape."""

    def finish(self) -> None:
        """Derive what waits and the end of the record; to be called after the last block of all origins."""
        if self._stopped.is_set():
            return
        try:
            self._queue.put(None, timeout=_LAST_S)
        except queue.Full:
            self._stop("it is slower than the data")
        self._thread.join(_LAST_S)
        if self._thread.is_alive():
            self._stop("it did not come to its end")

    def _run(self) -> None:
        try:
            while not self._stopped.is_set():
                with suppress(queue.Empty):
                    if self._take(self._queue.get(timeout=_IDLE_S)):
                        return
        except RecorderFailed:
            self._stopped.set()  # whoever records hears of it, and stops the rig
        except Exception as error:  # top of a thread: nothing that is derived is worth a run
            traceback.print_exc(file=sys.stderr)
            self._stop(f"{type(error).__name__}: {error}")

    def _take(self, item: tuple[Origin, SampleBlock] | None) -> bool:
        """Derive from a block; True after the last."""
        if item is None:
            self._derived.finish()
            self._stopped.set()
            return True
        self._derived.block(*item)
        return False

    def _stop(self, why: str) -> None:
        self._stopped.set()
        text = f"nothing is derived from here on: {why}; rattle replay derives it"
        with suppress(RecorderFailed):
            self._onward.event(Event(self._clock.unix_ns(), "warning", "derived", "derived.stopped", text))
