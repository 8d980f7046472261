"""A live run logs what a replay of its log derives again, to the bit, and never waits for it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from daq.block import SampleBlock
from daq.channel import Channel
from daq.clock import SystemClock
from daq.log.reader import LogReader, Origin
from daq.log.records import Event
from daq.log.recover import verify_log
from daq.log.writer import LogWriter
from daq.recorder import Recorder
from rig.derived.derivation import DerivationProcess, derived_channels
from rig.derived.settings import RECORD
from rig.files.scenario import Scenario
from rig.session.logbook import logged_by
from rig.session.replay import replay_log
from rig.session.signals import Stopped, StopRequest
from rig.stream import Block, Stream
from tests.rig import synthetic_run as beam
from tests.rig.derived import crank_run as crank
from tests.rig.derived.test_derived import BEAM, CRANK, contents
from tests.rig.session.fakes import Kept, silent_screen


def record_live(
    path: Path, scenario: Scenario, channels: tuple[Channel, ...], blocks: dict[Origin, Iterable[SampleBlock]]
) -> Path:
    """Record as a run does; each origin comes in a thread of its own."""
    clock = SystemClock()
    declared: dict[Origin, list[Channel]] = {origin: list(channels) for origin in blocks}
    with Recorder(LogWriter(path), clock) as recorder:
        recorder.metadata("scenario", {"toml": scenario.text})
        for origin in blocks:
            for channel in channels:
                recorder.declare(origin, channel)
        for channel in derived_channels(declared, scenario):
            recorder.declare("derived", channel)
        stream = Stream([logged_by(recorder)])
        names = {origin: tuple(channel.name for channel in channels) for origin in blocks}
        with started(DerivationProcess(names, scenario, clock, stream)) as derived:
            stream.append(derived)

            def bring(origin: Origin) -> None:
                for block in blocks[origin]:
                    stream(Block(origin, block))

            threads = [threading.Thread(target=bring, args=[origin]) for origin in blocks]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            derived.finish(recorder.event)
    return path


@contextmanager
def started(derived: DerivationProcess) -> Iterator[DerivationProcess]:
    """As a run does it."""
    with derived.worker:
        derived.wait_ready(lambda: None)
        yield derived


def logged(path: Path) -> dict[object, object]:
    kept = Kept()
    with LogReader(path) as log:
        for origin, block in log.blocks("derived"):
            kept(Block(origin, block))
        kept.records += log.impacts()
    return contents(kept)


def replayed(path: Path) -> dict[object, object]:
    kept = Kept()
    replay_log(path, 0.0, None, silent_screen(), SystemClock(), (kept,))
    return contents(kept)


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


@pytest.mark.long
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


def a_block(seconds: float = 0.1) -> SampleBlock:
    return next(iter(beam.blocks(beam.CHANNELS[:1], "measured", seconds)))


def derivation(**options: int) -> DerivationProcess:
    names: dict[Origin, tuple[str, ...]] = {"measured": ("contact.force_upper",)}
    return DerivationProcess(names, BEAM, SystemClock(), Kept(), **options)


def stopped(derived: DerivationProcess, why: str) -> bool:
    """Whether it says so, as a warning, in an event; and does not say it again."""
    (event,) = derived.events()
    assert (event.level, event.source, event.code) == ("warning", "derived", "derived.stopped")
    return f"from here on: {why}" in event.text and not derived.events()


def test_a_fault_ends_it_with_an_event_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    faulty = SampleBlock("contact.force_upper", 0, 0, beam.RATE, np.zeros((2, 60_000)))
    told: list[Event] = []
    with started(derivation()) as derived:
        derived(Block("measured", faulty))
        derived.finish(told.append)
        derived(Block("measured", a_block()))
        derived.finish(told.append)
    (event,) = told
    assert "derivation failed: ValueError" in event.text
    assert "rattle replay derives it" in event.text
    assert "Traceback" in capfd.readouterr().err


def test_nobody_waits_for_a_derivation_that_hangs() -> None:
    with started(derivation(queue_blocks=50)) as derived:
        assert derived.worker.pid is not None
        os.kill(derived.worker.pid, signal.SIGSTOP)
        for _ in range(2_000):
            derived(Block("measured", a_block()))
        assert stopped(derived, "the derivation is slower than the data")


def test_a_person_who_stops_the_run_does_not_wait_for_its_end() -> None:
    stop, told, began_s = StopRequest(), list[Event](), time.monotonic()
    stop.asked = 1
    with started(derivation()) as derived:
        assert derived.worker.pid is not None
        os.kill(derived.worker.pid, signal.SIGSTOP)
        with pytest.raises(Stopped):
            derived.finish(told.append, stop.check)
        derived.finish(told.append)  # as on every way out of a run
    assert [event.code for event in told] == ["derived.stopped"]
    assert time.monotonic() - began_s < 20.0  # it may take 30 s otherwise


def test_its_death_is_told_and_what_comes_then_is_taken_and_left() -> None:
    with started(derivation()) as derived:
        assert derived.worker.pid is not None
        os.kill(derived.worker.pid, signal.SIGKILL)
        derived(Block("measured", a_block()))
        told: list[Event] = []
        derived.finish(told.append)
        derived(Block("measured", a_block()))
    assert [event.code for event in told] == ["derived.stopped"]
    assert "the derivation's process died" in told[0].text
    assert not derived.events()
