"""The emulated shaft: its angle is the integral of its speed, and the same for all who heard the same."""

from __future__ import annotations

import math
import pickle
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from drivers.canopen_cia406.emulator.process import EncoderSetup, start_encoder
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.protocols.speed_drive import MotorOutput
from rig.twin.shaft import COAST_RAD_S2, STEP_S, EmulatedMotor, LinkedShaft, ShaftCourse, drawn_motor
from sim_twin.rigs.crank_drive import SpeedDrive

SMOOTH = SpeedDrive(1.0)
MOTOR = EmulatedMotor(0.5, SMOOTH, start_angle=1.25)
BEGIN_S = 1000.0
UP = MotorOutput(True, 0.0, 40.0, 40.0, BEGIN_S)  # to 20 rad/s in 1 s
RAMP_ERROR = 20.0 * STEP_S**2 / 8.0
"""rad: the most that a constant speed within a step leads to, beside an even ramp of 20 rad/s2."""
ROUNDING = 1e-9


def course(*outputs: MotorOutput, motor: EmulatedMotor = MOTOR) -> ShaftCourse:
    made = ShaftCourse(motor)
    for output in outputs:
        made.hear(output)
    return made


def test_it_stands_until_something_is_put_out() -> None:
    assert course().angle(5.0) == MOTOR.start_angle
    assert course(UP).angle(BEGIN_S) == MOTOR.start_angle
    assert course(UP).turning_at(BEGIN_S - 1.0).drive.speed == 0.0


def test_over_a_ramp_the_angle_is_the_integral_of_the_speed() -> None:
    shaft = course(UP)
    for elapsed_s in np.linspace(0.0, 1.0, 257):
        even = MOTOR.start_angle + 0.5 * 20.0 * elapsed_s**2
        assert abs(shaft.angle(BEGIN_S + elapsed_s) - even) <= RAMP_ERROR + ROUNDING
    # at the ramp's end, and from there on, nothing of the steps is left
    for elapsed_s in (1.0, 1.37, 3600.0):
        exact = MOTOR.start_angle + 10.0 + 20.0 * (elapsed_s - 1.0)
        assert shaft.angle(BEGIN_S + elapsed_s) == pytest.approx(exact, rel=1e-12, abs=ROUNDING)


def test_a_speed_that_fluctuates_is_integrated_too() -> None:
    shape = SpeedDrive(1.0, 0.05, 2.0, 0.7)
    shaft = course(UP, motor=replace(MOTOR, shape=shape))

    def speed(time_s: float, angle: np.ndarray) -> np.ndarray:
        return min(20.0 * time_s, 20.0) * (1.0 + 0.05 * np.sin(2.0 * angle + 0.7))

    solved = solve_ivp(speed, (0.0, 3.0), [MOTOR.start_angle], rtol=1e-10, atol=1e-10, max_step=0.01)
    seen = [shaft.angle(BEGIN_S + elapsed_s) for elapsed_s in solved.t]
    # the ramp's steps weigh up to 1.05 times more where the shaft is fast
    assert np.abs(np.array(seen) - solved.y[0]).max() < 1.05 * RAMP_ERROR + 1e-6
    assert shaft.turning_at(BEGIN_S + 2.0).drive == replace(shape, speed=20.0)


def test_changes_of_speed_lie_one_step_apart_and_lead_from_one_to_the_next() -> None:
    shaft = course(UP)
    changes = [shaft.turning_at(BEGIN_S), *shaft.changes(BEGIN_S, BEGIN_S + 5.0)]
    assert len(changes) == 101
    for before, after in pairwise(changes):
        elapsed_s = after.time_s - before.time_s
        assert elapsed_s == pytest.approx(STEP_S, rel=1e-6)
        assert after.angle == pytest.approx(before.angle + before.drive.speed * elapsed_s, abs=ROUNDING)
    assert changes[-1].drive.speed == 20.0
    first_half = list(shaft.changes(BEGIN_S, BEGIN_S + 0.5))
    assert [*first_half, *shaft.changes(first_half[-1].time_s, BEGIN_S + 5.0)] == changes[1:]


def test_a_ramp_that_is_cut_short_goes_on_from_where_it_was() -> None:
    down = MotorOutput(True, 20.0, 0.0, 40.0, BEGIN_S + 0.5)
    shaft = course(UP, down)
    assert shaft.angle(BEGIN_S + 9.0) == pytest.approx(MOTOR.start_angle + 2.5 + 2.5, abs=ROUNDING)
    for edge_s in (BEGIN_S, BEGIN_S + 0.5, BEGIN_S + 1.0):
        around = shaft.angle(edge_s - 1e-7), shaft.angle(edge_s + 1e-7)
        assert around[1] - around[0] < 20.0 * 2e-7 + ROUNDING


def test_without_an_output_it_coasts_until_friction_has_stopped_it() -> None:
    shaft = course(UP, MotorOutput(False, 0.0, 0.0, 40.0, BEGIN_S + 2.0))
    at_rest = shaft.angle(BEGIN_S + 2.0) + 20.0**2 / (2.0 * COAST_RAD_S2)
    assert shaft.angle(BEGIN_S + 100.0) == pytest.approx(at_rest, abs=ROUNDING)
    assert shaft.turning_at(BEGIN_S + 100.0).drive.speed == 0.0


def test_hearing_twice_changes_nothing() -> None:
    outputs = (UP, MotorOutput(False, 0.0, 0.0, 40.0, BEGIN_S + 0.3), replace(UP, started_s=BEGIN_S + 0.9))
    once, again = course(*outputs), course(*outputs, outputs[-1])
    times = np.linspace(BEGIN_S - 1.0, BEGIN_S + 5.0, 100)
    assert [once.angle(time_s) for time_s in times] == [again.angle(time_s) for time_s in times]


def test_a_motor_is_drawn_again_by_its_seeds() -> None:
    motors = [drawn_motor(5.0, SpeedDrive(20.0), seed, 1) for seed in range(200)]
    assert motors == [drawn_motor(5.0, SpeedDrive(20.0), seed, 1) for seed in range(200)]
    slips = np.array([1.0 - motor.rad_s_per_level / (5.0 * math.tau / 60.0) for motor in motors])
    assert slips.min() >= -ROUNDING
    assert 0.025 < slips.max() <= 0.03 + ROUNDING  # evenly up to 3 %: all of 200 below 2.5 % has p = 1e-16
    other_run = drawn_motor(5.0, SpeedDrive(20.0), 7, 2)
    assert other_run.rad_s_per_level == motors[7].rad_s_per_level
    assert other_run.start_angle != motors[7].start_angle
    nominal = drawn_motor(5.0, SpeedDrive(20.0), 7, 1, healthy=False)
    assert nominal.rad_s_per_level == pytest.approx(5.0 * math.tau / 60.0, rel=1e-15)


def test_a_shaft_of_another_process_hears_what_came_and_is_the_same() -> None:
    receiver, sender = get_context("spawn").Pipe(duplex=False)
    with receiver, sender:
        shaft = LinkedShaft(MOTOR, receiver, replace(UP, started_s=BEGIN_S - 10.0))
        assert shaft(BEGIN_S) == course(replace(UP, started_s=BEGIN_S - 10.0)).angle(BEGIN_S)
        down = MotorOutput(True, 40.0, 0.0, 40.0, BEGIN_S + 1.0)
        sender.send(down)
        both = course(replace(UP, started_s=BEGIN_S - 10.0), down)
        assert [shaft(BEGIN_S + k) for k in range(4)] == [both.angle(BEGIN_S + k) for k in range(4)]
        sender.close()
        assert [shaft(BEGIN_S + k) for k in (9, 10)] == [both.angle(BEGIN_S + k) for k in (9, 10)]
    assert pickle.loads(pickle.dumps(MOTOR)) == MOTOR  # noqa: S301


def test_an_encoder_in_a_process_of_its_own_shows_this_shaft() -> None:
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    setup = EncoderSetup(counts_per_revolution=65536, revolutions=64, jitter_s=0.0)
    with receiver, sender, start_encoder(partial(LinkedShaft, MOTOR, receiver), setup) as emulated:
        host, _, port = emulated.address.rpartition(":")
        options = {"host": host, "port": int(port), "channel": "can0"}
        encoder = CanopenEncoder(EncoderSettings(7, "socketcand", options=options))
        encoder.open()
        try:
            unix_s = time.time() - time.monotonic()
            output = replace(UP, started_s=time.monotonic())
            sender.send(output)
            encoder.start()
            block = encoder.read(400)
        finally:
            encoder.close()
    here = course(output)
    seen = block.counts * math.tau / 65536
    wanted = np.array([here.angle(stamp_s - unix_s) for stamp_s in block.timestamp_s])
    assert wanted[-1] > MOTOR.start_angle + 0.5
    # its clock was set to ours when it booted, a millisecond off at most; the shaft turns at up to 20 rad/s
    assert np.abs(seen - wanted).max() < math.tau / 65536 + 20.0 * 2e-3
    assert np.abs(np.diff(seen - wanted)).max() < 2.0 * math.tau / 65536 + 20.0 * 2e-6
