"""What a record lacks at its end: nothing where it ended as it was meant, and its true cause elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import DeviceLost, RattleError, RecorderFailed
from daq.time_base.run_clock import RunClock
from rig.files.bench import embedded_bench
from rig.files.scenario import parse_scenario
from rig.session import driven_rig
from rig.session.devices import Devices
from rig.session.drive import Shaker
from rig.session.driven_rig import DrivenRig
from rig.session.logger_record import LoggerRecord
from rig.session.signals import StopRequest
from tests.rig.session.fakes import RATE, RecordingGenerator, silent_screen
from tests.rig.session.test_driven_rig import SCENARIO
from tests.rig.session.test_logger_record import Thermometer
from tests.rig.session.test_stops import Idle, RunningCard

CLOSING_S = 30.0
"""What it takes to close a card that answers late, in a motor's run with its ramp."""
LOST = DeviceLost("card", "here", "unplugged")


class SlowToClose(RunningCard):
    """The clock is far on once it is closed."""

    def __init__(self, clock: Ahead, generator: RecordingGenerator) -> None:
        super().__init__((Channel("drive.force", "N"),), generator)
        self._clock = clock

    def stop(self) -> None:
        super().stop()
        self._clock.ahead_s += CLOSING_S


class Ahead(SystemClock):
    ahead_s = 0.0

    def monotonic_s(self) -> float:
        return super().monotonic_s() + self.ahead_s


class Due(dict[str, tuple[int, str]]):
    """In place of a recorder: what was said to be due, by topic."""

    failed = False

    def due(self, origin: str, channel: str, end_sample: int, cause: str) -> None:
        self[f"{origin}/{channel}"] = end_sample, cause
        if self.failed:
            raise RecorderFailed("the disk is slower than the data")


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[DrivenRig]:
    """A beam with a thermometer that is asked every 20 ms."""
    monkeypatch.setattr(driven_rig, "Supervisor", Idle)
    generator, clock, scenario = RecordingGenerator(), Ahead(), parse_scenario(SCENARIO, "tails")
    devices = Devices(
        generator,
        RecordingGenerator,
        lambda wait, _: Shaker(generator, scenario.drive, 3.6, wait),
        SlowToClose(clock, generator),
        loggers={"thermometer": Thermometer(*[(293.0, 313.0)] * 9999)},
    )
    rig = DrivenRig(embedded_bench(), devices, StopRequest(), silent_screen(), RunClock(clock))
    with ExitStack() as stack:
        rig.open_log(stack, tmp_path, "tails")
        rig.stream[:] = []
        rig.record((), None)
        stack.callback(rig.devices.card.close)
        yield rig


def recorded(rig: DrivenRig, error: RattleError | None, rests: bool, count: int) -> Due:
    """The first blocks of a record of `count` samples, which then ends as it is said."""
    due = Due()
    rig.recorder = due  # type: ignore[assignment]
    with rig.moving():
        rig.start_record(count)
        with rig.acquisition.changed:
            assert rig.acquisition.changed.wait_for(lambda: rig.acquisition.acquired >= 0.2 * RATE, 10.0)
        rig.acquisition.error = error
        rig._rests = rests
    return due


def test_what_is_asked_before_it_is_closed_is_due_and_nothing_after(rig: DrivenRig) -> None:
    due = recorded(rig, None, False, 2**62)
    count, cause = due["measured/drive.force"]
    assert (count < 10 * RATE, cause) == (True, "stopped before its time")
    readings, cause = due["measured/hall.temperature"]
    assert (readings < 10 / Thermometer.period_s, cause) == (True, "stopped before its time")


def test_whatever_is_predicted_at_the_cards_samples_is_due_as_they_are(rig: DrivenRig) -> None:
    """An encoder of known mounting among them; the log leaves out what was not declared."""
    due = recorded(rig, None, False, 2**62)
    assert due["predicted/encoder.angle"] == due["predicted/drive.force"]
    assert due["predicted/encoder.angle"][1] == "not predicted"


def test_a_lost_card_is_why_and_a_logger_beside_it_was_stopped(rig: DrivenRig) -> None:
    due = recorded(rig, LOST, False, 2**62)
    assert due["measured/drive.force"][1] == "the card was lost"
    assert due["measured/hall.temperature"][1] == "stopped before its time"


def test_a_lost_logger_is_why_it_has_no_more(rig: DrivenRig) -> None:
    rig.loggers[0]._lose("unplugged")
    assert recorded(rig, None, False, 2**62)["measured/hall.temperature"][1] == "the thermometer was lost"


def test_a_record_that_has_ended_by_its_condition_lacks_nothing(rig: DrivenRig) -> None:
    due = recorded(rig, None, True, 2**62)
    until = rig.acquisition.acquired
    assert due["measured/drive.force"][0] == until


def test_readings_behind_the_end_of_a_record_are_not_due() -> None:
    record = LoggerRecord(Thermometer(), None, None)  # type: ignore[arg-type]
    record._begin_s = 1.0
    assert record.due(1.1) == round(0.1 / Thermometer.period_s)
    record.end(1.05)
    assert record.due(31.0) == 3


def test_a_recorder_that_has_failed_is_told_of_every_channel(
    rig: DrivenRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Due, "failed", True)
    due = recorded(rig, None, False, 60 * int(RATE))
    assert {"measured/drive.force", "predicted/drive.force", "measured/hall.temperature"} <= due.keys()
