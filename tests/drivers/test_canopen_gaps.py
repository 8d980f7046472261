"""Every gap has its own cause, and numbers that may be wrong are said to be, in the block and as an event."""

from __future__ import annotations

import can
import pytest

from daq.block import Flag
from drivers.canopen_cia406.objects import PositionLayout
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.canopen_cia406.stream import PositionStream
from drivers.protocols.encoder import PositionBlock

PERIOD_S, EPOCH_S, NODE, RANGE, COUNT = 1e-3, 1.75e9, 7, 4096, 200


class Bus:
    """A stream that hears what the test lets come; `late_s` is how late a frame is."""

    def __init__(self) -> None:
        self.stream = PositionStream(EncoderSettings(NODE, "socketcand", options={}))
        self.stream.begin(PositionLayout(0, 4), RANGE, 0.3)

    def says(self, number: float, data: bytes, late_s: float = 0.0, **kind: bool) -> None:
        at_s = number * PERIOD_S + late_s
        identifier = 0x004 if kind else 0x180 + NODE
        message = can.Message(EPOCH_S + at_s, identifier, False, data=data, **kind)
        self.stream.frame(message, 50.0 + at_s)

    def position(self, number: int, late_s: float = 0.0) -> None:
        self.says(number, (7 * number % RANGE).to_bytes(4, "little"), late_s)

    def block(self) -> PositionBlock:
        self.stream.end()
        return self.stream.take(10 * COUNT, 0.0)


def causes(block: PositionBlock) -> list[tuple[int, int, str]]:
    return [(gap.first_frame, gap.count, gap.cause) for gap in block.gaps]


WRONG = {
    "a frame of 3 bytes instead of 4": b"\0\0\0",
    "position 4096 beyond the total range of 4096": b"\0\x10\0\0",
}


@pytest.mark.parametrize(("cause", "data"), WRONG.items())
def test_a_rejected_frame_is_the_cause_of_its_own_gap_alone(cause: str, data: bytes) -> None:
    bus = Bus()
    for number in range(COUNT):
        if number == 50:
            bus.says(50, data)
        elif number not in (48, 90, 91):  # lost on the bus, before it and after it
            bus.position(number)
    assert causes(bus.block()) == [(48, 1, "frames missing"), (50, 1, cause), (90, 2, "frames missing")]


@pytest.mark.parametrize(("cause", "data"), WRONG.items())
def test_a_rejected_frame_that_left_no_gap_is_the_cause_of_none(cause: str, data: bytes) -> None:
    bus = Bus()
    for number in range(COUNT):
        if number == 50:
            bus.says(49.5, data)  # another sender's: our own frame comes as well
        if number != 90:
            bus.position(number)
    block = bus.block()
    assert causes(block) == [(90, 1, "frames missing")]
    assert bus.stream.statistics.wrong_length + bus.stream.statistics.out_of_range == 1


def test_an_overrun_that_lost_nothing_is_the_cause_of_no_later_gap() -> None:
    bus = Bus()
    for number in range(COUNT):
        if number == 50:
            bus.says(49.5, b"\0\x01", is_error_frame=True)
        if number != 90:
            bus.position(number)
    assert causes(bus.block()) == [(90, 1, "frames missing")]
    assert [notice.code for notice in bus.stream.take_notices()] == ["encoder.receiver_overrun"]


def test_a_gap_of_two_causes_names_both() -> None:
    bus = Bus()
    for number in range(COUNT):
        if number in (50, 51):
            bus.says(number, list(WRONG.values())[number - 50])
        else:
            bus.position(number)
    assert causes(bus.block()) == [(50, 2, "; ".join(WRONG))]


def test_a_loss_within_a_stall_is_flagged_told_once_and_said_in_the_gap() -> None:
    bus = Bus()
    for number in range(COUNT):
        if number != 105:
            held_s = (110 - number) * PERIOD_S + (number - 100) * 20e-6
            bus.position(number, held_s if 100 <= number <= 110 else 0.0)
    block = bus.block()
    assert [gap.cause for gap in block.gaps] == ["frames missing; how many and where is not certain"]
    assert block.flags == Flag.SAMPLES_MISSING_BEFORE | Flag.CLOCK_NOT_LOCKED
    (notice,) = bus.stream.take_notices()
    assert (notice.level, notice.code) == ("warning", "encoder.numbering")
    assert notice.text.startswith("frame 101: positions come too unevenly")
    assert bus.stream.statistics.uncertain == 10
    assert bus.stream.statistics.missing == 1


def test_a_stall_that_loses_nothing_leaves_no_trace() -> None:
    bus = Bus()
    for number in range(COUNT):
        held_s = (120 - number) * PERIOD_S + (number - 100) * 20e-6
        bus.position(number, held_s if 100 <= number <= 120 else 0.0)
    block = bus.block()
    assert block.number.tolist() == list(range(COUNT))
    assert (block.gaps, block.flags, bus.stream.take_notices()) == ((), Flag.GOOD, ())
