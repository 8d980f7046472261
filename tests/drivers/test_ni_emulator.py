"""Parts of the emulated card without a process: conversion, rates, the drive's way to the plant."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2, nidaqmx_pb2_grpc

from drivers.ni_daq.emulator.acquisition import Acquisition, DriveInbox, SampleBuffer
from drivers.ni_daq.emulator.converter import Converter
from drivers.ni_daq.emulator.wiring import CardWiring, DaqmxError, Input, Wire, coerced_rate
from drivers.protocols.generator import DriveSettings
from tests.drivers.plants import SinePlant, seen_at

LSB_V = 5.0 / 2**23


def test_the_private_stubs_of_nidaqmx_are_still_there() -> None:
    assert hasattr(nidaqmx_pb2_grpc, "NiDAQmxServicer")
    fields = nidaqmx_pb2.ReadAnalogF64Response.DESCRIPTOR.fields_by_name
    assert {name: field.number for name, field in fields.items()} == {
        "status": 1,
        "read_array": 2,
        "samps_per_chan_read": 3,
    }


def test_conversion_rounds_clips_and_scales() -> None:
    wiring = CardWiring({"D/ai0": Wire("x", 0.01), "D/ai1": Wire("x", 0.01)})
    converter = Converter(wiring, ["y", "x"], [Input("D/ai0", 1.0, 5.0), Input("D/ai1", 0.02, 250.0)])
    x = np.array([0.0, 1.0, -123.456, 499.0])
    values, clipped = converter.convert(np.stack([np.full(4, np.nan), x]))
    assert values[0] == pytest.approx(0.01 * x, abs=0.5 * LSB_V)
    assert values[1] == pytest.approx(0.5 * x, abs=0.5 * LSB_V / 0.02)
    codes = values[0] / LSB_V
    assert codes == pytest.approx(np.rint(codes), abs=1e-6)
    assert not clipped.any()
    for beyond, code in ((501.0, 2**23 - 1), (-501.0, -(2**23))):
        values, clipped = converter.convert(np.full((2, 3), beyond))
        assert values[0] / LSB_V == pytest.approx(code)
        assert clipped.all()


@pytest.mark.parametrize(
    ("asked", "given"), [(51200.0, 51200.0), (25600.1, 51200.0), (25600.0, 25600.0), (1.0, 51200.0 / 31)]
)
def test_rates_are_coerced_upwards(asked: float, given: float) -> None:
    assert coerced_rate(asked) == given


def test_a_rate_above_the_fastest_is_refused() -> None:
    with pytest.raises(DaqmxError, match="above 51200"):
        coerced_rate(51200.1)


class SteppedClock:
    """Stands still until a test moves it."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.read = threading.Event()

    def unix_ns(self) -> int:
        return 0

    def monotonic_s(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        raise NotImplementedError


def test_drive_reaches_the_plant_at_its_sample_or_as_soon_as_it_can() -> None:
    clock, inbox, plant = SteppedClock(), DriveInbox(), SinePlant(gain_n_per_v=1.0)
    wiring = CardWiring({"D/ai0": Wire("force", 1.0)})
    inputs = [Input("D/ai0", 1.0, 5.0)]
    acquisition = Acquisition(plant, wiring, inputs, 51200.0, 60000, inbox, clock)
    early = DriveSettings(True, 20.0, 2.0, 0.0, started_s=990.0, phase_rad=1.0)
    due = DriveSettings(True, 20.0, 3.0, 0.5, started_s=1000.01, phase_rad=0.3)
    late = DriveSettings(True, 33.0, 1.0, 0.0, started_s=1000.02, phase_rad=0.1)
    inbox.put(early)
    acquisition.start()
    inbox.put(due)
    clock.now_s = 1000.05 + 1e-6  # the first block, 25 ms long, is due after its lag of 25 ms
    first = acquisition.buffer.read(1280, 5.0)[0]
    inbox.put(late)
    clock.now_s = 1000.075 + 1e-6
    second = acquisition.buffer.read(1280, 5.0)[0]
    acquisition.stop()
    times_s = 1000.0 + np.arange(1280) / 51200.0
    expected = [seen_at(early if t < due.started_s else due, t) for t in times_s]
    assert first == pytest.approx(expected, abs=0.5 * LSB_V + 1e-9)
    assert second == pytest.approx([seen_at(late, t + 0.025) for t in times_s], abs=0.5 * LSB_V + 1e-9)


def test_reads_that_pass_the_end_of_the_buffer_are_in_order() -> None:
    buffer, samples = SampleBuffer(2, 10), np.arange(84.0).reshape(2, 42)
    for first in range(0, 42, 7):
        buffer.put(samples[:, first : first + 7])
        assert (buffer.read(7, 0.0) == samples[:, first : first + 7]).all()


def test_a_read_waits_no_longer_than_it_may_and_ends_with_the_task() -> None:
    clock = SteppedClock()
    inputs = [Input("D/ai0", 1.0, 5.0)]
    wiring = CardWiring({"D/ai0": Wire("force", 1.0)})
    acquisition = Acquisition(SinePlant(), wiring, inputs, 51200.0, 60000, DriveInbox(), clock)
    acquisition.start()
    with pytest.raises(DaqmxError, match=r"0 of 10 samples within 0\.01 s") as caught:
        acquisition.buffer.read(10, 0.01)
    assert caught.value.code == -200284
    failed: list[int] = []

    def wait() -> None:
        try:
            acquisition.buffer.read(10, -1.0)
        except DaqmxError as error:
            failed.append(error.code)

    reader = threading.Thread(target=wait)
    reader.start()
    acquisition.stop()
    reader.join(5.0)
    assert failed == [-200278]
    assert math.isclose(acquisition.buffer.made, 0)
