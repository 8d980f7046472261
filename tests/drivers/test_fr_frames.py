"""Frames: the manual's own examples, and the one answer that belongs to a request among anything else."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymodbus.framer.rtu import FramerRTU
from pymodbus.pdu import DecodePDU

from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, Disturbance, LineFaults
from drivers.mitsubishi_fr.frames import READ, WRITE, Heard, Request, find_answer, intact, what_was_heard
from drivers.mitsubishi_fr.settings import CHECKED
from tests.drivers.fr_bench import answer_frame

BLOCKS = (fr.STATUS_BLOCK, fr.MONITOR_BLOCK, fr.SET_BLOCK, *CHECKED, *fr.MARKS)
# Read of 41004 to 41006, write of 60.00 Hz into 40014, write of 41007 = 5 and 41008 = 10, answer to the
# first: FR-D700 (Applied) p. 205, 206; FR-A700 p. 350, 353.
MANUAL_READ = bytes.fromhex("11 03 03 EB 00 03 77 2B")
MANUAL_WRITE = bytes.fromhex("05 06 00 0D 17 70 17 99")
MANUAL_WRITE_MANY = bytes.fromhex("19 10 03 EE 00 02 04 00 05 00 0A 86 3D")
MANUAL_ANSWER = bytes.fromhex("11 03 06 17 70 0B B8 03 E8 2C E6")

REQUEST = Request(1, READ, fr.MONITOR_BLOCK.address, fr.MONITOR_BLOCK.count)
VALUES = [667, 60, 222]
ANSWER = answer_frame(REQUEST, VALUES)
requests = st.builds(
    Request,
    st.integers(1, 247),
    st.sampled_from([READ, WRITE]),
    st.integers(0, 2000),
    st.integers(1, 8),
)


def test_requests_are_those_of_the_manual() -> None:
    assert Request(0x11, READ, 41004 - fr.FIRST_NUMBER, 3).frame() == MANUAL_READ
    frequency = fr.RUNNING_FREQUENCY
    assert Request(5, WRITE, frequency.address, frequency.raw(60.0)).frame() == MANUAL_WRITE


@pytest.mark.parametrize("frame", [MANUAL_READ, MANUAL_WRITE, MANUAL_WRITE_MANY, MANUAL_ANSWER])
def test_frames_of_the_manual_are_intact_and_decoded_by_pymodbus(frame: bytes) -> None:
    assert intact(frame)
    used, pdu = FramerRTU(DecodePDU(is_server=frame is not MANUAL_ANSWER)).handleFrame(frame, 0, 0)
    assert used == len(frame)
    assert pdu is not None
    assert pdu.dev_id == frame[0]


def test_answer_of_the_manual() -> None:
    answer = find_answer(Request(0x11, READ, 41004 - fr.FIRST_NUMBER, 3), MANUAL_ANSWER)
    assert answer is not None
    assert answer.registers == (6000, 3000, 1000)  # 60, 30 and 10 Hz


@pytest.mark.parametrize("block", BLOCKS, ids=str)
def test_the_echo_of_a_read_is_never_its_answer(block: fr.Block) -> None:
    for station in (1, 17, 247):
        request = Request(station, READ, block.address, block.count)
        assert find_answer(request, request.frame()) is None


@given(requests, st.binary(max_size=12), st.binary(max_size=12), st.integers(0, 2**32))
@settings(max_examples=200, deadline=None)
def test_the_answer_is_found_among_garbage(request: Request, before: bytes, after: bytes, seed: int) -> None:
    values = [random.Random(seed + index).randrange(65536) for index in range(request.content)]
    frame = answer_frame(request, values)
    answer = find_answer(request, before + frame + after)
    assert answer is not None
    assert answer.frame == frame


@given(requests, st.integers(0, 2**32), st.data())
@settings(max_examples=300, deadline=None)
def test_no_flip_of_up_to_three_bits_is_believed(request: Request, seed: int, data: st.DataObject) -> None:
    """CRC-16 has a Hamming distance of 4 over any Modbus frame."""
    values = [random.Random(seed + index).randrange(65536) for index in range(request.content)]
    frame = bytearray(answer_frame(request, values))
    for bit in data.draw(st.sets(st.integers(0, 8 * len(frame) - 1), min_size=1, max_size=3)):
        frame[bit // 8] ^= 1 << bit % 8
    assert find_answer(request, bytes(frame)) is None


@given(st.binary(max_size=300), requests)
@settings(max_examples=200, deadline=None)
def test_bytes_at_random_break_nothing(heard: bytes, request: Request) -> None:
    answer = find_answer(request, heard)
    assert answer is None or intact(answer.frame)
    assert isinstance(what_was_heard(request, heard), Heard)


@given(requests, requests)
@settings(max_examples=200, deadline=None)
def test_the_answer_to_another_request_is_not_taken(asked: Request, other: Request) -> None:
    """Where station, function, length, or what a write says, differ: all that an answer tells of itself."""
    same = (asked.station, asked.function) == (other.station, other.function) and (
        asked.content == other.content if asked.function == READ else asked == other
    )
    found = find_answer(asked, answer_frame(other, [7] * other.content))
    assert (found is not None) == same


@pytest.mark.parametrize(
    ("heard", "expected"),
    [
        (b"", Heard.NOTHING),
        (ANSWER[:-1] + bytes([ANSWER[-1] ^ 1]), Heard.BAD_CRC),
        (ANSWER[:7], Heard.BAD_CRC),
        (REQUEST.frame(), Heard.ECHO),
        (answer_frame(Request(2, READ, 200, 3), VALUES), Heard.OTHER_STATION),
        (answer_frame(Request(1, READ, 8, 2), [1, 4]), Heard.OTHER_ANSWER),
        (b"\x55\xaa\x55", Heard.GARBAGE),
    ],
)
def test_what_came_instead_is_told(heard: bytes, expected: Heard) -> None:
    assert what_was_heard(REQUEST, heard) is expected


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_fault_is_sorted_out(kind: str) -> None:
    """Whatever is done to an answer, either its own values come out or nothing does."""
    previous = Request(1, READ, fr.STATUS_BLOCK.address, fr.STATUS_BLOCK.count)
    believed = 0
    for seed in range(50):
        disturbance = Disturbance(LineFaults(1.0, (kind,), seed))
        disturbance.spoil(previous.frame(), answer_frame(previous, [1, 4]))
        answer = find_answer(REQUEST, disturbance.spoil(REQUEST.frame(), ANSWER).data)
        if answer is not None and not answer.exception:
            assert list(answer.registers) == VALUES
            believed += 1
    assert (believed == 50) == (kind in ("garbage", "echo", "twice", "old first", "late"))
