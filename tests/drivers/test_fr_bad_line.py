"""The driver on lines that lose, spoil or delay what is said, in virtual time."""

from __future__ import annotations

import pytest

from daq.errors import DeviceLost, InstrumentError, InstrumentSilent
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, Disturbance, LineFaults
from drivers.mitsubishi_fr.frames import WRITE, Request
from drivers.mitsubishi_fr.registers import (
    CHOOSE_NETWORK,
    CHOOSE_PANEL,
    OPERATION_MODE,
    RUNNING_FREQUENCY,
    STATUS_AND_COMMAND,
)
from tests.drivers.fr_bench import FORWARD, HZ, STOP, ZERO, Bench, latched, on_bench


@pytest.mark.parametrize("seed", range(6))
def test_one_percent_of_bad_answers_does_not_move_the_speed(seed: int) -> None:
    async def work(bench: Bench) -> tuple[float, int]:
        await bench.run_at(HZ)
        bench.line.disturbance = Disturbance(LineFaults(0.01, ("drop", "flip"), seed))
        worst = 0.0
        for _ in range(300):
            await bench.wait(0.1)
            worst = max(worst, abs(bench.load.at(bench.loop.time()) / HZ - 1.0))
        assert bench.poller.error is None
        return worst, bench.line.health.unanswered

    worst, unanswered = on_bench(work)
    assert worst <= 0.01
    assert unanswered > 0


@pytest.mark.parametrize("kinds", [("drop", "flip"), tuple(KINDS)], ids=["lost or corrupted", "all kinds"])
@pytest.mark.parametrize("seed", range(6))
def test_a_fifth_of_bad_answers_leaves_it_running_or_safely_stopped(
    seed: int, kinds: tuple[str, ...]
) -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.disturbance = Disturbance(LineFaults(0.2, kinds, seed))
        for _ in range(300):
            await bench.wait(0.1)
            if bench.poller.error is not None:
                break
            assert bench.load.at(bench.loop.time()) == HZ
            assert bench.motor.state is not None
            assert bench.motor.state.output_frequency_hz == HZ
        else:
            assert bench.motor.state is not None
            assert bench.motor.state.degraded
            assert any(notice.code == "inverter.line" for notice in bench.notices.take())
            return
        await bench.wait(4.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


@pytest.mark.parametrize("seed", range(6))
def test_orders_on_a_bad_line_are_done_or_the_motor_stops(seed: int) -> None:
    """No speed that nobody asked for: after each order the output is where it has to be, or it stands."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.disturbance = Disturbance(LineFaults(0.2, tuple(KINDS), seed))
        for hz in (3.0, 8.0, 5.0):
            try:
                await bench.poller.order(bench.motor.set_frequency(hz, bench.loop.time() + 3.0))
            except InstrumentSilent:
                continue
            except InstrumentError:
                break
            await bench.wait(1.0)
            if bench.poller.error is None:
                assert bench.load.at(bench.loop.time()) == hz
        await bench.poller.close()
        await bench.wait(4.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def without_answers_to_writes(bench: Bench) -> None:
    respond = bench.line.respond

    def answers(request: Request) -> bytes:
        answer = respond(request)
        return b"" if request.function == WRITE else answer

    bench.line.respond = answers


def test_a_lost_answer_to_stop_is_looked_into_and_not_repeated() -> None:
    """The set value zero is absolute and may be said twice; run is withdrawn at the end, and seen to be."""

    async def work(bench: Bench) -> list[tuple[int, int]]:
        await bench.run_at(HZ)
        written = len(bench.line.writes())
        without_answers_to_writes(bench)
        await bench.motor.stop()
        assert not (await bench.poller.look()).running
        return bench.line.writes()[written:]

    assert on_bench(work, parameters={250: 0}) == [ZERO, ZERO, STOP]
    assert set(on_bench(work)) == {STOP, ZERO}  # as absolute, where the drive ramps down by itself


def test_a_lost_answer_to_the_choice_of_mode_is_looked_into_and_not_repeated() -> None:
    async def work(bench: Bench) -> list[tuple[int, int]]:
        bench.drive.access(OPERATION_MODE.number, 1, [CHOOSE_PANEL])
        await bench.poller.check_in()
        without_answers_to_writes(bench)
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        return bench.line.writes()

    assert on_bench(work).count((OPERATION_MODE.number, CHOOSE_NETWORK)) == 1


def test_no_parameter_is_written_and_nothing_reset_in_a_whole_session_on_a_bad_line() -> None:
    """Parameters are in an EEPROM, and a reset lets the motor coast: neither belongs into a run."""

    async def work(bench: Bench) -> set[int]:
        await bench.run_at(HZ)
        bench.line.disturbance = Disturbance(LineFaults(0.1, tuple(KINDS), 2))
        await bench.wait(10.0)
        await bench.poller.close()
        return {number for number, _ in bench.line.writes()}

    assert on_bench(work) == {STATUS_AND_COMMAND.number, OPERATION_MODE.number, RUNNING_FREQUENCY.number}


def test_a_lost_answer_to_run_is_looked_into_and_not_repeated() -> None:
    async def work(bench: Bench) -> list[tuple[int, int]]:
        await bench.poller.check_in()
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        without_answers_to_writes(bench)
        await bench.motor.run_forward(bench.loop.time() + 3.0)
        return bench.line.writes()

    assert on_bench(work).count(FORWARD) == 1


def test_silence_is_noticed_within_a_second_and_the_watchdog_does_the_rest() -> None:
    async def work(bench: Bench) -> tuple[float, float, float]:
        await bench.run_at(HZ)
        bench.line.mute, muted_s = True, bench.loop.time()
        last_frame_s = bench.line.sent[-1][0]
        error = await latched(bench, 2.0)
        noticed_s = bench.loop.time() - muted_s
        assert isinstance(error, InstrumentSilent)
        await bench.wait(3.0)
        assert STOP in bench.line.writes()  # without an answer it is tried all the same
        ramps = [output for output in bench.load.outputs if output.started_s > muted_s]
        assert bench.load.at(bench.loop.time()) == 0.0
        return noticed_s, bench.withdrawn_s() - muted_s, ramps[0].started_s - last_frame_s

    noticed_s, withdrawn_s, tripped_s = on_bench(work)
    assert noticed_s <= 1.0
    assert withdrawn_s - noticed_s <= 0.2
    assert tripped_s == pytest.approx(1.0, abs=0.1)  # Pr.122


def test_after_silence_nothing_is_sent_any_more() -> None:
    """Whoever asks later must not wind up the watchdog again."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.mute = True
        await latched(bench, 2.0)
        await bench.wait(1.0)
        bench.line.mute = False
        sent = len(bench.line.sent)
        with pytest.raises(InstrumentSilent, match="nothing is sent any more"):
            await bench.poller.look()
        await bench.wait(2.0)
        assert len(bench.line.sent) == sent

    on_bench(work)


def test_an_unplugged_line_is_a_lost_device() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.cut = True
        assert isinstance(await latched(bench, 0.3), DeviceLost)
        await bench.wait(2.5)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_line_that_is_lost_and_back_at_once_tells_the_drive_to_stop() -> None:
    """As that of a gateway which drops its connections; the drive's watchdog would take a second more."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.cut = bench.line.returns = True
        before, lost_s = len(bench.line.writes()), bench.loop.time()
        assert isinstance(await latched(bench, 0.3), DeviceLost)
        await bench.wait(0.1)
        assert bench.line.writes()[before:] == [STOP]
        assert bench.loop.time() - lost_s < 0.5
        await bench.wait(2.5)
        assert bench.load.at(bench.loop.time()) == 0.0
        assert not bench.motor.orders.ran

    on_bench(work)


def test_closing_without_an_answer_still_tries_to_stop() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.mute, began_s = True, bench.loop.time()
        await bench.poller.close()
        assert bench.loop.time() - began_s < 4.0
        assert STOP in bench.line.writes()
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)
