"""The driver and the emulated drive in virtual time: start-up check, stops, bad lines, bad drives."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any, TypeVar

import pytest

from daq.errors import DeviceLost, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator import DriveFaults, LineFaults
from drivers.mitsubishi_fr.emulator.line_faults import KINDS, Disturbance
from drivers.mitsubishi_fr.frames import WRITE, Request
from drivers.mitsubishi_fr.orders import OvertakenOrder
from drivers.mitsubishi_fr.registers import Command, Status
from drivers.mitsubishi_fr.settings import InverterMisconfigured
from tests.drivers.fr_bench import SETTINGS, Bench, VirtualLoop, in_virtual_time

T = TypeVar("T")
HZ = 6.67  # 200 rpm at 30 rpm/Hz
RAMP_S = 0.667  # 10 Hz in a second
LOOK_S = 0.17  # two looks of three answers each, one of them in turns with the poll
STOP = (fr.STATUS_AND_COMMAND.number, int(Command.STOP))
FORWARD = (fr.STATUS_AND_COMMAND.number, int(Command.FORWARD))
ZERO = (fr.RUNNING_FREQUENCY.number, 0)


def on_bench(work: Callable[[Bench], Coroutine[Any, Any, T]], **setup: Any) -> T:
    async def run(loop: VirtualLoop) -> T:
        bench = Bench.new(loop, **setup)
        try:
            return await work(bench)
        finally:
            bench.line.mute = False
            await bench.keeper.close()

    return in_virtual_time(run)


async def latched(bench: Bench, within_s: float) -> InstrumentError:
    """Return the error that the keeper finds within a time."""
    end_s = bench.loop.time() + within_s
    while bench.keeper.error is None:
        assert bench.loop.time() < end_s, "nothing was noticed"
        await bench.wait(0.02)
    return bench.keeper.error


def test_all_wrong_parameters_are_listed_at_once_and_nothing_is_written() -> None:
    wrong = {1: 900, 7: 0, 79: 2, 117: 1, 118: 96, 120: 0, 122: 9999, 340: 0, 502: 2, 549: 0}

    async def work(bench: Bench) -> tuple[InverterMisconfigured, list[tuple[int, int]]]:
        with pytest.raises(InverterMisconfigured, match="nothing was moved") as caught:
            await bench.keeper.check_in()
        return caught.value, bench.line.writes()

    error, writes = on_bench(work, parameters=wrong)
    found = {int(problem.key.split()[0].removeprefix("Pr.")) for problem in error.problems}
    assert found == set(wrong) - {117}
    assert all(problem.key in str(error) and problem.allowed in str(error) for problem in error.problems)
    assert writes == []


@pytest.mark.parametrize(
    ("raw", "match"),
    [
        (9999, r"Pr\.122 .* = 9999 \(off\): 0\.5 to 2 s"),
        (0, r"Pr\.122 .* = 0 \(trips in network operation\)"),
        (21, r"Pr\.122 .* = 2\.1 s: 0\.5 to 2 s"),
        (4, r"Pr\.122 .* = 0\.4 s: 0\.5 to 2 s"),
    ],
)
def test_no_start_without_a_watchdog_that_helps(raw: int, match: str) -> None:
    async def work(bench: Bench) -> None:
        await bench.keeper.check_in()

    with pytest.raises(InverterMisconfigured, match=match):
        on_bench(work, parameters={122: raw})


def test_a_tripped_drive_is_refused_and_not_reset() -> None:
    async def work(bench: Bench) -> list[tuple[int, int]]:
        bench.drive.trip(0x30)
        with pytest.raises(InstrumentRefused, match=r"it has tripped: E\.THT") as caught:
            await bench.keeper.check_in()
        assert caught.value.code == "E.THT"
        return bench.line.writes()

    assert on_bench(work) == []


def test_it_runs_at_the_set_speed_and_keeps_the_watchdog_quiet() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await bench.wait(30.0)
        state = await bench.keeper.look()
        assert (state.running, state.fault, state.degraded) == (True, "", False)
        assert state.output_frequency_hz == HZ
        assert state.speed_rpm == pytest.approx(200.1, abs=1e-9)
        assert bench.keeper.error is None
        assert bench.line.health.unanswered == 0

    on_bench(work)


def test_a_stop_ramps_to_zero_and_then_withdraws_run() -> None:
    """Category 1 of IEC 60204-1: power goes only once it stands."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        began_s, written = bench.loop.time(), len(bench.line.writes())
        await bench.motor.stop()
        assert bench.line.writes()[written:] == [ZERO, STOP]
        assert bench.load.at(bench.withdrawn_s()) <= 0.05
        assert bench.withdrawn_s() - began_s == pytest.approx(RAMP_S, abs=LOOK_S)
        assert not (await bench.keeper.look()).running
        await bench.wait(2.0)
        assert bench.keeper.error is None

    on_bench(work)


def test_a_stop_waits_for_the_measured_speed_where_there_is_one() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        began_s = bench.loop.time()
        # The crank lags behind the output by 0.2 s.
        await bench.motor.stop(lambda: bench.load.at(bench.loop.time() - 0.2))
        return bench.withdrawn_s() - began_s

    assert on_bench(work) == pytest.approx(RAMP_S + 0.2, abs=LOOK_S)


def test_a_measured_speed_that_is_no_number_is_not_waited_for() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        began_s = bench.loop.time()
        await bench.motor.stop(lambda: float("nan"))
        return bench.withdrawn_s() - began_s

    assert on_bench(work) == pytest.approx(RAMP_S, abs=LOOK_S)


def test_where_the_ramp_overruns_run_is_withdrawn_at_once() -> None:
    """A measured speed that does not fall: run goes after 1.5 ramps, whatever the output says."""

    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        began_s = bench.loop.time()
        await bench.motor.stop(lambda: HZ)
        assert any("still at 6.67 Hz" in event.text for event in bench.diary.take())
        return bench.withdrawn_s() - began_s

    assert on_bench(work) == pytest.approx(1.5 * RAMP_S, abs=LOOK_S)


def test_a_stuck_drive_is_left_to_its_watchdog() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(stuck=True))
        with pytest.raises(InstrumentSilent, match=r"it still runs.* its watchdog stops it within 1 s"):
            await bench.motor.stop()
        silent_s = bench.line.sent[-1][0]
        await bench.wait(2.0)
        assert bench.line.sent[-1][0] == silent_s
        assert bench.line.writes()[-3:] == [STOP] * 3
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


@pytest.mark.parametrize("seed", range(6))
def test_one_percent_of_bad_answers_does_not_move_the_speed(seed: int) -> None:
    async def work(bench: Bench) -> tuple[float, int]:
        await bench.run_at(HZ)
        bench.line.disturbance = Disturbance(LineFaults(0.01, ("drop", "flip"), seed))
        worst = 0.0
        for _ in range(300):
            await bench.wait(0.1)
            worst = max(worst, abs(bench.load.at(bench.loop.time()) / HZ - 1.0))
        assert bench.keeper.error is None
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
            if bench.keeper.error is not None:
                break
            assert bench.load.at(bench.loop.time()) == HZ
            assert bench.motor.state is not None
            assert bench.motor.state.output_frequency_hz == HZ
        else:
            assert bench.motor.state is not None
            assert bench.motor.state.degraded
            assert any(event.code == "inverter.line" for event in bench.diary.take())
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
                await bench.keeper.order(bench.motor.set_frequency(hz, bench.loop.time() + 3.0))
            except InstrumentSilent:
                continue
            except InstrumentError:
                break
            await bench.wait(1.0)
            if bench.keeper.error is None:
                assert bench.load.at(bench.loop.time()) == hz
        await bench.keeper.close()
        await bench.wait(4.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_lost_answer_to_run_is_looked_into_and_not_repeated() -> None:
    async def work(bench: Bench) -> list[tuple[int, int]]:
        await bench.keeper.check_in()
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        respond = bench.line.respond

        def without_answers_to_commands(request: Request) -> bytes:
            answer = respond(request)
            return b"" if request.function == WRITE else answer

        bench.line.respond = without_answers_to_commands
        await bench.motor.run_forward(bench.loop.time() + 3.0)
        return bench.line.writes()

    assert on_bench(work).count(FORWARD) == 1


def test_a_set_value_that_is_acknowledged_and_forgotten_is_noticed_and_stops_the_motor() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.RUNNING_FREQUENCY.number})))
        began_s = bench.loop.time()
        with pytest.raises(InstrumentRefused, match=r"not obeyed: 40014 .* it reads 667") as caught:
            await bench.keeper.order(bench.motor.set_frequency(3.0, began_s + 3.0))
        assert bench.keeper.error is caught.value
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        return (
            next(at_s for at_s, request in bench.line.sent if at_s > began_s and request.content == 0)
            - began_s
        )

    assert on_bench(work) < 0.5  # read back within 0.2 s, then the first word of the stop


def test_a_run_command_that_is_forgotten_is_noticed() -> None:
    async def work(bench: Bench) -> None:
        await bench.keeper.check_in()
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.STATUS_AND_COMMAND.number})))
        with pytest.raises(InstrumentRefused, match="not obeyed: run forward; it reads 0"):
            await bench.keeper.order(bench.motor.run_forward(bench.loop.time() + 3.0))

    on_bench(work)


def test_an_output_that_does_not_follow_is_noticed_after_its_ramp() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(stuck=True))
        began_s = bench.loop.time()
        await bench.motor.set_frequency(8.0, began_s + 3.0)
        error = await latched(bench, 5.0)
        assert "its output is at 6.67 Hz where 8 Hz is due" in str(error)
        noticed_s = bench.loop.time() - began_s
        await bench.wait(12.0)  # a ramp that overruns, three stops in vain, its watchdog, its ramp
        assert bench.load.at(bench.loop.time()) == 0.0
        return noticed_s

    ramp_s = 0.133
    assert on_bench(work) < 1.5 * ramp_s + 0.5 + 0.3


def test_somebody_elses_set_value_stops_the_motor() -> None:
    async def work(bench: Bench) -> str:
        await bench.run_at(HZ)
        bench.drive.access(fr.RUNNING_FREQUENCY.number, 1, [900])
        error = await latched(bench, 0.5)
        await bench.wait(3.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        return error.code if isinstance(error, InstrumentRefused) else ""

    assert on_bench(work) == "foreign"


def test_a_trip_is_recorded_with_code_and_time_and_never_reset() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        tripped_s = bench.loop.time()
        bench.drive.trip(0x10)
        error = await latched(bench, 1.0)
        assert error.code == "E.OC1"
        event = next(event for event in bench.diary.take() if event.code == "inverter.E.OC1")
        assert 0.0 <= event.time_ns * 1e-9 - tripped_s < 0.3  # one poll period and its answers
        await bench.wait(3.0)
        writes = bench.line.writes()
        assert writes[-1] == STOP  # so that a reset at the panel does not let it run
        assert fr.INVERTER_RESET.number not in [number for number, _ in writes]
        assert (await bench.motor.history())[:2] == ("E.OC1", "")

    on_bench(work)


def test_a_drive_fault_in_an_answer_stops_the_motor() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(exceptions={fr.OUTPUT_FREQUENCY.number: (4, 1)}))
        error = await latched(bench, 1.0)
        assert error.code == "04"
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_silence_is_noticed_within_a_second_and_the_watchdog_does_the_rest() -> None:
    async def work(bench: Bench) -> tuple[float, float]:
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
        return noticed_s, ramps[0].started_s - last_frame_s

    noticed_s, tripped_s = on_bench(work)
    assert noticed_s <= 1.0
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
            await bench.keeper.look()
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


def test_a_program_that_slept_finds_it_stopped_and_does_not_run_it_again() -> None:
    """SIGSTOP for 5 s: the drive has tripped, the latch says so, and the order that lay waiting is void."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        order = bench.keeper.order(bench.motor.set_frequency(9.0, bench.loop.time() + 3.0))
        written = len(bench.line.writes())
        bench.loop.sleep(5.0)
        bench.drive.settle()
        with pytest.raises(OvertakenOrder, match=r"it came too late|a stop overtook it"):
            await order
        assert await latched(bench, 1.0)
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        assert all(write in (STOP, ZERO) for write in bench.line.writes()[written:])

    on_bench(work)


def test_a_motor_that_nobody_looks_after_is_stopped() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await asyncio.sleep(SETTINGS.unattended_s + 0.5)
        assert bench.keeper.error is not None
        assert bench.keeper.error.code == "unattended"
        await asyncio.sleep(2.0)
        bench.drive.settle()
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_stop_overtakes_an_order_under_way() -> None:
    """Run forward waits for its answers while somebody stops: it may not run on after that."""

    async def work(bench: Bench) -> list[tuple[int, int]]:
        await bench.keeper.check_in()
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        starting = asyncio.create_task(bench.motor.run_forward(bench.loop.time() + 3.0))
        await asyncio.sleep(0.001)
        await bench.motor.stop()
        with pytest.raises(OvertakenOrder, match="a stop overtook it"):
            await starting
        await bench.wait(1.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        return bench.line.writes()

    assert FORWARD not in on_bench(work)


def test_closing_stops_the_motor_and_hands_the_drive_back() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await bench.keeper.close()
        assert bench.line.writes()[-3:] == [ZERO, STOP, (fr.OPERATION_MODE.number, fr.CHOOSE_PANEL)]
        await bench.wait(5.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        assert bench.drive.access(fr.FAULTS[0].number, 1, None) == [0]

    on_bench(work)


def test_closing_without_an_answer_still_tries_to_stop() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.line.mute, began_s = True, bench.loop.time()
        await bench.keeper.close()
        assert bench.loop.time() - began_s < 4.0
        assert ZERO in bench.line.writes()
        assert STOP in bench.line.writes()
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_reset_by_a_person_is_sent_once() -> None:
    async def work(bench: Bench) -> None:
        bench.drive.trip(0x30)
        await bench.motor.reset()
        assert bench.line.writes() == [(fr.INVERTER_RESET.number, 0)]
        assert (await bench.motor.look()).fault == ""

    on_bench(work)


def test_a_running_motor_is_not_reset() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        with pytest.raises(InstrumentRefused, match="a reset would let the motor coast"):
            await bench.motor.reset()

    on_bench(work)


def test_a_drive_that_stays_at_its_panel_is_refused() -> None:
    async def work(bench: Bench) -> None:
        bench.drive.access(fr.OPERATION_MODE.number, 1, [fr.CHOOSE_PANEL])
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.OPERATION_MODE.number})))
        await bench.keeper.check_in()
        with pytest.raises(InstrumentRefused, match=r"it stays in operation mode 1.* Pr\.79 and Pr\.340"):
            await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)

    on_bench(work)


def test_a_set_value_out_of_the_drives_range_changes_nothing() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        with pytest.raises(InstrumentRefused, match=r"exception 03 .* at 40014"):
            await bench.keeper.order(bench.motor.set_frequency(450.0, bench.loop.time() + 3.0))
        await bench.wait(1.0)
        assert bench.keeper.error is None
        assert bench.load.at(bench.loop.time()) == HZ

    on_bench(work)


def test_status_bits_are_those_that_the_driver_reads() -> None:
    async def work(bench: Bench) -> int:
        await bench.run_at(HZ)
        values = bench.drive.access(fr.STATUS_AND_COMMAND.number, 1, None)
        assert isinstance(values, list)
        return values[0]

    assert on_bench(work) == Status.RUNNING | Status.FORWARD | Status.UP_TO_FREQUENCY


def test_a_watchdog_of_two_seconds_is_the_longest_allowed() -> None:
    settings = replace(SETTINGS, maximum_speed_rpm=3600.0)

    async def work(bench: Bench) -> float:
        await bench.keeper.check_in()
        return bench.motor.parameters.watchdog_s

    assert on_bench(work, parameters={122: 20}, settings=settings) == pytest.approx(2.0, abs=1e-9)
