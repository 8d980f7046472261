"""The twin's process: what it predicts, and what is said when it cannot."""

from __future__ import annotations

import os
import signal
import threading

import numpy as np
import psutil
import pytest

from daq.errors import LogError, RecorderFailed
from rig.files.scenario import parse_scenario
from rig.session.signals import Stopped
from rig.stream import Block
from rig.twin.alignment import Alignment
from rig.twin.scenario_twin import twin_of
from rig.twin.worker import Drive, Predict, RecordedSpan
from rig.worker_process import Crew, WorkerFailed, WorkerProcess
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.twin import AnyTwin, Twin

RATE = 51_200.0
TWIN = Twin(nominal(), SineDrive(9.0, 20.0), nominal_sensors(nominal()))
END = 30_000
SLOW_CRANK = """\
rig = "planar_slider_crank"
[drive]
speed = "50 rpm"
[acquisition]
sample_rate = "10.24 kHz"
duration = "1 s"
"""


class Delivered:
    """Keeps what comes from the twin."""

    def __init__(self, fails: bool = False) -> None:
        self.items: list[object] = []
        self.came = threading.Event()
        self._fails = fails

    def __call__(self, item: object) -> None:
        self.items.append(item)
        self.came.set()
        if self._fails:
            raise ZeroDivisionError("a fault in whoever takes it")


def twin_worker(deliver: Delivered, twin: AnyTwin = TWIN) -> WorkerProcess:
    return WorkerProcess("twin", Predict(twin, "drive.force", RATE, 0.0), deliver)


def feed(worker: WorkerProcess, last: bool = True) -> None:
    force = 9.0 * np.sin(2 * np.pi * 20.0 * np.arange(60_000) / RATE + 0.4)
    worker.give(Drive(0, force))
    worker.give(RecordedSpan(0, END, 0, last))


def test_it_aligns_and_predicts_every_channel_up_to_the_end_of_the_record() -> None:
    delivered = Delivered()
    with twin_worker(delivered) as worker:
        worker.wait_ready()
        feed(worker)
        worker.finish(60.0)
    (alignment,) = (item for item in delivered.items if isinstance(item, Alignment))
    assert alignment.phase == pytest.approx(0.4, abs=1e-3)
    for name in TWIN.channels:
        blocks = [b.samples for b in delivered.items if isinstance(b, Block) and b.samples.channel == name]
        assert sum(len(block) for block in blocks) == END


def test_a_slow_crank_without_an_encoder_is_followed_by_its_marker() -> None:
    """50 rpm: a second, in which an angle is known, has one mark at most."""
    turns_per_s, rate, phase = 50.0 / 60.0, 10_240.0, 2.0
    angle = 2 * np.pi * turns_per_s * np.arange(4 * int(rate)) / rate + phase
    marker = 5.0 * (np.degrees(angle) % 360.0 < 5.0)
    twin = twin_of(parse_scenario(SLOW_CRANK))
    delivered = Delivered()
    with WorkerProcess("twin", Predict(twin, "crank.marker", rate, 0.0), delivered) as worker:
        worker.wait_ready()
        for first in range(0, len(marker), 1024):
            worker.give(Drive(first, marker[first : first + 1024]))
            worker.give(RecordedSpan(0, min(first, 100), 0, last=False))
        worker.give(RecordedSpan(0, 100, 0, last=True))
        worker.finish(60.0)
    (alignment,) = (item for item in delivered.items if isinstance(item, Alignment))
    assert alignment.trusted
    # a mark is seen to half a sample: 0.3 mrad
    assert alignment.phase == pytest.approx(phase, abs=1e-3)


def test_its_death_is_told_and_a_fault_of_the_taker_too() -> None:
    for fails, words in ((False, "the twin's process died"), (True, "ZeroDivisionError: a fault in whoever")):
        delivered = Delivered(fails)
        with twin_worker(delivered) as worker:
            worker.wait_ready()
            feed(worker, last=False)
            assert delivered.came.wait(30)
            assert worker.pid is not None
            os.kill(worker.pid, signal.SIGKILL)
            with pytest.raises(WorkerFailed, match=words):
                worker.finish(60.0)


def test_a_frozen_twin_holds_up_nobody_and_can_be_given_up() -> None:
    """Far more than a pipe holds is handed over at once; a stop is heard while waiting for it."""

    def stop() -> None:
        raise Stopped("stopped by a person")

    with twin_worker(Delivered()) as worker:
        worker.wait_ready()
        pid = worker.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        for _ in range(20):
            feed(worker)
        with pytest.raises(Stopped, match="stopped by a person"):
            worker.finish(60.0, stop)


def test_a_twin_that_cannot_start_says_why() -> None:
    broken = Twin(nominal(), SineDrive(9.0, 20.0), {"drive.force": None})  # type: ignore[dict-item]
    with (
        twin_worker(Delivered(), broken) as worker,
        pytest.raises(WorkerFailed, match=r"(?s)the twin did not start: .*Attribute"),
    ):
        worker.wait_ready()


def test_a_start_can_be_given_up() -> None:
    def stop() -> None:
        raise LogError("somebody stopped it")

    with twin_worker(Delivered()) as worker, pytest.raises(LogError, match="somebody"):
        worker.wait_ready(stop)


def test_a_log_that_takes_nothing_more_is_no_death_of_the_twin() -> None:
    """RecorderFailed is an OSError, as the end of a pipe is."""

    def refuse(item: object) -> None:
        raise RecorderFailed("run.mcap: No space left on device")

    with WorkerProcess("twin", Predict(TWIN, "drive.force", RATE, 0.0), refuse) as worker:
        worker.wait_ready()
        feed(worker)
        with pytest.raises(WorkerFailed, match=r"^run\.mcap: No space left on device$"):
            worker.finish(60.0)


def test_a_crew_goes_on_with_the_next_task_and_ends_with_its_context() -> None:
    """As a sweep does: what was handed over too late for one task is nothing to the next."""
    with Crew() as crew:
        numbers, ends = [], []
        for _ in range(2):
            delivered = Delivered()
            with WorkerProcess(
                "twin", Predict(TWIN, "drive.force", RATE, 0.0), delivered, crew=crew
            ) as worker:
                worker.wait_ready()
                feed(worker)
                worker.give(RecordedSpan(0, END, 0, last=True))  # nobody takes it any more
                worker.finish(30.0)
            numbers.append(worker.pid)
            ends.append(max(each.samples.end_sample for each in delivered.items if isinstance(each, Block)))
        assert numbers[0] == numbers[1]
        assert ends == [END, END]
        assert psutil.pid_exists(numbers[0] or 0)
    assert not worker._child.alive


def test_a_crew_keeps_nobody_who_failed_or_was_given_up() -> None:
    with Crew() as crew:
        given_up = WorkerProcess("twin", Predict(TWIN, "drive.force", RATE, 0.0), Delivered(), crew=crew)
        with given_up:
            given_up.wait_ready()
        assert not given_up._child.alive
        lost = crew.hire("twin", Predict(TWIN, "drive.force", RATE, 0.0))
        crew.keep("twin", lost)
        lost.process.kill()
        lost.process.join()
        again = crew.hire("twin", Predict(TWIN, "drive.force", RATE, 0.0))
        crew.keep("twin", again)
        assert again.pid != lost.pid
