"""The log of a centring says what ended it, whatever that was."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.channel import Channel
from daq.errors import DeviceLost, RecorderFailed
from daq.log.reader import LogReader
from rig.session.centring_run import FORCES, RECORD, CentringRecord
from tests.rig.session.centring.test_rig import rig_to_centre
from tests.rig.session.fakes import SteppedCard

CARD = SteppedCard(tuple(Channel(name, "N") for name in FORCES))


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (DeviceLost("card", "here", "it went away"), "card at here: it went away"),
        (KeyboardInterrupt(), "interrupted"),
        (ZeroDivisionError("a fault of ours"), "ZeroDivisionError: a fault of ours"),
    ],
)
def test_whatever_ends_a_centring_stands_in_its_log(tmp_path: Path, error: BaseException, text: str) -> None:
    with (
        rig_to_centre(tmp_path, CARD) as (rig, _),
        pytest.raises(type(error)) as caught,
        CentringRecord(rig),
    ):
        raise error
    assert caught.value is error
    error.__traceback__ = None  # it holds the rig
    (path,) = tmp_path.iterdir()
    with LogReader(path) as log:
        assert [(event.code, event.text) for event in log.events()] == [("centring.ended", text)]
        assert log.metadata[RECORD] == {"offsets": "[]"}


def test_a_log_that_takes_nothing_more_is_told_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: object) -> None:
        raise RecorderFailed("the disk is slower than the data, still")

    first = RecorderFailed("the disk is slower than the data")
    with rig_to_centre(tmp_path, CARD) as (rig, _):
        monkeypatch.setattr(rig.recorder, "event", full)
        with pytest.raises(RecorderFailed) as caught, CentringRecord(rig):
            raise first
    assert caught.value is first
