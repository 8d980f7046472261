"""Derives in a process of its own, so that nobody who hands over a block ever waits for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.block import SampleBlock
from daq.clock import Clock
from daq.errors import RecorderFailed
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from daq.signals.running_figures import warm_up
from rig.derived.sink import DerivedSink, Note, Onward
from rig.files.scenario import Scenario
from rig.worker_process import QUEUE_ITEMS, WorkerFailed, WorkerProcess

_LAST_S = 30.0
"""The fullest queue is worked off in that time, by a worker that is half as fast as the data."""


@dataclass(frozen=True, slots=True)
class _Settled:
    """A metadata record: what everything else was derived by."""

    name: str
    record: dict[str, str]


@dataclass(frozen=True, slots=True)
class Derive:
    """The task: takes blocks with their origins, gives blocks, impacts and metadata records."""

    channels: Mapping[Origin, tuple[str, ...]]
    scenario: Scenario

    def prepare(self) -> None:
        """Compile."""
        warm_up()

    def run(self, items: Iterator[tuple[Origin, SampleBlock]], send: Callable[[object], None]) -> None:
        """Derive from all that comes and, once that ends, what waits for more."""
        note: Note = lambda name, record: send(_Settled(name, dict(record)))  # noqa: E731
        derived = DerivedSink(_Sent(send), self.channels, self.scenario, note=note)
        for origin, block in items:
            derived.block(origin, block)
        derived.finish()


class _Sent:
    """Sends what is derived."""

    def __init__(self, send: Callable[[object], None]) -> None:
        self._send = send

    def block(self, origin: Origin, block: SampleBlock) -> None:
        self._send(block)

    def impact(self, impact: Impact) -> None:
        self._send(impact)


class InBackground:
    """A sink whose blocks go to a process that derives; `deliver_to` says who gets what that finds.

    `worker` is a context of its own. A fault, or a queue that is full, ends it, and `events` tells. What was
    recorded does not depend on it: a replay of the log derives all of it.
    """

    def __init__(
        self,
        channels: Mapping[Origin, tuple[str, ...]],
        scenario: Scenario,
        clock: Clock,
        queue_blocks: int = QUEUE_ITEMS,
    ) -> None:
        self._clock = clock
        self._onward: Onward | None = None
        self._note: Note = lambda name, record: None
        self._told = False
        task = Derive(channels, scenario)
        self.worker = WorkerProcess("derivation", task, self._deliver, queue_blocks)

    def deliver_to(self, onward: Onward, note: Note) -> None:
        """Say who gets what is derived, and who the metadata record; to be called before the first block."""
        self._onward, self._note = onward, note

    def wait_ready(self, check: Callable[[], None]) -> None:
        """Wait until it is compiled, or has failed at that; raises what `check` raises meanwhile."""
        with suppress(WorkerFailed):
            self.worker.wait_ready(check)

    def block(self, origin: Origin, block: SampleBlock) -> None:
        """Hand a block over; returns at once."""
        self.worker.give((origin, block))

    def event(self, event: Event) -> None:
        """Nothing follows from an event."""

    def impact(self, impact: Impact) -> None:
        """Nothing follows from an impact."""

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Nothing follows from a shape."""

    def finish(self, tell: Callable[[Event], None], check: Callable[[], None] = lambda: None) -> None:
        """Derive what waits and the end of the record; `tell` hears what `events` has not told.

        To be called after the last block of all origins. Raises what `check` raises meanwhile, and then
        derives no more. A second call waits for nothing; it tells what is still to be told.
        """
        try:
            with suppress(WorkerFailed):
                self.worker.finish(_LAST_S, check)
        finally:
            self.worker.close()
        for event in self.events():
            with suppress(RecorderFailed):  # that is what ends the run
                tell(event)

    def events(self) -> tuple[Event, ...]:
        """Once, that nothing more is derived; nothing while all is well."""
        why = self.worker.error
        if not why or self._told:
            return ()
        self._told = True
        text = f"nothing is derived from here on: {why}; rattle replay derives it"
        return (Event(self._clock.unix_ns(), "warning", "derived", "derived.stopped", text),)

    def _deliver(self, found: Any) -> None:
        """In the worker's thread."""
        onward = self._onward
        if onward is None:
            return
        with suppress(RecorderFailed):  # whoever records hears of it, and stops the rig
            if isinstance(found, _Settled):
                self._note(found.name, found.record)
            elif isinstance(found, SampleBlock):
                onward.block("derived", found)
            else:
                onward.impact(found)
