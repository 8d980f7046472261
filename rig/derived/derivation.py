"""What follows from the records of a stream, which channels that makes, and who derives in a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from daq.channel import Channel
from daq.clock import Clock
from daq.errors import ConfigurationError, LogError, RecorderFailed
from daq.log.reader import CRANK_SPEED, CYCLE_PEAK, CYCLE_RMS, LogReader, Origin, derived_name
from daq.log.records import Event, Impact
from rig.derived.settings import (
    RECORD,
    STOPPED,
    Settings,
    as_record,
    from_record,
    has_figures,
    nominal_of,
    reference_of,
    role_of,
    says_impacts,
)
from rig.files.scenario import Scenario
from rig.rigs import RIGS
from rig.stream import Block, Consumer, Metadata, Record
from rig.twin.alignment import AS_USUAL, Mounting
from rig.worker_process import QUEUE_ITEMS, Crew, WorkerFailed, WorkerProcess
from sim_twin.rigs.channel_table import Role

ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")


class Derivation:
    """Derives each origin by itself, in the thread that brings the blocks; one thread at a time.

    `channels` are those of each origin. `known` is what a log says was settled when it was recorded; what it
    does not say is settled by the rule, and published as a metadata record. `mounting` is that of what shows
    the cycles. `spend` hears what is kept of a file that anybody may have written (`daq.allowance`).
    """

    def __init__(
        self,
        publish: Consumer,
        channels: Mapping[Origin, Iterable[str]],
        scenario: Scenario | None,
        known: Mapping[str, Settings] | None = None,
        mounting: Mounting = AS_USUAL,
        spend: Callable[..., None] = lambda **_: None,
    ) -> None:
        from rig.derived.per_source import OriginDeriver  # with the compiler, which who records need not load

        nominal = None if scenario is None else nominal_of(scenario, mounting)
        self._publish = publish
        self._known = dict(known or {})
        self._derivers: dict[Origin, OriginDeriver] = {}
        for origin in ORIGINS:  # the measured first, whose levels count for all
            if origin in channels:
                measured = self._derivers.get("measured")
                self._derivers[origin] = OriginDeriver(
                    origin, channels[origin], nominal, self._known.get(origin), measured, spend
                )

    def __call__(self, record: Record) -> None:
        match record:
            case Block(origin, samples) if origin in self._derivers:
                self._derivers[origin].add(samples, self._publish)
                self._tell(origin)

    def finish(self) -> None:
        for origin, deriver in self._derivers.items():
            deriver.finish(self._publish)
            self._tell(origin)

    def _tell(self, origin: Origin) -> None:
        settings = self._derivers[origin].settings
        if settings is not None and origin not in self._known:
            self._known[origin] = settings
            self._publish(Metadata(RECORD, as_record(self._known)))


def derivation_of(log: LogReader, publish: Consumer) -> Derivation:
    """What follows from the samples of a log, by what its run settled; raises LogError if that is damaged.

    Where it does not say, by the same rule; without a scenario there are impacts, but no cycles.
    """
    from rig.twin.chains import mounting_of
    from rig.twin.logged import scenario_of  # with the twins, which who records need not load

    try:
        scenario = scenario_of(log)
    except (LogError, ConfigurationError):
        scenario = None
    mounting, record = AS_USUAL, log.metadata.get("run", {})
    if scenario is not None:
        mounting = mounting_of(record, RIGS[scenario.rig].channels)
    names = {origin: list(log.channels(origin)) for origin in ORIGINS}
    known = from_record(log.metadata.get(RECORD, {}))
    return Derivation(publish, names, scenario, known, mounting, log.allowance().spend)


def impacts_of(log: LogReader) -> list[Impact]:
    """All impacts of a log by the rule: found anew where it lacks them, or has them by an earlier one."""
    if says_impacts(log):
        return log.impacts()
    found: list[Impact] = []
    derivation = derivation_of(log, lambda each: found.append(each) if isinstance(each, Impact) else None)
    for origin, block in log.blocks(ORIGINS):
        derivation(Block(origin, block))
    derivation.finish()
    return found


def derived_channels(
    channels: Mapping[Origin, Iterable[Channel]], scenario: Scenario | None = None
) -> list[Channel]:
    """Every channel that may be derived from the channels of each origin, as a log declares it."""
    found: list[Channel] = []
    for origin in ORIGINS if scenario is not None else ():
        declared = tuple(channels.get(origin, ()))
        reference = reference_of(tuple(channel.name for channel in declared))
        if reference is None:
            continue
        if role_of(reference) is not Role.DRIVE:
            found.append(Channel(derived_name(origin, CRANK_SPEED), "rpm", "speed", "crank"))
        for channel in declared:
            if has_figures(channel.name):
                told = channel.unit, channel.quantity, channel.location
                names = (derived_name(origin, channel.name, which) for which in (CYCLE_RMS, CYCLE_PEAK))
                found += [Channel(name, *told) for name in names]
    return found


_LAST_S = 30.0
"""The fullest queue is worked off in that time, by a worker that is half as fast as the data."""


@dataclass(frozen=True, slots=True)
class Derive:
    """The task: takes blocks, gives blocks, impacts and metadata."""

    channels: Mapping[Origin, tuple[str, ...]]
    scenario: Scenario
    mounting: Mounting

    def prepare(self) -> None:
        from daq.signals.running_figures import warm_up

        warm_up()

    def run(self, blocks: Iterator[Block], send: Callable[[object], None]) -> None:
        derivation = Derivation(send, self.channels, self.scenario, mounting=self.mounting)
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
        crew: Crew | None = None,
        mounting: Mounting = AS_USUAL,
    ) -> None:
        self._origins = tuple(channels)
        self._clock, self._publish = clock, publish
        self._told = False
        task = Derive(channels, scenario, mounting)
        self.worker = WorkerProcess("derivation", task, self._deliver, queue_blocks, crew)

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
        return (Event(self._clock.unix_ns(), "warning", "derived", STOPPED, text),)

    def _deliver(self, found: Record) -> None:
        """In the worker's thread."""
        with suppress(RecorderFailed):  # whoever records hears of it, and stops the rig
            self._publish(found)
