"""What hangs as a run ends is left behind, and the run comes to its end."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from daq.clock import SystemClock
from daq.time_base.clocks import CardClock
from drivers.protocols.encoder import PositionBlock
from rig.session import acquisition, driven_rig, encoder_record, logger_record
from rig.session.driven_rig import DrivenRig, Hung
from rig.session.logger_record import LoggerRecord
from rig.stream import Stream
from tests.rig.session.fakes import RATE, Kept
from tests.rig.session.test_encoder_record import Lab
from tests.rig.session.test_guard import Bench, ended, hanging
from tests.rig.session.test_logger_record import Thermometer
from tests.rig.session.test_stops import Idle

JOIN_S = 0.2
"""In place of five seconds."""
LONG_S = 10.0
"""Whoever has not left by then waits for what hangs."""


def left_behind(leave: Callable[[], None], goes_on: threading.Event) -> bool:
    """Whether that comes to its end before what hangs goes on."""
    leaving = threading.Thread(target=leave)
    leaving.start()
    leaving.join(LONG_S)
    left = not leaving.is_alive()
    goes_on.set()
    leaving.join()
    return left


def test_a_card_that_hangs_in_its_read_keeps_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driven_rig, "Supervisor", Idle)
    monkeypatch.setattr(acquisition, "JOIN_S", JOIN_S)
    bench, goes_on = Bench(tmp_path, None), threading.Event()
    hang = hanging(bench.card.read, goes_on)

    def during(rig: DrivenRig) -> None:
        monkeypatch.setattr(bench.card, "read", hang)
        rig.watch.wait(LONG_S)

    match = "the acquisition took too long for a reading"
    assert left_behind(lambda: ended(bench, Hung, match, during), goes_on)
    assert bench.generator.off_s is not None


def test_an_encoder_that_hangs_in_its_read_keeps_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoder_record, "JOIN_S", JOIN_S)
    lab, hangs, goes_on = Lab(), threading.Event(), threading.Event()
    read = lab.encoder.read

    def hang(count: int) -> PositionBlock:
        hangs.set()
        goes_on.wait()
        return read(count)

    def leave() -> None:
        with lab.record:
            assert hangs.wait(LONG_S)

    monkeypatch.setattr(lab.encoder, "read", hang)
    lab.end()
    assert left_behind(leave, goes_on)
    assert lab.encoder.stopped


class HangingThermometer(Thermometer):
    def __init__(self) -> None:
        super().__init__()
        self.goes_on = threading.Event()

    def read(self) -> Sequence[float]:
        self.asked.set()
        self.goes_on.wait()
        return 293.0, 313.0


def test_a_logger_that_hangs_in_its_read_keeps_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logger_record, "JOIN_S", JOIN_S)
    logger, base = HangingThermometer(), CardClock(SystemClock(), RATE)
    base.start(lambda: None)

    def leave() -> None:
        with LoggerRecord(logger, base, Stream([Kept()])) as record:
            record.begin(0.0, 60.0)
            assert logger.asked.wait(LONG_S)

    assert left_behind(leave, logger.goes_on)
