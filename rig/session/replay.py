"""Plays a log through the path that a live run takes."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from daq.block import NS_PER_S, sample_time_ns
from daq.clock import Clock
from daq.errors import LogError
from daq.log.reader import SURROGATE, LogReader, Origin
from daq.log.records import RANGE, Impact
from rig.bounds import bounds_of
from rig.derived.derivation import ORIGINS, derivation_of, derived_channels
from rig.files.scenario import AcquisitionSection
from rig.session.on_page import show
from rig.session.pace import Work
from rig.session.progress import LOG_S, Screen
from rig.session.signals import StopRequest
from rig.stream import Block, Consumer, Record, Shape, Stream
from rig.twin.chains import scale_of
from rig.twin.logged import align_to, predicting_twin, scenario_of
from rig.twin.prediction import AlignedTwin
from sim_twin.twin import AnyTwin

if TYPE_CHECKING:
    from rig.live.view import LiveView

_ALIGN_ON_S = 2.0
PLAYED: tuple[Origin, ...] = (*ORIGINS, SURROGATE)


def replay_log(
    path: Path,
    speed: float,
    view: LiveView | None,
    screen: Screen,
    clock: Clock,
    consumers: tuple[Consumer, ...] = (),
) -> int:
    """Play every block and event in the order of their times; returns the number of blocks.

    `speed` is in times real time, 0 as fast as possible. `consumers` get everything beside the view. What the
    log has of derived channels and impacts is not played: they are derived from its samples once more.
    """
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        log = stack.enter_context(LogReader(path))
        if not log.channels("measured") and not log.channels("predicted"):
            raise LogError(f"{path}: no channels in it")
        stream, derived = Stream(consumers), _Derived()
        if view is not None:
            scenario = scenario_of(log)
            twin = predicting_twin(log, scenario)
            from rig.live.picture import (
                layout_of,
                picture_of,
            )  # only what is shown need load Rerun

            origins = {origin: list(log.channels(origin).values()) for origin in PLAYED}
            picture, derivable = picture_of(twin), derived_channels(origins, scenario)
            measured, predicted, beside = (origins[each] for each in ("measured", "predicted", "nominal"))
            learnt = origins[SURROGATE]
            noted = log.metadata.get("run", {})
            ranges = {each.name: scale_of(noted, RANGE, each.name) for each in measured}
            bounds = bounds_of(ranges, scenario.limits)
            cycle_s = 1 / scenario.drive.cycle_hz
            shown = layout_of(
                scenario.name, measured, predicted, picture, None, beside, derivable, learnt, bounds, cycle_s
            )
            show(view, shown, screen)
            stream += [view.offer, ShapeFollower(log, twin, scenario.acquisition, view.offer)]
        derivation = derivation_of(log, stream)
        stream += [derived, derivation]
        with _shown(log, speed, screen) as told:
            count = _play(log, speed, clock, stop, stream, told)
            derivation.finish()
        screen.say(f"derived    {derived}")
        return count


class _Derived:
    """Counts what was derived."""

    def __init__(self) -> None:
        self._samples: Counter[str] = Counter()
        self._impacts = 0

    def __str__(self) -> str:
        return f"{len(self._samples)} channels, {self._samples.total()} values, {self._impacts} impacts"

    def __call__(self, record: Record) -> None:
        match record:
            case Block("derived", samples):
                self._samples[samples.channel] += len(samples)
            case Impact():
                self._impacts += 1


def _shown(log: LogReader, speed: float, screen: Screen) -> AbstractContextManager[Callable[[float], None]]:
    """A bar over the s of a log that are played; of a log that was cut short nobody knows how many."""
    ends_ns = log.last_ns({f"/{origin}/{name}": 0 for origin in PLAYED for name in log.channels(origin)})
    seconds = max((max(ends_ns.values()) - (log.zero_ns or 0)) / NS_PER_S, 0.0)
    work = Work("replay", log.path.stat().st_size / 1e6)
    return screen.bar("replaying", round(seconds, 3), LOG_S, work if speed == 0 else None)


def _play(
    log: LogReader,
    speed: float,
    clock: Clock,
    stop: StopRequest,
    publish: Consumer,
    told: Callable[[float], None],
) -> int:
    """Paced on the monotonic clock; returns the number of blocks.

    Events wait for no block: those of before and after the samples come with the first and the last.
    """

    def blocks(origin: Origin) -> Iterator[tuple[int, Record]]:
        for _, block in log.blocks(origin):  # by the time at which they end, when a live run had them
            end_ns = sample_time_ns(block.time_ns, len(block), block.sample_rate)
            yield end_ns, Block(origin, block)

    events: Iterator[tuple[int, Record]] = ((event.time_ns, event) for event in log.events())
    started_s, count = clock.monotonic_s(), 0
    begin_ns, at_s = log.zero_ns or 0, 0.0
    for time_ns, record in heapq.merge(*map(blocks, PLAYED), events, key=lambda item: item[0]):
        stop.check()
        if isinstance(record, Block):
            at_s = max(time_ns - begin_ns, 0) / NS_PER_S
        if speed > 0:
            due_s = started_s + at_s / speed
            while (left_s := due_s - clock.monotonic_s()) > 0:
                stop.check()
                clock.sleep(min(left_s, 0.05))
        publish(record)
        told(at_s)
        count += isinstance(record, Block)
    return count


class ShapeFollower:
    """A consumer that runs the predicting twin beside a replay, so that its picture moves as it did."""

    def __init__(
        self, log: LogReader, twin: AnyTwin, wanted: AcquisitionSection, publish: Callable[[Shape], None]
    ) -> None:
        alignment = align_to(log, twin, _ALIGN_ON_S)
        self._twin = AlignedTwin(twin, alignment, wanted.sample_rate, wanted.settle)
        self._publish = publish

    def __call__(self, record: Record) -> None:
        match record:
            case Block("predicted", samples):
                time_s = samples.end_sample / samples.sample_rate
                behind = round(time_s * self._twin.sample_rate) - self._twin.samples
                if behind > 0:
                    self._twin.advance(behind)
                    self._publish(self._twin.shape())
