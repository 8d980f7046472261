"""What a logger that is asked now and then leaves in a log, and what its failing costs."""

from __future__ import annotations

import io
import math
import sys
import threading
from collections.abc import Sequence

import pytest

from daq.block import Flag
from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import DeviceLost, InstrumentSilent
from daq.log.records import Event, Gap
from daq.time_base.clocks import CardClock
from drivers.protocols.instrument import Logger
from rig.session.logger_record import LoggerRecord
from rig.stream import Block, Record, Stream


class Thermometer:
    """Answers as it is told, then says so."""

    name, address, identity, period_s = "thermometer", "here", "PT100", 0.02
    channels = (Channel("hall.temperature", "K"), Channel("oil.temperature", "K"))

    def __init__(self, *answers: tuple[float, float] | Exception) -> None:
        self._answers, self.asked = list(answers), threading.Event()

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> Sequence[float]:
        answer = self._answers.pop(0)
        if not self._answers:
            self.asked.set()
        if isinstance(answer, Exception):
            raise answer
        return answer


def recorded(logger: Thermometer, end_s: float = 60.0, kept: list[Record] | None = None) -> list[Record]:
    kept = [] if kept is None else kept
    base = CardClock(SystemClock(), 51_200.0)
    base.start(lambda: None)
    asked: Logger = logger
    with LoggerRecord(asked, base, Stream([kept.append])) as record:
        record.begin(0.0, end_s)
        assert logger.asked.wait(10.0)
        record.end(end_s)
    return kept


def test_each_channel_has_a_sample_a_period_from_the_beginning_on() -> None:
    answers = [(293.0 + k, 313.0 + k) for k in range(3)]
    kept = recorded(Thermometer(*answers), 3 * 0.02)
    blocks = [each.samples for each in kept if isinstance(each, Block)]
    assert kept == [Block("measured", block) for block in blocks]
    assert [block.channel for block in blocks] == ["hall.temperature", "oil.temperature"] * 3
    assert [float(block.values[0]) for block in blocks] == [value for pair in answers for value in pair]
    assert {(block.sample_rate, block.flags) for block in blocks} == {(50.0, Flag.GOOD)}
    numbers = [block.first_sample for block in blocks[::2]]
    assert numbers == sorted(set(numbers))


def test_an_answer_that_does_not_come_is_a_gap_and_a_wrong_one_is_marked() -> None:
    silent = InstrumentSilent("thermometer", "here", "no answer", "its plug")
    kept = recorded(Thermometer((293.0, 313.0), silent, (math.nan, 314.0)))
    assert [each.code for each in kept if isinstance(each, Event)] == ["logger.silent"]
    first, second = ([b.samples for b in kept if isinstance(b, Block)][k : k + 2] for k in (0, 2))
    gaps = [each for each in kept if isinstance(each, Gap)]
    assert [(gap.channel, gap.first_sample) for gap in gaps] == [
        ("hall.temperature", first[0].end_sample),
        ("oil.temperature", first[0].end_sample),
    ]
    assert {gap.count for gap in gaps} == {second[0].first_sample - first[0].end_sample}
    missing = Flag.SAMPLES_MISSING_BEFORE
    assert [block.flags for block in second] == [missing | Flag.NOT_FINITE, missing]


def test_the_last_answers_that_do_not_come_are_a_gap_as_well() -> None:
    silent = InstrumentSilent("thermometer", "here", "no answer", "its plug")
    kept = recorded(Thermometer((293.0, 313.0), silent, silent))
    behind = max(each.samples.end_sample for each in kept if isinstance(each, Block))
    gaps = [each for each in kept if isinstance(each, Gap)]
    assert [(gap.channel, gap.first_sample) for gap in gaps] == [
        ("hall.temperature", behind),
        ("oil.temperature", behind),
    ]
    assert all(gap.count >= 2 for gap in gaps)  # more where this machine was slow


def test_one_that_is_lost_ends_its_own_record_with_a_warning() -> None:
    kept = recorded(Thermometer((293.0, 313.0), DeviceLost("thermometer", "here", "unplugged")))
    (told,) = (each for each in kept if isinstance(each, Event))
    assert (told.level, told.source, told.code) == ("warning", "thermometer", "logger.lost")
    assert "unplugged" in told.text
    behind = max(each.samples.end_sample for each in kept if isinstance(each, Block))
    assert {gap.first_sample for gap in kept if isinstance(gap, Gap)} == {behind}


class GoneTerminal(io.StringIO):
    """Takes nothing, and notes what was in the log by then."""

    def __init__(self, kept: list[Record], error: Exception) -> None:
        super().__init__()
        self._kept, self._error = kept, error
        self.by_then: list[Record] = []

    def write(self, text: str) -> int:
        self.by_then = self.by_then or self._kept.copy()
        raise self._error


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), ValueError("I/O operation on closed file")]
)
def test_a_fault_in_its_driver_is_told_before_a_terminal_that_is_gone(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    kept: list[Record] = []
    terminal = GoneTerminal(kept, error)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", terminal)
        recorded(Thermometer((293.0, 313.0), ZeroDivisionError("a fault of its driver")), kept=kept)
    (told,) = (each for each in kept if isinstance(each, Event))
    assert (told.code, told.text) == ("logger.lost", "stopped by ZeroDivisionError: a fault of its driver")
    assert kept == terminal.by_then
    assert [gap.channel for gap in kept if isinstance(gap, Gap)] == ["hall.temperature", "oil.temperature"]
