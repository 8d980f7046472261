"""The driver of drives that trip, do not obey, or obey somebody else, in virtual time."""

from __future__ import annotations

import asyncio
import threading

import pytest

from daq.errors import DeviceLost, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr import poller
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator.drive import DriveFaults
from drivers.mitsubishi_fr.frames import Request
from drivers.mitsubishi_fr.motor import STEP_S, WITHDRAWALS
from drivers.mitsubishi_fr.registers import Command
from tests.drivers.fr_bench import HZ, RAMP_S, SETTINGS, STOP, Bench, latched, on_bench


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


def test_a_set_value_that_is_acknowledged_and_forgotten_is_noticed_and_stops_the_motor() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.RUNNING_FREQUENCY.number})))
        began_s = bench.loop.time()
        with pytest.raises(InstrumentRefused, match=r"not obeyed: 40014 .* it reads 667") as caught:
            await bench.poller.order(bench.motor.set_frequency(3.0, began_s + 3.0))
        assert bench.poller.error is caught.value
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        return bench.withdrawn_s() - began_s

    assert on_bench(work) < 0.5  # read back within 0.2 s, then the first word of the stop


@pytest.mark.parametrize("starts", [False, True])
@pytest.mark.parametrize("after_s", [0.0, 0.02, 0.05])
def test_an_order_to_a_drive_that_falls_silent_meanwhile_ends_when_that_is_noticed(
    after_s: float, starts: bool
) -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        by_s = bench.loop.time() + 3.0
        order = bench.motor.run_forward(by_s) if starts else bench.motor.set_frequency(8.0, by_s)
        given = asyncio.create_task(bench.poller.order(order))
        await asyncio.sleep(after_s)
        bench.line.mute, since_s = True, bench.loop.time()
        with pytest.raises(InstrumentSilent) as caught:
            await given
        assert caught.value is bench.poller.error
        noticed_s = bench.loop.time() - since_s
        await bench.wait(0.5)
        assert bench.withdrawn_s() - since_s - noticed_s < 0.05
        bench.line.mute = False
        await bench.wait(2.0)
        assert bench.line.writes()[-1] in (STOP, (fr.OPERATION_MODE.number, fr.CHOOSE_PANEL))
        assert bench.load.at(bench.loop.time()) == 0.0
        return noticed_s

    assert on_bench(work) < SETTINGS.silent_s + SETTINGS.answer_s


def test_an_order_during_which_an_error_is_met_ends_with_that_and_the_next_is_not_begun() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        given = asyncio.create_task(
            bench.poller.order(bench.motor.set_frequency(8.0, bench.loop.time() + 3.0))
        )
        await asyncio.sleep(0.01)
        met = bench.motor.refused("it is odd")
        bench.poller._begin_to_make_safe(met)
        with pytest.raises(InstrumentRefused, match="it is odd"):
            await given
        with pytest.raises(InstrumentRefused, match="it is odd"):
            await bench.poller.order(bench.motor.run_forward(bench.loop.time() + 3.0))
        await bench.wait(2.0)
        assert bench.line.writes()[-1] == STOP
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_first_order_that_an_error_ends_hands_the_drive_back() -> None:
    async def work(bench: Bench) -> None:
        bench.drive.access(fr.OPERATION_MODE.number, 1, [fr.CHOOSE_PANEL])
        await bench.poller.check_in()
        given = asyncio.create_task(
            bench.poller.order(bench.motor.set_frequency(HZ, bench.loop.time() + 3.0))
        )
        chosen = (fr.OPERATION_MODE.number, fr.CHOOSE_NETWORK)
        end_s = bench.loop.time() + 1.0
        while chosen not in bench.line.writes():
            assert bench.loop.time() < end_s
            await asyncio.sleep(0.001)
        bench.poller._begin_to_make_safe(bench.motor.refused("it is odd"))
        with pytest.raises(InstrumentRefused, match="it is odd"):
            await given
        await bench.wait(2.0)
        await bench.poller.close()
        assert bench.line.writes()[-1] == (fr.OPERATION_MODE.number, fr.CHOOSE_PANEL)

    on_bench(work)


def test_a_run_command_that_is_forgotten_is_noticed() -> None:
    async def work(bench: Bench) -> None:
        await bench.poller.check_in()
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.STATUS_AND_COMMAND.number})))
        with pytest.raises(InstrumentRefused, match="not obeyed: run forward; it reads 0"):
            await bench.poller.order(bench.motor.run_forward(bench.loop.time() + 3.0))

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


def test_somebody_elses_stop_is_noticed() -> None:
    async def work(bench: Bench) -> InstrumentError:
        await bench.run_at(HZ)
        bench.drive.access(fr.STATUS_AND_COMMAND.number, 1, [Command.STOP])
        return await latched(bench, 1.0)

    assert "its output is at" in str(error := on_bench(work))
    assert "where 6.67 Hz is due. Check load, stall prevention (OL), who else commands it" in str(error)


def test_somebody_elses_run_is_noticed_and_stopped_once_the_drive_is_ours() -> None:
    async def work(bench: Bench) -> InstrumentError:
        await bench.poller.check_in()
        await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)
        await bench.wait(1.0)
        bench.drive.access(fr.STATUS_AND_COMMAND.number, 1, [Command.FORWARD])
        error = await latched(bench, 0.5)
        await bench.wait(2.0)
        assert bench.line.writes()[-1] == STOP
        assert bench.load.at(bench.loop.time()) == 0.0
        return error

    assert "Hz where 0 Hz is due" in str(on_bench(work))


def test_somebody_elses_run_before_anything_was_ordered_is_refused_and_left_alone() -> None:
    async def work(bench: Bench) -> InstrumentError:
        await bench.poller.check_in()
        bench.drive.access(fr.RUNNING_FREQUENCY.number, 1, [667])
        bench.drive.access(fr.STATUS_AND_COMMAND.number, 1, [Command.FORWARD])
        error = await latched(bench, 0.5)
        await bench.poller.close()
        assert bench.line.writes() == []
        return error

    assert on_bench(work).code == "running"


def test_a_gateway_that_loses_its_drive_is_a_lost_device_and_the_watchdog_does_the_rest() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(exceptions={fr.STATUS_AND_COMMAND.number: (0x0B, 10_000)}))
        before = len(bench.line.writes())
        assert isinstance(await latched(bench, 0.5), DeviceLost)
        await bench.wait(0.2)
        assert WITHDRAWALS > len(bench.line.writes()[before:]) > 0  # it is given time to come back
        await bench.wait(0.3)
        assert bench.line.writes()[before:] == [STOP] * WITHDRAWALS
        sent = len(bench.line.sent)
        await bench.wait(bench.motor.parameters.watchdog_s + RAMP_S)
        assert len(bench.line.sent) == sent
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_trip_is_recorded_with_code_and_time_and_never_reset() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        tripped_s = bench.loop.time()
        bench.drive.trip(0x10)
        error = await latched(bench, 1.0)
        assert error.code == "E.OC1"
        told = next(notice for notice in bench.notices.take() if notice.code == "inverter.E.OC1")
        assert 0.0 <= told.arrival_s - tripped_s < 0.3  # one poll period and its answers
        await bench.wait(3.0)
        writes = bench.line.writes()
        assert writes[-1] == STOP  # so that a reset at the panel does not let it run
        assert fr.INVERTER_RESET.number not in [number for number, _ in writes]
        assert (await bench.motor.look()).fault == "E.OC1"

    on_bench(work)


@pytest.mark.parametrize("before", [fr.STATUS_BLOCK, fr.MONITOR_BLOCK, fr.SET_BLOCK], ids=str)
def test_a_trip_between_two_answers_of_a_look_is_a_trip_too(before: fr.Block) -> None:
    """An output at zero whose status was read before must not pass for a drive that does not obey."""

    async def work(bench: Bench) -> str:
        await bench.run_at(HZ)
        await bench.wait(2.0)  # what is left of the time that an order may take
        respond, tripped = bench.line.respond, [False]

        def trips(request: Request) -> bytes:
            if not tripped[0] and (request.address, request.content) == (before.address, before.count):
                tripped[0] = True
                bench.drive.trip(0x10)
            return respond(request)

        bench.line.respond = trips
        return (await latched(bench, 1.0)).code

    assert on_bench(work) == "E.OC1"


def test_a_drive_fault_in_an_answer_stops_the_motor() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(exceptions={fr.OUTPUT_FREQUENCY.number: (4, 1)}))
        error = await latched(bench, 1.0)
        assert error.code == "04"
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_drive_that_stays_at_its_panel_is_refused() -> None:
    async def work(bench: Bench) -> None:
        bench.drive.access(fr.OPERATION_MODE.number, 1, [fr.CHOOSE_PANEL])
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.OPERATION_MODE.number})))
        await bench.poller.check_in()
        with pytest.raises(InstrumentRefused, match=r"it stays in operation mode 1.* Pr\.79 and Pr\.340"):
            await bench.motor.set_frequency(HZ, bench.loop.time() + 3.0)

    on_bench(work)


def test_a_set_value_out_of_the_drives_range_changes_nothing() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        with pytest.raises(InstrumentRefused, match=r"exception 03 .* at 40014"):
            await bench.poller.order(bench.motor.set_frequency(450.0, bench.loop.time() + 3.0))
        await bench.wait(1.0)
        assert bench.poller.error is None
        assert bench.load.at(bench.loop.time()) == HZ

    on_bench(work)


def test_a_drive_that_is_busy_for_good_is_stopped_by_its_watchdog() -> None:
    """It answers everything, so that its line is not silent, and tells nothing: nobody knows what it does."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        busy = dict.fromkeys((fr.STATUS_AND_COMMAND.number, fr.RUNNING_FREQUENCY.number), (0x06, 10_000))
        bench.drive.put_faults(DriveFaults(exceptions=busy))
        # Seen last up to a poll ago, blind for a watchdog and a silence, and the look that ends it takes one.
        watchdog_s = bench.motor.parameters.watchdog_s
        error = await latched(bench, watchdog_s + 2 * SETTINGS.silent_s + SETTINGS.poll_s)
        assert isinstance(error, InstrumentSilent)
        await bench.wait(WITHDRAWALS * 2 * STEP_S + watchdog_s + RAMP_S)
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_keeper_that_fails_stops_the_motor_before_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    read, shown = threading.Event(), threading.Event()

    def stalled(error: BaseException | None) -> None:
        read.wait(5.0)
        shown.set()

    async def work(bench: Bench) -> float:
        async def fail() -> None:
            raise ZeroDivisionError("a fault of ours")

        await bench.run_at(HZ)
        monkeypatch.setattr(bench.motor, "heed_stop_line", fail)
        began_s = bench.loop.time()
        error = await latched(bench, within_s=0.5)
        assert isinstance(error, InstrumentRefused)
        assert "its keeper failed: ZeroDivisionError" in str(error)
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        return bench.withdrawn_s() - began_s

    monkeypatch.setattr(poller, "show_fault", stalled)
    try:
        assert on_bench(work) < 0.5
        assert not shown.is_set()
    finally:
        read.set()
        assert shown.wait(5.0)
