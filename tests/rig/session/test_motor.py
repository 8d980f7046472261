"""The motor comes up, is trimmed until the shaft turns as wanted, and is held from then on."""

from __future__ import annotations

import math

import pytest

from daq.errors import InstrumentRefused, InterlockTripped
from daq.time_base.clocks import CardClock
from rig.session.interlock import OVERSPEED_S
from rig.session.motor import Motor, MotorActuator
from sim_twin.rigs.crank_drive import SpeedDrive as CrankDrive
from tests.rig.session.shafts import STEP_RPM, FakeDrive, SteppedClock

RAD_S = 200.0 * math.tau / 60.0


def motor(drive: FakeDrive, rpm: float = 200.0) -> Motor:
    speed = rpm * math.tau / 60.0
    return Motor(drive, speed, drive.clock.sleep, drive.shaft_rpm, drive.clock)


def started(drive: FakeDrive, rpm: float = 200.0) -> Motor:
    moved = motor(drive, rpm)
    moved.arm(soft=True)
    moved.start(soft=True)
    return moved


def test_a_motor_comes_through_the_speeds_of_its_path_and_is_trimmed_at_the_last() -> None:
    drive = FakeDrive(SteppedClock(), slip=0.02)
    moved, path = motor(drive, 100.0), [CrankDrive(rpm * math.tau / 60.0) for rpm in (100.0, 200.0)]
    moved.arm(soft=True, path=path)
    moved.start(soft=True, path=path)
    speeds = [each[1] for each in drive.told if each[0] == "set_speed"]
    assert speeds[:3] == pytest.approx([100.0, 200.0, 100.0])
    assert drive.shaft_rpm() == pytest.approx(100.0, abs=STEP_RPM / 2 + 1e-9)
    assert [notice.code for notice in moved.take_notices()] == ["motor.trimmed"]
    assert "stop" not in [each[0] for each in drive.told]


def test_arming_sets_the_speed_and_moves_nothing() -> None:
    drive = FakeDrive(SteppedClock())
    motor(drive).arm(soft=True)
    assert drive.told == [("set_speed", pytest.approx(200.0))]
    drive.clock.sleep(10.0)
    assert drive.output_rpm == 0.0


def test_an_order_may_take_as_long_as_the_driver_is_at_it_and_whoever_gave_it_no_longer() -> None:
    drive, allowed_s = FakeDrive(SteppedClock(), busy=True), list[float]()
    moved = motor(drive)
    moved.arm(soft=True)
    for _ in range(8):  # the guard looks
        drive.clock.sleep(0.5)
        allowed_s.append(moved.longest_order_s)
    assert allowed_s[:4] == pytest.approx([1.1, 1.6, 2.1, 2.6])
    assert allowed_s[5:] == [3.0] * 3
    moved.check()
    moved.arm(soft=True)
    drive.clock.sleep(0.5)
    assert moved.longest_order_s == pytest.approx(1.1)
    drive.busy = False  # it is done, and the sequence does not see it
    drive.clock.sleep(0.5)
    assert moved.longest_order_s == pytest.approx(1.1)
    moved.check()
    assert moved.longest_order_s == 0.6


@pytest.mark.parametrize("slip", [0.0, 0.013, 0.03, -0.01])
@pytest.mark.parametrize("rpm", [60.0, 200.0])
def test_the_shaft_turns_as_wanted_within_half_a_step_of_the_inverter(slip: float, rpm: float) -> None:
    drive = FakeDrive(SteppedClock(), slip=slip)
    moved = started(drive, rpm)
    assert drive.shaft_rpm() == pytest.approx(rpm, abs=STEP_RPM / 2 + 1e-9)
    assert [notice.code for notice in moved.take_notices()] == ["motor.trimmed"]


def test_a_speed_that_ripples_within_a_turn_is_trimmed_in_its_mean() -> None:
    # 1 % once per revolution; the loop averages over four turns, to 20 ms, in which the ripple cannot make
    # more than 20 ms x 2 rpm / 1.2 s.
    drive = FakeDrive(SteppedClock(), slip=0.02, ripple=lambda t: 2.0 * math.sin(RAD_S * t))
    started(drive)
    assert drive.output_rpm * 0.98 == pytest.approx(200.0, abs=0.02 * 2.0 / 1.2 + STEP_RPM / 2)


def test_once_started_nothing_changes_the_set_value() -> None:
    drive = FakeDrive(SteppedClock(), slip=0.02)
    moved = started(drive)
    before = len([each for each in drive.told if each[0] == "set_speed"])
    for _ in range(1000):
        drive.clock.sleep(0.02)
        moved.check()
    assert len([each for each in drive.told if each[0] == "set_speed"]) == before


def test_a_shaft_between_two_steps_ends_the_trimming_at_the_nearer_one() -> None:
    """A mean that jitters by more than a step would be chased for ever."""
    drive = FakeDrive(SteppedClock(), ripple=lambda t: 0.3 if math.floor(t) % 2 else -0.3)
    moved = started(drive)
    assert len([each for each in drive.told if each[0] == "set_speed"]) < 12
    assert abs(drive.output_rpm - 200.0) < 1.0
    assert moved.take_notices()


def test_a_shaft_that_turns_at_another_speed_is_a_wrong_bench() -> None:
    drive = FakeDrive(SteppedClock(), slip=0.5)
    with pytest.raises(InstrumentRefused, match=r"turns at 100 rpm and not at 200 rpm.*gearing"):
        started(drive)


@pytest.mark.parametrize(("slip", "beyond_at_s"), [(-1.0, 20.0 / 75.0), (-0.45, 1.0)])
def test_a_shaft_that_is_geared_up_is_stopped_on_the_ramp_before_it_is_there(
    slip: float, beyond_at_s: float
) -> None:
    """Held to the output, 100 rpm/s, a quarter above and 20 rpm: for 0.3 s and a turn."""
    drive = FakeDrive(SteppedClock(), slip=slip)  # twice as fast as the bench file says
    began_s = drive.clock.now_s
    with pytest.raises(InterlockTripped, match=r"shaft turns at .* rpm where the output makes .* for 0\.6 s"):
        started(drive)
    assert drive.clock.now_s - began_s == pytest.approx(beyond_at_s + OVERSPEED_S + 0.3, abs=3 * 0.02 + 1e-6)
    assert drive.output_rpm < 200.0


def test_a_shaft_that_slips_on_a_slow_ramp_is_no_danger() -> None:
    started(FakeDrive(SteppedClock(), slip=0.08, ripple=lambda now_s: 15.0 * math.sin(20.0 * now_s)))


@pytest.mark.parametrize("from_s", [1.0, 2.1, 4.0])
def test_a_glitch_that_shows_three_times_the_speed_until_the_next_mark_stops_nothing(from_s: float) -> None:
    """On the ramp, once it is there, and while it is trimmed; a turn takes 0.3 s."""
    clock = SteppedClock()
    glitch = clock.now_s + from_s
    drive = FakeDrive(clock, ripple=lambda now_s: 400.0 if 0.0 <= now_s - glitch < 0.3 else 0.0)
    started(drive)
    assert clock.now_s > glitch + 0.3


def test_a_shaft_that_runs_away_while_it_is_trimmed_is_stopped_in_time() -> None:
    clock = SteppedClock()
    away_s = clock.now_s + 4.0
    drive = FakeDrive(clock, ripple=lambda now_s: 150.0 if now_s > away_s else 0.0)
    with pytest.raises(InterlockTripped, match=r"shaft turns at .* rpm where 200 rpm is wanted, for 0\.6 s"):
        started(drive)
    # 0.3 s and a turn, a step of the loop, and a poll of the inverter that may come between.
    assert 0.0 < clock.now_s - away_s < OVERSPEED_S + 0.3 + 0.02 + 0.06 + 1e-6


def test_a_speed_that_chatters_about_the_limit_runs_away_all_the_same() -> None:
    clock = SteppedClock()
    away_s = clock.now_s + 4.0

    def chatter(now_s: float) -> float:
        return (110.0 if int(now_s / 0.1) % 2 else 60.0) if now_s > away_s else 0.0

    with pytest.raises(InterlockTripped, match=r"the shaft turns at 30\d rpm .*, for 0\.6 s"):
        started(FakeDrive(clock, ripple=chatter))
    assert clock.now_s - away_s < OVERSPEED_S + 0.3 + 0.3


def test_two_glitches_long_apart_stop_nothing_where_the_speed_between_is_within_the_hysteresis() -> None:
    """1.45 times the wanted speed between them, and then as wanted."""
    clock = SteppedClock()
    away_s = clock.now_s + 4.0

    def twice(now_s: float) -> float:
        since_s = now_s - away_s
        if 0.0 <= since_s < 0.1 or 0.9 <= since_s < 1.0:
            return 150.0
        return 90.0 if 0.0 <= since_s < 1.0 else 0.0

    started(FakeDrive(clock, ripple=twice))
    assert clock.now_s > away_s + 1.0


def test_an_inverter_that_stays_where_it_is_is_refused_when_the_ramp_has_overrun() -> None:
    drive = FakeDrive(SteppedClock(), stuck=True)
    before_s = drive.clock.now_s
    with pytest.raises(InstrumentRefused, match="does not come to 200 rpm"):
        started(drive)
    assert drive.clock.now_s - before_s < 1.5 * 2.0 + 1.1  # one and a half ramps of 2 s, and a second


def test_a_shaft_that_nobody_sees_turn_is_an_interlock() -> None:
    with pytest.raises(InterlockTripped, match="no instrument shows that the shaft turns"):
        started(drive := FakeDrive(SteppedClock(), seen=False))
    assert drive.clock.now_s - 1000.0 < 4.0


def test_a_long_ramp_does_not_go_up_blind() -> None:
    drive = FakeDrive(SteppedClock(), seen=False, ramp_rpm_per_s=10.0)
    with pytest.raises(InterlockTripped, match="no instrument shows that the shaft turns"):
        started(drive)
    assert drive.output_rpm < 110.0  # the eighth turn; its ramp takes 20 s


def test_trimming_stops_at_the_highest_speed() -> None:
    drive = FakeDrive(SteppedClock(), slip=0.03)
    moved = started(drive, 299.0)
    codes = [notice.code for notice in moved.take_notices()]
    assert codes == ["motor.limit", "motor.off_speed"]
    assert drive.output_rpm == pytest.approx(299.0)


def test_every_way_out_stops_by_the_measured_speed() -> None:
    drive = FakeDrive(SteppedClock())
    moved = started(drive)
    moved.ramp_down()
    moved.off()
    stops = [each[1] for each in drive.told if each[0] == "stop"]
    assert stops == [drive.shaft_rpm, drive.shaft_rpm]
    MotorActuator(drive).off()
    assert drive.told[-1] == ("stop", None)


def test_what_the_inverter_found_ends_the_run() -> None:
    drive = FakeDrive(SteppedClock())
    moved = started(drive)
    drive.error = InstrumentRefused("inverter", "fake", "it has tripped: E.OC1")
    with pytest.raises(InstrumentRefused, match=r"E\.OC1"):
        moved.check()


def test_polls_tell_how_long_an_answer_takes_on_the_time_base() -> None:
    drive = FakeDrive(SteppedClock())
    base = CardClock(drive.clock, 25_600.0)
    base.start(lambda: None)
    moved = started(drive)
    (record,) = moved.clocks(base)
    assert record.device == "inverter"
    assert record.offset_s == pytest.approx(-0.03, abs=1e-6)  # the middle of an answer that takes 60 ms
    assert record.rate_ppm == 0.0
    assert moved.clocks(base) == []


@pytest.mark.parametrize("rpm", [60.0, 280.0])
def test_it_goes_on_to_another_speed_and_is_trimmed_there(rpm: float) -> None:
    drive = FakeDrive(SteppedClock(), slip=0.02)
    moved = started(drive)
    before_s = drive.clock.now_s
    moved.go_to(rpm * math.tau / 60.0)
    assert drive.shaft_rpm() == pytest.approx(rpm, abs=STEP_RPM / 2 + 1e-9)
    assert moved.speed_rad_s == pytest.approx(rpm * math.tau / 60.0)
    assert moved.what.startswith(f"crank at {rpm:g} rpm")
    assert drive.clock.now_s - before_s > abs(rpm - 200.0) / 100.0  # on its ramp
    assert ("start",) not in drive.told[3:]


def test_a_shaft_that_runs_away_on_its_way_down_is_an_interlock() -> None:
    drive = FakeDrive(SteppedClock())
    moved = started(drive)
    began_s = drive.clock.now_s
    drive.ripple = lambda _: 350.0 - drive.output_rpm
    with pytest.raises(
        InterlockTripped, match=r"the shaft turns at 350 rpm where 60 rpm is wanted, for 1\.3 s"
    ):
        moved.go_to(60.0 * math.tau / 60.0)
    assert drive.clock.now_s - began_s < OVERSPEED_S + 1.0 + 2 * 0.02 + 1e-6


def proved(drive: FakeDrive, rpm: float = 200.0) -> Motor:
    first = Motor(drive, 10.0, drive.clock.sleep, drive.shaft_rpm, drive.clock, proves=True)
    moved = first.with_drive(CrankDrive(rpm * math.tau / 60.0))
    moved.arm(soft=True)
    moved.start(soft=True)
    return moved


def test_a_motor_that_has_to_prove_itself_shows_an_eighth_of_the_speed_first() -> None:
    drive = FakeDrive(SteppedClock(), slip=0.03)
    proved(drive)
    speeds = [each[1] for each in drive.told if each[0] == "set_speed"]
    assert speeds[:2] == pytest.approx([25.0, 200.0])
    assert drive.shaft_rpm() == pytest.approx(200.0, abs=STEP_RPM / 2 + 1e-9)


@pytest.mark.parametrize("times", [1.7, 8.0])
def test_a_shaft_that_is_faster_than_its_volts_is_stopped_at_an_eighth_of_the_order(times: float) -> None:
    drive = FakeDrive(SteppedClock(), slip=1.0 - times)
    with pytest.raises(InterlockTripped, match=r"turns at .* rpm where 25 rpm is ordered: what a volt makes"):
        proved(drive)
    assert [each[1] for each in drive.told if each[0] == "set_speed"] == pytest.approx([25.0])


def test_a_shaft_that_its_marker_shows_late_is_proved_by_that() -> None:
    drive = FakeDrive(SteppedClock(), slip=-3.0)
    armed_s = drive.clock.now_s

    def marker_rpm() -> float:
        """Four marks at 100 rpm, and the way of a reading."""
        return drive.shaft_rpm() if drive.clock.now_s - armed_s > 0.25 + 2.4 else math.nan

    late = Motor(drive, RAD_S, drive.clock.sleep, marker_rpm, drive.clock, proves=True)
    late.arm(soft=True)
    with pytest.raises(InterlockTripped, match=r"turns at 100 rpm where 25 rpm is ordered"):
        late.start(soft=True)
    assert [each[1] for each in drive.told if each[0] == "set_speed"] == pytest.approx([25.0])


@pytest.mark.parametrize("fast_s", [0.2, 0.4])
def test_every_look_at_a_proof_counts_and_one_alone_does_not(fast_s: float) -> None:
    drive = FakeDrive(SteppedClock())
    began_s = drive.clock.now_s + 0.25 + 0.1  # its ramp
    drive.ripple = lambda now_s: 60.0 if 0.0 <= now_s - began_s < fast_s else 0.0
    if fast_s < OVERSPEED_S:
        proved(drive)
        return
    with pytest.raises(InterlockTripped, match=r"turns at 85 rpm where 25 rpm is ordered"):
        proved(drive)


def test_a_shaft_that_is_too_slow_for_its_instrument_is_proved_by_nothing_and_goes_on() -> None:
    drive = FakeDrive(SteppedClock())
    slow = Motor(
        drive,
        RAD_S,
        drive.clock.sleep,
        lambda: drive.shaft_rpm() if drive.shaft_rpm() > 30.0 else math.nan,
        drive.clock,
        proves=True,
    )
    slow.arm(soft=True)
    slow.start(soft=True)
    assert drive.shaft_rpm() == pytest.approx(200.0, abs=STEP_RPM / 2 + 1e-9)
