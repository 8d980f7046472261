"""When a card says that it started: by its own stamp, where that is one of this machine's clock."""

from __future__ import annotations

import time
import warnings
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime

import grpc
import nidaqmx
import pytest
from nidaqmx.error_codes import DAQmxErrors, DAQmxWarnings
from nidaqmx.errors import DaqError, DaqWarning, RpcError

from drivers.emulator_process import EmulatedInstrument
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.survey import Survey
from drivers.ni_daq.tasks import AnalogTask
from tests.drivers.conftest import WIRING, card_settings
from tests.drivers.plants import SinePlant


def told_by(address: str) -> float | None:
    """What a card says of its start; it samples in any case."""
    with closing(NiDaqCard(card_settings(address))) as card:
        card.open()
        card.start()
        told = card.started_s()
        assert card.read(512).first_sample == 0
    return told


def test_the_stamp_lies_within_the_start(card_emulator: EmulatedInstrument) -> None:
    with closing(NiDaqCard(card_settings(card_emulator.address))) as card:
        card.open()
        before_s = time.monotonic()
        card.start()
        after_s = time.monotonic()
        started_s = card.started_s()
        assert started_s is not None
        assert before_s - 1e-4 <= started_s <= after_s + 1e-4  # it comes as wall time, in a float of seconds
        assert card.read(5120).arrived_s > started_s + 0.1


def test_a_card_without_stamps_says_nothing() -> None:
    with start_daq_card(SinePlant, replace(WIRING, stamps_start=False)) as emulator:
        assert told_by(emulator.address) is None


@pytest.mark.parametrize(
    "trouble",
    [
        DaqError("not yet", DAQmxErrors.TIMESTAMP_NOT_YET_RECEIVED.value),
        DaqWarning("inaccurate", DAQmxWarnings.FIRST_SAMPLE_TIMESTAMP_INACCURATE.value),
    ],
)
def test_a_stamp_that_is_late_or_inaccurate_is_none(
    card_emulator: EmulatedInstrument, monkeypatch: pytest.MonkeyPatch, trouble: Exception
) -> None:
    def stamped(*_: object) -> datetime:
        if isinstance(trouble, DaqWarning):
            warnings.warn(trouble, stacklevel=1)  # as nidaqmx does
            return datetime.now(UTC)
        raise trouble

    monkeypatch.setattr(nidaqmx.Task, "wait_for_valid_timestamp", stamped)
    assert told_by(card_emulator.address) is None


def test_a_device_server_that_knows_no_stamps_is_no_error(
    card_emulator: EmulatedInstrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(_: object) -> bool:
        raise RpcError(grpc.StatusCode.UNIMPLEMENTED, "no such call")

    monkeypatch.setattr(AnalogTask, "stamp_by_host", unknown)
    assert told_by(card_emulator.address) is None


def test_a_stamp_by_a_clock_that_may_be_another_machines_is_not_asked_for(
    card_emulator: EmulatedInstrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Survey, "simulated", property(lambda _: False, lambda *_: None), raising=False)
    assert told_by(card_emulator.address) is None
