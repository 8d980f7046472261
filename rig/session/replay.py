"""Plays a log through the path that a live run takes."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.clock import Clock
from daq.errors import LogError
from daq.log.reader import LogReader, Origin
from daq.log.records import Event, Impact
from rig.derived.sink import derived_channels
from rig.files.scenario import AcquisitionSection, Scenario
from rig.live.view import LiveView
from rig.session.deriving import derive_again
from rig.session.hub import Hub, Sink
from rig.session.progress import Screen
from rig.session.signals import StopRequest
from rig.session.sinks import ViewSink
from rig.twin.overlay import align_to, predicting_twin, scenario_of
from rig.twin.picture import picture_of
from rig.twin.prediction import AlignedTwin
from sim_twin.twin import AnyTwin

_ALIGN_ON_S = 2.0
Item = tuple[int, int, Origin | None, SampleBlock | Event]


def replay_log(
    path: Path, speed: float, live: bool, screen: Screen, clock: Clock, sinks: tuple[Sink, ...] = ()
) -> int:
    """Play every block and event in the order of their times; returns the number of blocks.

    `speed` is in times real time, 0 as fast as possible. `sinks` get everything beside the view. What the log
    has of derived channels and impacts is not played: they are derived from its samples once more.
    """
    with ExitStack() as stack:
        stop = stack.enter_context(StopRequest())
        log = stack.enter_context(LogReader(path))
        if not log.channels("measured") and not log.channels("predicted"):
            raise LogError(f"{path}: no channels in it")
        follow: Callable[[float], None] = lambda _: None  # noqa: E731
        if live:
            scenario = scenario_of(log)
            twin = predicting_twin(log, scenario)
            view = stack.enter_context(_view(log, scenario, twin))
            screen.say(f"live view  {view.url}")
            sink = ViewSink(view)
            sinks = (*sinks, sink)
            follow = _ShapeFollower(log, twin, scenario.acquisition, sink)
        found = _Found()
        derived = derive_again(log, Hub((*sinks, found)))
        count = _Player(Hub((*sinks, derived)), speed, clock, stop).play(log, follow, screen)
        derived.finish()
        screen.say(f"derived    {found}")
        if live:
            screen.hold("the live view stays open; Enter closes it ")
        return count


class _Found:
    """Counts what was derived."""

    def __init__(self) -> None:
        self._samples: Counter[str] = Counter()
        self._impacts = 0

    def __str__(self) -> str:
        return f"{len(self._samples)} channels, {self._samples.total()} values, {self._impacts} impacts"

    def block(self, origin: Origin, block: SampleBlock) -> None:
        self._samples[block.channel] += len(block)

    def impact(self, impact: Impact) -> None:
        self._impacts += 1

    def event(self, event: Event) -> None:
        """Events are not derived."""

    def shape(self, time_s: float, points: NDArray[np.floating]) -> None:
        """Shapes are not derived."""


class _Player:
    """Paces a log on the monotonic clock."""

    def __init__(self, hub: Hub, speed: float, clock: Clock, stop: StopRequest) -> None:
        self._hub, self._speed, self._clock, self._stop = hub, speed, clock, stop

    def play(self, log: LogReader, follow: Callable[[float], None], screen: Screen) -> int:
        started, first_ns, count = self._clock.monotonic_s(), None, 0
        with screen.busy("replaying"):
            for time_ns, _, origin, item in _in_order(log):
                first_ns = time_ns if first_ns is None else first_ns
                self._wait_until(started, (time_ns - first_ns) / NS_PER_S)
                if isinstance(item, Event):
                    self._hub.event(item)
                elif origin is not None:
                    self._hub.block(origin, item)
                    count += 1
                    if origin == "predicted":
                        follow(item.end_sample / item.sample_rate)
        return count

    def _wait_until(self, started: float, record_s: float) -> None:
        self._stop.check()
        if self._speed <= 0:
            return
        while (left := started + record_s / self._speed - self._clock.monotonic_s()) > 0:
            self._stop.check()
            self._clock.sleep(min(left, 0.05))


def _in_order(log: LogReader) -> Iterator[Item]:
    """Blocks by the time at which they end (when a live run would have had them), and events."""
    blocks = [_blocks_of(log, origin) for origin in _ORIGINS]
    events = ((event.time_ns, number, None, event) for number, event in enumerate(log.events()))
    return heapq.merge(*blocks, events, key=lambda item: item[:1])


_ORIGINS: tuple[Origin, ...] = ("measured", "nominal", "predicted")


def _blocks_of(log: LogReader, origin: Origin) -> Iterator[Item]:
    for number, (_, block) in enumerate(log.blocks(origin)):
        yield sample_time_ns(block.time_ns, len(block), block.sample_rate), number, origin, block


class _ShapeFollower:
    """Runs the predicting twin beside a replay, so that its picture moves as it did."""

    def __init__(self, log: LogReader, twin: AnyTwin, wanted: AcquisitionSection, sink: Sink) -> None:
        alignment = align_to(log, twin, _ALIGN_ON_S)
        self._twin = AlignedTwin(twin, alignment, wanted.sample_rate, wanted.settle)
        self._sink = sink

    def __call__(self, time_s: float) -> None:
        behind = round(time_s * self._twin.sample_rate) - self._twin.samples
        if behind > 0:
            self._twin.advance(behind)
            self._sink.shape(time_s, self._twin.shape())


def _view(log: LogReader, scenario: Scenario, twin: AnyTwin) -> LiveView:
    origins = {origin: list(log.channels(origin).values()) for origin in _ORIGINS}
    return LiveView(
        scenario.name,
        origins["measured"],
        origins["predicted"],
        picture_of(twin),
        nominal=origins["nominal"],
        derived=derived_channels(origins, scenario),
    )
