"""The driver and the emulated drive in virtual time: start-up check, running, stops, closing."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from dataclasses import replace
from functools import partial

import pytest

from daq.errors import InstrumentRefused, InstrumentSilent
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator.drive import DriveFaults
from drivers.mitsubishi_fr.emulator.line_faults import Disturbance, LineFaults, Piece
from drivers.mitsubishi_fr.frames import Answer, Request
from drivers.mitsubishi_fr.motor import OvertakenOrder
from drivers.mitsubishi_fr.registers import Command, Status
from drivers.mitsubishi_fr.settings import InverterMisconfigured, described
from tests.drivers.fr_bench import FORWARD, HZ, LOOK_S, RAMP_S, SETTINGS, STOP, ZERO, Bench, latched, on_bench

COASTS = {250: 0}
"""Once run is withdrawn; as delivered it ramps down by itself."""


def test_all_wrong_parameters_are_listed_at_once_and_nothing_is_written() -> None:
    wrong = {1: 900, 7: 0, 79: 2, 117: 1, 118: 96, 120: 0, 122: 9999, 340: 0, 502: 2, 549: 0}

    async def work(bench: Bench) -> tuple[InverterMisconfigured, list[tuple[int, int]]]:
        with pytest.raises(InverterMisconfigured, match="nothing was moved") as caught:
            await bench.poller.check_in()
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
        await bench.poller.check_in()

    with pytest.raises(InverterMisconfigured, match=match):
        on_bench(work, parameters={122: raw})


def test_a_tripped_drive_is_refused_and_not_reset() -> None:
    async def work(bench: Bench) -> list[tuple[int, int]]:
        bench.drive.trip(0x30)
        with pytest.raises(InstrumentRefused, match=r"it has tripped: E\.THT") as caught:
            await bench.poller.check_in()
        assert caught.value.code == "E.THT"
        return bench.line.writes()

    assert on_bench(work) == []


@pytest.mark.parametrize("how", ["at speed", "coming down", "told to run at zero"])
def test_a_drive_that_already_runs_is_refused_and_left_alone(how: str) -> None:
    """Somebody else's motor: whoever runs it has to stop it, and nothing here may brake or turn it."""

    async def work(bench: Bench) -> tuple[str, list[tuple[int, int]]]:
        bench.drive.access(fr.RUNNING_FREQUENCY.number, 1, [0 if how == "told to run at zero" else 667])
        bench.drive.access(fr.STATUS_AND_COMMAND.number, 1, [Command.FORWARD])
        bench.loop.sleep(1.0)
        if how == "coming down":
            bench.drive.access(fr.STATUS_AND_COMMAND.number, 1, [Command.STOP])
        with pytest.raises(InstrumentRefused, match="inverter at nowhere: it already runs") as caught:
            await bench.poller.check_in()
        await bench.poller.close()
        assert caught.value.code == "running"
        return str(caught.value), bench.line.writes()

    text, writes = on_bench(work)
    assert writes == []
    if how == "at speed":
        assert "6.67 Hz (200.1 rpm), its set value is 200.1 rpm; nothing was sent to it" in text
    assert "stop it there, and wait until the motor stands" in text


def test_a_set_value_that_somebody_left_does_not_hold_up_a_start() -> None:
    async def work(bench: Bench) -> bool:
        bench.drive.access(fr.RUNNING_FREQUENCY.number, 1, [667])
        await bench.poller.check_in()
        return (await bench.poller.look()).running

    assert not on_bench(work)


def test_it_runs_at_the_set_speed_and_keeps_the_watchdog_quiet() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await bench.wait(30.0)
        state = await bench.poller.look()
        assert (state.running, state.fault, state.degraded) == (True, "", False)
        assert state.output_frequency_hz == HZ
        assert state.speed_rpm == pytest.approx(200.1, abs=1e-9)
        assert bench.poller.error is None
        assert bench.line.health.unanswered == 0

    on_bench(work)


def test_a_stop_ramps_to_zero_and_then_withdraws_run() -> None:
    """Category 1 of IEC 60204-1, by a drive that would let it coast: power goes only once it stands."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        began_s, written = bench.loop.time(), len(bench.line.writes())
        await bench.motor.stop()
        assert bench.line.writes()[written:] == [ZERO, STOP]
        assert bench.load.at(bench.withdrawn_s()) <= 0.05
        assert bench.withdrawn_s() - began_s == pytest.approx(RAMP_S, abs=LOOK_S)
        assert not (await bench.poller.look()).running
        await bench.wait(2.0)
        assert bench.poller.error is None

    on_bench(work, parameters=COASTS)


@pytest.mark.parametrize("lag_s", [0.0, 0.2])
def test_a_drive_that_ramps_down_by_itself_is_told_to_at_once(lag_s: float) -> None:
    """Category 1 as well: nobody has to be there at the end of the ramp. The crank lags behind the output."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        began_s, written = bench.loop.time(), len(bench.line.writes())
        await bench.motor.stop(lambda: bench.load.at(bench.loop.time() - lag_s))
        assert bench.loop.time() - began_s == pytest.approx(RAMP_S + lag_s, abs=2 * LOOK_S)
        assert bench.line.writes()[written:] == [STOP, ZERO, STOP]
        assert bench.withdrawn_s() - began_s < LOOK_S
        assert bench.load.at(began_s + RAMP_S / 2) == pytest.approx(HZ / 2, abs=0.5)
        assert not (await bench.poller.look()).running
        await bench.wait(2.0)
        assert bench.poller.error is None
        codes = [notice.code for notice in bench.notices.take()]
        assert codes[-2:] == ["inverter.ramp", "inverter.off"]

    on_bench(work)


@pytest.mark.parametrize("forgotten", [fr.STATUS_AND_COMMAND, fr.RUNNING_FREQUENCY])
@pytest.mark.parametrize("parameters", [{}, COASTS])
def test_either_order_of_a_stop_brings_the_output_down_on_one_ramp(
    forgotten: fr.Register, parameters: dict[int, int]
) -> None:
    """One that is acknowledged and forgotten costs no second ramp: the other is obeyed."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({forgotten.number})))
        began_s = bench.loop.time()
        stop = asyncio.create_task(bench.motor.stop())
        coasts_late_s = 0.5 * RAMP_S if parameters and forgotten is fr.RUNNING_FREQUENCY else 0.0
        await bench.wait(RAMP_S + coasts_late_s + LOOK_S)
        assert bench.load.at(bench.loop.time()) == 0.0
        await asyncio.gather(stop, return_exceptions=True)
        assert bench.loop.time() - began_s < bench.motor.longest_stop_s(HZ) + 8 * LOOK_S

    on_bench(work, parameters=parameters)


def test_a_withdrawal_that_is_lost_is_sent_again_at_once() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        began_s, hears, lost = bench.loop.time(), bench.line.respond, list[Request]()

        def loses_the_first(request: Request) -> bytes:
            if (request.address, request.content) != STOP or lost:
                return hears(request)
            lost.append(request)
            return b""

        bench.line.respond = loses_the_first
        await bench.motor.stop()
        assert bench.loop.time() - began_s < 2 * RAMP_S  # 2.5 if it waited to see it overrun
        assert bench.load.at(bench.loop.time()) <= 0.05
        assert "inverter.stop" not in [notice.code for notice in bench.notices.take()]

    on_bench(work)


def test_after_a_stop_and_a_rest_it_runs_again_at_another_speed() -> None:
    """As from point to point of a sweep: nobody need look after it while it stands."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await bench.motor.stop()
        await bench.wait(60.0)
        await bench.run_at(HZ / 2)
        state = await bench.poller.look()
        assert state.running
        assert state.output_frequency_hz == pytest.approx(HZ / 2, abs=0.01)  # its step
        assert bench.poller.error is None

    on_bench(work)


def test_a_stop_waits_for_the_measured_speed_where_there_is_one() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        began_s = bench.loop.time()
        # The crank lags behind the output by 0.2 s.
        await bench.motor.stop(lambda: bench.load.at(bench.loop.time() - 0.2))
        return bench.withdrawn_s() - began_s

    assert on_bench(work, parameters=COASTS) == pytest.approx(RAMP_S + 0.2, abs=LOOK_S)


def test_a_measured_speed_that_is_no_number_is_not_waited_for() -> None:
    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        began_s = bench.loop.time()
        await bench.motor.stop(lambda: float("nan"))
        return bench.withdrawn_s() - began_s

    assert on_bench(work, parameters=COASTS) == pytest.approx(RAMP_S, abs=LOOK_S)


def test_where_the_ramp_overruns_run_is_withdrawn_at_once() -> None:
    """A measured speed that does not fall: run goes after 1.5 ramps, whatever the output says."""

    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        began_s = bench.loop.time()
        await bench.motor.stop(lambda: HZ)
        assert any("still at 6.67 Hz" in notice.text for notice in bench.notices.take())
        return bench.withdrawn_s() - began_s

    assert on_bench(work, parameters=COASTS) == pytest.approx(1.5 * RAMP_S, abs=LOOK_S)


def test_run_is_withdrawn_although_the_measured_speed_fails() -> None:
    def measured_hz() -> float:
        raise ZeroDivisionError("no counts in a turn")

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        written = len(bench.line.writes())
        with pytest.raises(ZeroDivisionError, match="no counts in a turn"):
            await bench.poller.stop(measured_hz)
        assert bench.line.writes()[written:] == [ZERO, STOP]
        assert not (await bench.poller.look()).running

    on_bench(work, parameters=COASTS)


def test_a_stop_that_never_ends_is_over_in_time_and_stays_an_error() -> None:
    """The drive takes every order and turns on: after the last withdrawal nothing more is sent."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(stuck=True))
        began_s = bench.loop.time()
        with pytest.raises(InstrumentSilent, match="nothing more is sent, so that its watchdog stops it"):
            await bench.poller.stop()
        # Four times 1.5 ramps; on top of each the order, the look before and the last look, in turns.
        over_s = bench.loop.time() - began_s - bench.motor.longest_stop_s(HZ)
        assert 0.0 < over_s < 4 * 2 * LOOK_S
        assert isinstance(bench.poller.error, InstrumentSilent)
        bench.drive.put_faults(DriveFaults())
        await bench.wait(bench.motor.parameters.watchdog_s + 0.1)
        assert bench.drive.access(fr.FAULTS[0].number, 1, None) == [fr.COMMUNICATION_FAULT]

    on_bench(work)


class SlowLine(Disturbance):
    """Every answer takes a tenth of a second more, so that a stop takes two."""

    def __init__(self) -> None:
        super().__init__(LineFaults())

    def spoil(self, request: bytes, answer: bytes) -> Piece:
        return Piece(0.1, answer)


def test_a_stop_is_carried_through_although_its_caller_gives_up() -> None:
    """On a slow line, nobody waits for the end of the stop."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        written = len(bench.line.writes())
        bench.line.disturbance = SlowLine()
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(bench.poller.stop(), 0.3)
        assert STOP not in bench.line.writes()[written:]
        await bench.wait(5.0)
        assert bench.line.writes()[written:] == [ZERO, STOP]
        assert bench.load.at(bench.loop.time()) == 0.0
        assert "inverter.off" in [notice.code for notice in bench.notices.take()]

    on_bench(work, parameters=COASTS)


def test_a_cut_does_not_wait_for_the_ramp_of_a_stop() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        written = len(bench.line.writes())
        stop = asyncio.create_task(bench.poller.stop())
        await bench.wait(0.1)
        assert bench.line.writes()[written:] == [ZERO]
        cut = asyncio.create_task(bench.poller.cut())
        await bench.wait(0.1)
        assert bench.line.writes()[written:] == [ZERO, STOP]
        await asyncio.gather(stop, cut)
        assert bench.poller.error is None
        codes = [notice.code for notice in bench.notices.take()]
        assert codes[-3:] == ["inverter.ramp", "inverter.cut", "inverter.off"]

    on_bench(work, parameters=COASTS)


@pytest.mark.parametrize(
    ("raw", "says", "highest_hz"),
    [
        (9999, "by Pr.250 the motor ramps down by itself (Pr.8)", HZ - 1.5),
        (65535, "ramps down by itself (Pr.8)", HZ - 1.5),
        (0, "coasts: inverter.off does not mean that the shaft stands", 0.0),
    ],
)
def test_a_cut_says_what_the_motor_then_does(raw: int, says: str, highest_hz: float) -> None:
    """Its ramp falls by 10 Hz in a second."""

    async def work(bench: Bench) -> float:
        await bench.run_at(HZ)
        cut = asyncio.create_task(bench.poller.cut())
        await bench.wait(0.2)
        put_out_hz = bench.load.at(bench.loop.time())
        await cut
        await bench.poller.cut()  # it stands or coasts: nothing to tell of
        told = [notice for notice in bench.notices.take() if notice.code == "inverter.cut"]
        assert [notice.level for notice in told] == ["warning"]
        assert "by Pr.250 the motor" in told[0].text
        assert says in told[0].text
        assert ("coasts once run is withdrawn" in described(bench.motor.parameters, 1)) == (raw == 0)
        await bench.poller.close()
        assert not any(output.on and output.started_s > bench.withdrawn_s() for output in bench.load.outputs)
        return put_out_hz

    left_hz = on_bench(work, parameters={250: raw})
    assert left_hz == 0.0 if highest_hz == 0.0 else highest_hz - 0.5 < left_hz < highest_hz + 0.5


def test_a_drive_that_would_turn_on_after_it_was_told_to_stop_is_refused() -> None:
    async def work(bench: Bench) -> None:
        await bench.poller.check_in()

    with pytest.raises(
        InverterMisconfigured, match=r"Pr\.250 stop selection = 5 s: 9999 \(ramps down\) or 0 s"
    ):
        on_bench(work, parameters={250: 50})


def test_a_stop_that_fails_after_its_caller_gave_up_stays_an_error() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        bench.drive.put_faults(DriveFaults(stuck=True))
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(bench.poller.stop(), 0.3)
        assert bench.poller.error is None
        assert isinstance(await latched(bench, bench.motor.longest_stop_s(HZ) + 2.0), InstrumentSilent)

    on_bench(work)


def test_an_order_that_is_given_up_takes_its_stop_not_with_it() -> None:
    """The ramp of the stop that follows an order not obeyed may outlast whoever gave the order."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        written = len(bench.line.writes())
        # Every order but the first is obeyed, and the ramp down takes 3.3 s.
        bench.drive.access(fr.DECELERATION_TIME.number, 1, [300])
        bench.drive.put_faults(DriveFaults(not_obeyed=frozenset({fr.RUNNING_FREQUENCY.number})))
        order = asyncio.create_task(
            bench.poller.order(bench.motor.set_frequency(8.0, bench.loop.time() + 3.0))
        )
        await latched(bench, 1.0)
        bench.drive.put_faults(DriveFaults())
        order.cancel()
        await bench.wait(8.0)
        assert bench.line.writes()[written:][-2:] == [ZERO, STOP]
        assert bench.load.at(bench.withdrawn_s()) <= 0.05

    on_bench(work, parameters=COASTS)


def test_closing_waits_for_a_stop_that_was_given_up() -> None:
    """That one still waits for a shaft when the closing one has seen the output at zero."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        with pytest.raises(asyncio.TimeoutError):
            await asyncio.wait_for(bench.poller.stop(lambda: HZ), 0.1)
        await bench.poller.close()
        assert bench.line.writes()[-1] == (fr.OPERATION_MODE.number, fr.CHOOSE_PANEL)
        sent = len(bench.line.sent)
        await asyncio.sleep(2.0)
        assert len(bench.line.sent) == sent

    on_bench(work)


@pytest.mark.parametrize("others", [False, True])
def test_a_program_that_slept_finds_it_stopped_and_does_not_run_it_again(others: bool) -> None:
    """SIGSTOP for 4 s: the drive has tripped, or others kept its watchdog quiet; the order that lay waiting
    is void."""

    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        order = bench.poller.order(bench.motor.set_frequency(9.0, bench.loop.time() + 3.0))
        written = len(bench.line.writes())
        for _ in range(8):
            bench.loop.sleep(0.5)
            if others:
                bench.drive.heard_frame()
        bench.drive.settle()
        with pytest.raises(OvertakenOrder, match=r"it came too late|a stop overtook it"):
            await order
        assert (await latched(bench, 1.0)).code == ("late" if others else "E.PUE")
        await bench.wait(2.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        assert all(write in (STOP, ZERO) for write in bench.line.writes()[written:])

    on_bench(work)


def test_a_motor_that_nobody_looks_after_is_stopped() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await asyncio.sleep(SETTINGS.unattended_s + 0.5)
        assert bench.poller.error is not None
        assert bench.poller.error.code == "unattended"
        await asyncio.sleep(2.0)
        bench.drive.settle()
        assert bench.load.at(bench.loop.time()) == 0.0

    on_bench(work)


def test_a_stop_overtakes_an_order_under_way() -> None:
    """Run forward waits for its answers while somebody stops: it may not run on after that."""

    async def work(bench: Bench) -> list[tuple[int, int]]:
        await bench.poller.check_in()
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


@pytest.mark.parametrize("order", ["set", "run"])
@pytest.mark.parametrize("parameters", [{}, COASTS])
@pytest.mark.parametrize("cut", [False, True])
def test_whenever_a_stop_overtakes_an_order_it_is_that_and_no_fault_of_the_drive(
    order: str, parameters: dict[int, int], cut: bool
) -> None:
    """Before it is sent, and while it is read back."""

    async def work(bench: Bench, after_s: float) -> None:
        motor, poller = bench.motor, bench.poller
        await poller.check_in()
        await motor.set_frequency(HZ, bench.loop.time() + 3.0)
        if order == "set":
            await motor.run_forward(bench.loop.time() + 3.0)
            await bench.wait(motor.parameters.ramp_s(0.0, HZ) + 0.3)
        told = (
            motor.run_forward(bench.loop.time() + 3.0)
            if order == "run"
            else motor.set_frequency(HZ / 2, bench.loop.time() + 3.0)
        )
        ordering = asyncio.create_task(poller.order(told))
        await asyncio.sleep(after_s)
        await (poller.cut() if cut else poller.stop())
        with suppress(OvertakenOrder):
            await ordering
        assert poller.error is None, after_s
        await bench.wait(1.5)
        assert poller.error is None, after_s
        assert bench.load.at(bench.loop.time()) == 0.0, after_s

    for after_s in (0.0071 * step for step in range(1, 16)):
        on_bench(partial(work, after_s=after_s), parameters=parameters)


def test_the_very_first_order_can_be_overtaken_too() -> None:
    """While it asks for the operation mode, the drive is not taken yet: no reason not to stop."""

    async def work(bench: Bench) -> list[tuple[int, int]]:
        await bench.poller.check_in()
        starting = asyncio.create_task(bench.motor.run_forward(bench.loop.time() + 3.0))
        await asyncio.sleep(0.001)
        assert not bench.motor.orders.taken
        assert bench.motor.orders.may_turn
        await bench.poller.close()
        with pytest.raises(OvertakenOrder, match="a stop overtook it"):
            await starting
        return bench.line.writes()

    assert FORWARD not in on_bench(work)


def test_closing_stops_the_motor_and_hands_the_drive_back() -> None:
    async def work(bench: Bench) -> None:
        await bench.run_at(HZ)
        await bench.poller.close()
        assert bench.line.writes()[-3:] == [ZERO, STOP, (fr.OPERATION_MODE.number, fr.CHOOSE_PANEL)]
        await bench.wait(5.0)
        assert bench.load.at(bench.loop.time()) == 0.0
        assert bench.drive.access(fr.FAULTS[0].number, 1, None) == [0]

    on_bench(work, parameters=COASTS)


def test_closing_ends_the_poll_although_an_answer_swallows_the_cancellation() -> None:
    """As `wait_for` of Python 3.11 does where both come at once."""

    async def work(bench: Bench) -> None:
        await bench.poller.check_in()
        ask, asking = bench.line.ask, asyncio.Event()

        async def deaf(request: Request) -> Answer:
            asking.set()
            answer = asyncio.ensure_future(ask(request))
            try:
                return await asyncio.shield(answer)
            except asyncio.CancelledError:
                return await answer

        bench.line.ask = deaf  # type: ignore[method-assign]
        await asking.wait()
        closing = asyncio.ensure_future(bench.poller.close())
        await asyncio.wait([closing], timeout=1.0)
        assert closing.done()
        sent = len(bench.line.sent)
        await asyncio.sleep(1.0)
        assert len(bench.line.sent) == sent

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
        await bench.poller.check_in()
        return bench.motor.parameters.watchdog_s

    assert on_bench(work, parameters={122: 20}, settings=settings) == pytest.approx(2.0, abs=1e-9)
