"""The log of a centring says what ended it, whatever that was."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import DeviceLost, RecorderFailed
from daq.log.reader import LogReader
from rig.files.bench import embedded_bench
from rig.files.scenario import parse_scenario
from rig.session.centring.record import RECORD, CentringRecord
from rig.session.centring.rig import FORCES
from rig.session.devices import Devices
from rig.session.drive import Shaker
from tests.rig.session.centring.test_rig import SCENARIO
from tests.rig.session.fakes import RecordingGenerator, SteppedCard


def record_in(folder: Path) -> CentringRecord:
    generator, scenario = RecordingGenerator(), parse_scenario(SCENARIO, "centred")
    devices = Devices(
        generator,
        RecordingGenerator,
        lambda wait, _: Shaker(generator, scenario.drive, 3.6, wait),
        SteppedCard(tuple(Channel(name, "N") for name in FORCES)),
    )
    return CentringRecord(folder, scenario, embedded_bench(), devices, {}, SystemClock())


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (DeviceLost("card", "here", "it went away"), "card at here: it went away"),
        (KeyboardInterrupt(), "interrupted"),
        (ZeroDivisionError("a fault of ours"), "ZeroDivisionError: a fault of ours"),
    ],
)
def test_whatever_ends_a_centring_stands_in_its_log(tmp_path: Path, error: BaseException, text: str) -> None:
    record = record_in(tmp_path)
    with pytest.raises(type(error)) as caught, record:
        raise error
    assert caught.value is error
    with LogReader(record.path) as log:
        assert [(event.code, event.text) for event in log.events()] == [("centring.ended", text)]
        assert log.metadata[RECORD] == {"offsets": "[]"}


def test_a_log_that_takes_nothing_more_is_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: object) -> None:
        raise RecorderFailed("the disk is slower than the data, still")

    record, first = record_in(tmp_path), RecorderFailed("the disk is slower than the data")
    monkeypatch.setattr(record.recorder, "event", full)
    with pytest.raises(RecorderFailed) as caught, record:
        raise first
    assert caught.value is first
