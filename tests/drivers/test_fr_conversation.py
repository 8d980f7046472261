"""What is asked twice and what is not, and that no late or foreign answer is ever believed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from typing import Any, TypeVar

import pytest
from pymodbus.constants import ExcCodes

from daq.errors import DeviceLost, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.conversation import Conversation
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, Disturbance, LineFaults
from drivers.mitsubishi_fr.frames import READ, Request
from drivers.mitsubishi_fr.registers import Block, Command
from tests.drivers.fr_bench import VirtualLine, VirtualLoop, answer_frame, in_virtual_time

T = TypeVar("T")
POLLS = (fr.STATUS_BLOCK, fr.MONITOR_BLOCK, fr.SET_BLOCK)
# A session at its worst: the same block again and again between others.
MIXED = (*POLLS, fr.SET_BLOCK, fr.SET_BLOCK, fr.MONITOR_BLOCK, fr.MONITOR_BLOCK, fr.STATUS_BLOCK)
SEEDS = range(150)


class Counter:
    """Answers the n-th request with n in every register, so that an answer shows which request it is of."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, request: Request) -> bytes:
        self.asked += 1
        return answer_frame(request, [self.asked] * request.content if request.function == READ else [])


class Script:
    """Answers with one exception after another, then as it should."""

    def __init__(self, *codes: int) -> None:
        self.codes = list(codes)

    def __call__(self, request: Request) -> bytes:
        # The marks that settle a conversation's doubt are none of the script's business.
        if request.function == READ and request.content > 4:
            return answer_frame(request, [0] * request.content)
        if self.codes:
            return answer_frame(request, ExcCodes(self.codes.pop(0)))
        return answer_frame(request, [4] * request.content)


def talking(
    respond: Callable[[Request], bytes],
    work: Callable[[Conversation, VirtualLine], Coroutine[Any, Any, T]],
    faults: LineFaults | None = None,
) -> T:
    async def talk(loop: VirtualLoop) -> T:
        line = VirtualLine(loop, respond, Disturbance(faults or LineFaults()))
        return await work(Conversation("inverter", "nowhere", 1, line, loop.time), line)

    return in_virtual_time(talk)


def wrong_values(faults: LineFaults, blocks: Sequence[Block]) -> tuple[int, int]:
    """Return how many reads ended with a value, and how many of these are of an earlier request."""
    counter = Counter()

    async def read_all(talk: Conversation, line: VirtualLine) -> tuple[int, int]:
        believed = wrong = 0
        for index in range(40):
            before = counter.asked
            try:
                values = await talk.read(blocks[index % len(blocks)], line.loop.time() + 1.0)
            except InstrumentSilent:
                continue
            believed += 1
            wrong += not all(value > before for value in values)
        return believed, wrong

    return talking(counter, read_all, faults)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.8])
def test_no_wrong_value_is_ever_believed(share: float) -> None:
    """All kinds of faults mixed: no value of an earlier request passes for that of a later one."""
    believed = wrong = 0
    for seed in SEEDS:
        one_believed, one_wrong = wrong_values(LineFaults(share, tuple(KINDS), seed), MIXED)
        believed, wrong = believed + one_believed, wrong + one_wrong
    assert wrong == 0
    assert believed > {0.02: 0.99, 0.3: 0.9, 0.8: 0.3}[share] * 40 * len(SEEDS)


def test_without_marks_late_answers_would_be_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test above can fail: it is the marks that it shows to work."""
    monkeypatch.setattr(Conversation, "_mark_before", lambda self, request: None)
    faults = [LineFaults(0.3, tuple(KINDS), seed) for seed in range(20)]
    assert sum(wrong_values(fault, MIXED)[1] for fault in faults) > 0


def test_a_clean_line_needs_no_marks_for_polling() -> None:
    counter = Counter()

    async def poll(talk: Conversation, line: VirtualLine) -> int:
        for block in (*POLLS, *POLLS):
            await talk.read(block, line.loop.time() + 1.0)
        return line.health.asked

    assert talking(counter, poll) == 1 + 2 * len(POLLS)  # the first settles what an earlier master left


def test_a_read_without_its_answer_is_asked_once_more() -> None:
    async def named(talk: Conversation, line: VirtualLine) -> tuple[int, float]:
        await talk.read(fr.STATUS_BLOCK, line.loop.time() + 1.0)
        line.mute = True
        began_s, asked = line.loop.time(), line.health.asked
        with pytest.raises(InstrumentSilent, match=r"no answer to 40014 .*heard nothing"):
            await talk.read(fr.SET_BLOCK, line.loop.time() + 10.0)
        return line.health.asked - asked, line.loop.time() - began_s

    exchanges, took_s = talking(Counter(), named)
    assert exchanges <= 6  # the request twice, and the marks between
    assert took_s < 1.3


def test_a_set_value_is_written_twice_and_a_command_once() -> None:
    async def work(talk: Conversation, line: VirtualLine) -> list[tuple[int, int]]:
        line.mute = True
        with pytest.raises(InstrumentSilent, match="no answer to 40014"):
            await talk.write(fr.RUNNING_FREQUENCY, 667, line.loop.time() + 10.0)
        assert not await talk.command(fr.STATUS_AND_COMMAND, Command.FORWARD, line.loop.time() + 10.0)
        return line.writes()

    assert talking(Counter(), work) == [(40014, 667), (40014, 667), (40009, 2)]


@pytest.mark.parametrize("code", [1, 2, 3, 4])
def test_a_refusal_is_final_and_names_the_register(code: int) -> None:
    async def work(talk: Conversation, line: VirtualLine) -> int:
        with pytest.raises(
            InstrumentRefused, match=rf"exception 0{code} .* at 40014 .running frequency, RAM, p\. 210"
        ) as caught:
            await talk.write(fr.RUNNING_FREQUENCY, 667, line.loop.time() + 1.0)
        assert caught.value.code == f"0{code}"
        return len(line.writes())

    assert talking(Script(code, code), work) == 1


def test_busy_is_asked_again_after_50_ms() -> None:
    async def work(talk: Conversation, line: VirtualLine) -> list[float]:
        await talk.write(fr.RUNNING_FREQUENCY, 667, line.loop.time() + 1.0)
        return [at_s for at_s, _ in line.sent]

    first_s, second_s = talking(Script(6), work)
    assert 0.05 <= second_s - first_s < 0.1


@pytest.mark.parametrize("code", [5, 6])
def test_busy_for_ever_ends_at_the_deadline(code: int) -> None:
    async def work(talk: Conversation, line: VirtualLine) -> float:
        began_s = line.loop.time()
        with pytest.raises(InstrumentSilent, match="the drive is busy"):
            await talk.read(fr.STATUS_BLOCK, began_s + 1.0)
        return line.loop.time() - began_s

    assert 0.9 < talking(Script(*[code] * 100), work) < 1.2


def test_an_acknowledged_write_is_not_repeated_but_a_read_is_polled() -> None:
    async def work(talk: Conversation, line: VirtualLine) -> tuple[int, tuple[int, ...]]:
        await talk.write(fr.RUNNING_FREQUENCY, 667, line.loop.time() + 1.0)
        values = await talk.read(fr.SET_BLOCK, line.loop.time() + 1.0)
        return len(line.writes()), values

    assert talking(Script(5, 5, 5), work) == (1, (4,))


@pytest.mark.parametrize("code", [0x0A, 0x0B])
def test_a_gateway_without_its_drive_is_a_lost_device(code: int) -> None:
    async def work(talk: Conversation, line: VirtualLine) -> None:
        await talk.read(fr.STATUS_BLOCK, line.loop.time() + 1.0)

    with pytest.raises(DeviceLost, match=f"exception {code:02X} .gateway"):
        talking(Script(code), work)


def test_a_drive_without_the_marks_registers_is_told_so() -> None:
    async def work(talk: Conversation, line: VirtualLine) -> None:
        await talk.read(fr.STATUS_BLOCK, line.loop.time() + 1.0)

    with pytest.raises(InstrumentRefused, match=r"exception 02 .* at 40501 to 40505"):
        talking(lambda request: answer_frame(request, ExcCodes.ILLEGAL_ADDRESS), work)


def test_what_comes_too_late_is_not_sent() -> None:
    async def work(talk: Conversation, line: VirtualLine) -> int:
        for _ in range(2):
            assert not await talk.command(fr.STATUS_AND_COMMAND, Command.FORWARD, line.loop.time() - 0.001)
        return len(line.sent)

    assert talking(Counter(), work) == 0


def test_hushed_it_sends_nothing() -> None:
    async def work(talk: Conversation, line: VirtualLine) -> int:
        talk.hush()
        with pytest.raises(InstrumentSilent, match="nothing is sent any more"):
            await talk.read(fr.STATUS_BLOCK, line.loop.time() + 1.0)
        return len(line.sent)

    assert talking(Counter(), work) == 0


def test_a_stop_waits_for_one_exchange_only() -> None:
    """While a read goes through its repetitions on a dead line, the stop goes out within one answer time."""

    async def work(talk: Conversation, line: VirtualLine) -> float:
        line.mute = True
        reading = asyncio.create_task(talk.read(fr.STATUS_BLOCK, line.loop.time() + 5.0))
        await asyncio.sleep(0.05)
        wanted_s = line.loop.time()
        await talk.command(fr.STATUS_AND_COMMAND, Command.STOP, line.loop.time() + 5.0)
        with pytest.raises(InstrumentSilent, match="no answer"):
            await reading
        return next(at_s for at_s, request in line.sent if request.function != READ) - wanted_s

    assert talking(Counter(), work) < 0.21


@pytest.mark.parametrize("share", [0.001, 0.01, 0.1])
def test_bad_crcs_are_counted_and_above_five_in_ten_seconds_the_line_is_degraded(share: float) -> None:
    async def work(talk: Conversation, line: VirtualLine) -> tuple[int, int, bool]:
        for index in range(400):
            with suppress(InstrumentSilent):  # at 10 % one in a hundred reads fails twice
                await talk.read(POLLS[index % 3], line.loop.time() + 2.0)
        return line.health.unanswered, line.health.crc_errors, line.health.degraded

    unanswered, crc_errors, degraded = talking(Counter(), work, LineFaults(share, ("flip",), 1))
    # Of three bits at most some hit station, function or length, so that it is no frame of ours any more.
    assert 0.5 * unanswered <= crc_errors <= unanswered
    assert unanswered == pytest.approx(400 * share, abs=3.0 * (400 * share) ** 0.5 + 2.0)
    assert degraded == (share == 0.1)
