"""A live run logs what a replay of its log derives again, to the bit, and never waits for it."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path

import pytest

from daq.block import SampleBlock
from daq.channel import Channel
from daq.clock import SystemClock
from daq.log import LogReader, LogWriter, Origin, verify_log
from daq.recorder import Recorder
from rig.derived import RECORD, DerivedSink, InBackground
from rig.derived.background import QUEUE_BLOCKS
from rig.files.scenario import Scenario
from rig.session.deriving import derive_live
from rig.session.hub import Hub
from rig.session.replay import replay_log
from rig.session.sinks import LogSink
from tests.rig import synthetic_run as beam
from tests.rig.derived import crank_run as crank
from tests.rig.derived.test_derived import BEAM, CRANK, contents
from tests.rig.session.fakes import ListSink, silent_screen


def record_live(
    path: Path, scenario: Scenario, channels: tuple[Channel, ...], blocks: dict[Origin, Iterable[SampleBlock]]
) -> Path:
    """Record as a run does; each origin comes in a thread of its own."""
    clock = SystemClock()
    declared: dict[Origin, list[Channel]] = {origin: list(channels) for origin in blocks}
    with Recorder(LogWriter(path), clock) as recorder:
        recorder.metadata("scenario", {"toml": scenario.text})
        sinks = [LogSink(recorder)]
        for origin in blocks:
            for channel in channels:
                recorder.declare(origin, channel)
        with derive_live(sinks, declared, scenario, recorder, clock) as derived:
            hub = Hub([*sinks, derived])

            def bring(origin: Origin) -> None:
                for block in blocks[origin]:
                    hub.block(origin, block)

            threads = [threading.Thread(target=bring, args=[origin]) for origin in blocks]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            derived.finish()
    return path


def logged(path: Path) -> dict[object, object]:
    sink = ListSink()
    with LogReader(path) as log:
        for origin, block in log.blocks("derived"):
            sink.block(origin, block)
        sink.impacts = log.impacts()
    return contents(sink)


def replayed(path: Path) -> dict[object, object]:
    sink, derived = ListSink(), ListSink()
    replay_log(path, 0.0, False, silent_screen(), SystemClock(), (sink,))
    derived.impacts = sink.impacts
    derived.items = [(origin, item) for origin, item in sink.items if origin == "derived"]
    return contents(derived)


@pytest.fixture(params=["beam", "crank", "crank without encoder"])
def live_log(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "live.mcap"
    if request.param == "beam":
        blocks = {o: beam.blocks(beam.CHANNELS, o, 2.55) for o in ("measured", "predicted")}
        return record_live(path, BEAM, beam.CHANNELS, blocks)  # type: ignore[arg-type]
    channels = crank.CHANNELS if request.param == "crank" else crank.CHANNELS[:2]
    names = [channel.name for channel in channels]
    both = {o: crank.blocks(names, 4.0) for o in ("measured", "predicted")}
    return record_live(path, CRANK, channels, both)  # type: ignore[arg-type]


def test_what_a_replay_derives_is_what_the_run_logged_to_the_bit(live_log: Path) -> None:
    assert verify_log(live_log).sound
    found = logged(live_log)
    assert len(found) > 20
    assert replayed(live_log) == found


def test_a_log_that_does_not_say_what_was_settled_gives_the_same(live_log: Path, tmp_path: Path) -> None:
    forgetful = tmp_path / "forgetful.mcap"
    with LogReader(live_log) as log, LogWriter(forgetful) as copy:
        assert set(log.metadata[RECORD]) == {"rule", "measured", "predicted"}
        copy.add_metadata("scenario", log.metadata["scenario"])
        for origin in ("measured", "predicted"):
            for channel in log.channels(origin).values():
                copy.declare(origin, channel)
        for origin, block in log.blocks(("measured", "predicted")):
            copy.add_block(origin, block, block.time_ns)
    assert replayed(forgetful) == logged(live_log)


class Faulty(DerivedSink):
    """Fails, or hangs until the test lets it go on."""

    def __init__(self, onward: ListSink, hangs: threading.Event | None) -> None:
        super().__init__(onward, {}, None)
        self._hangs = hangs

    def block(self, origin: Origin, block: SampleBlock) -> None:
        if self._hangs is None:
            raise ZeroDivisionError("a fault in what is derived")
        self._hangs.wait()


def a_block() -> SampleBlock:
    return next(iter(beam.blocks(beam.CHANNELS[:1], "measured", 0.1)))


def test_a_fault_ends_it_with_an_event_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    onward = ListSink()
    with InBackground(Faulty(onward, None), onward, SystemClock()) as derived:
        derived.block("measured", a_block())
        derived.finish()
        derived.block("measured", a_block())
    assert onward.codes() == ["derived.stopped"]
    assert "ZeroDivisionError: a fault in what is derived" in capfd.readouterr().err


def test_nobody_waits_for_a_derivation_that_hangs() -> None:
    onward, go_on, block = ListSink(), threading.Event(), a_block()
    with InBackground(Faulty(onward, go_on), onward, SystemClock()) as derived:
        for _ in range(QUEUE_BLOCKS + 2):
            derived.block("measured", block)
        assert onward.codes() == ["derived.stopped"]
        go_on.set()
