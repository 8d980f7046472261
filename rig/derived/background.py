"""Derives in a process of its own, so that nobody who hands over a block ever waits for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from daq.clock import Clock
from daq.errors import RecorderFailed
from daq.log.reader import Origin
from daq.log.records import Event
from rig.files.scenario import Scenario
from rig.stream import Block, Consumer, Record
from rig.worker_process import QUEUE_ITEMS, WorkerFailed, WorkerProcess

_LAST_S = 30.0
"""The fullest queue is worked off in that time, by a worker that is half as fast as the data."""


@dataclass(frozen=True, slots=True)
class Derive:
    """The task: takes blocks, gives blocks, impacts and metadata."""

    channels: Mapping[Origin, tuple[str, ...]]
    scenario: Scenario

    def prepare(self) -> None:
        """Compile."""
        from daq.signals.running_figures import warm_up

        warm_up()

    def run(self, blocks: Iterator[Block], send: Callable[[object], None]) -> None:
        """Derive from all that comes and, once that ends, what waits for more."""
        from rig.derived.derivation import Derivation

        derivation = Derivation(send, self.channels, self.scenario)
        for block in blocks:
            derivation(block)
        derivation.finish()


class DerivationProcess:
    """A consumer whose blocks go to a process that derives; `publish` gets what that finds.

    `worker` is a context of its own. A fault, or a queue that is full, ends it, and `events` tells. What was
    recorded does not depend on it: a replay of the log derives all of it.
    """

    def __init__(
        self,
        channels: Mapping[Origin, tuple[str, ...]],
        scenario: Scenario,
        clock: Clock,
        publish: Consumer,
        queue_blocks: int = QUEUE_ITEMS,
    ) -> None:
        self._origins = tuple(channels)
        self._clock, self._publish = clock, publish
        self._told = False
        self.worker = WorkerProcess("derivation", Derive(channels, scenario), self._deliver, queue_blocks)

    def wait_ready(self, check: Callable[[], None]) -> None:
        """Wait until it is compiled, or has failed at that; raises what `check` raises meanwhile."""
        with suppress(WorkerFailed):
            self.worker.wait_ready(check)

    def __call__(self, record: Record) -> None:
        if isinstance(record, Block) and record.origin in self._origins:
            self.worker.give(record)

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

    def _deliver(self, found: Record) -> None:
        """In the worker's thread."""
        with suppress(RecorderFailed):  # whoever records hears of it, and stops the rig
            self._publish(found)
