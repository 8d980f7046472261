"""The twin's process: what it predicts, and what is said when it cannot."""

from __future__ import annotations

import os
import signal
import threading

import numpy as np
import pytest

from daq.block import SampleBlock
from daq.errors import LogError
from rig.session.signals import Stopped
from rig.twin.alignment import Alignment
from rig.twin.worker import Drive, Predict, Recorded
from rig.worker_process import WorkerFailed, WorkerProcess
from sim_twin.rigs.impact_beam.healthy import nominal_sensors
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.twin import AnyTwin, Twin

RATE = 51_200.0
TWIN = Twin(nominal(), SineDrive(9.0, 20.0), nominal_sensors(nominal()))
END = 30_000


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
    return WorkerProcess("twin", Predict(twin, RATE, 0.0), deliver)


def feed(worker: WorkerProcess, last: bool = True) -> None:
    force = 9.0 * np.sin(2 * np.pi * 20.0 * np.arange(60_000) / RATE + 0.4)
    worker.give(Drive(0, force))
    worker.give(Recorded(0, END, 0, last))


def test_it_aligns_and_predicts_every_channel_up_to_the_end_of_the_record() -> None:
    delivered = Delivered()
    with twin_worker(delivered) as worker:
        worker.wait_ready()
        feed(worker)
        worker.finish(60.0)
    (alignment,) = (item for item in delivered.items if isinstance(item, Alignment))
    assert alignment.phase == pytest.approx(0.4, abs=1e-3)
    for name in TWIN.channels:
        blocks = [b for b in delivered.items if isinstance(b, SampleBlock) and b.channel == name]
        assert sum(len(block) for block in blocks) == END


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
