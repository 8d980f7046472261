"""The emulated cranks: what their sensors show is the shaft that the inverter turns, on any rig drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.protocols.speed_drive import MotorOutput
from rig.files.scenario import load_scenario
from rig.twin.plant import CrankPlant
from rig.twin.scenario_twin import twin_of
from rig.twin.shaft import STEP_S, EmulatedMotor, ShaftCourse, drawn_motor
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.twin import AnyTwin

SCENARIOS = Path(__file__).parents[3] / "scenarios"
RATE = 25_600.0
BLOCK = 640  # 25 ms, as the emulated card makes them
COUNT = math.tau / 4096
NEWS_S = 500.0
UP = MotorOutput(True, 0.0, 40.0, 200.0, NEWS_S)  # to 200 rpm in 0.2 s


def twin(rig: str) -> AnyTwin:
    return twin_of(load_scenario(SCENARIOS / f"{rig}.toml"))


PLANAR, SPATIAL = twin("planar_slider_crank"), twin("spatial_slider_crank")
MOTOR = drawn_motor(5.0, PLANAR.drive, seed=1, run_seed=2)


def plant(
    believed: AnyTwin = PLANAR,
    seed: int = 1,
    run_seed: int = 2,
    motor: EmulatedMotor = MOTOR,
    healthy: bool = True,
) -> CrankPlant:
    made = CrankPlant(believed, motor, seed, run_seed, healthy)
    made.start(RATE)
    return made


def samples(made: CrankPlant, seconds: float) -> dict[str, NDArray[np.float64]]:
    blocks = [made.advance(BLOCK) for _ in range(round(seconds * RATE / BLOCK))]
    return dict(zip(made.channels, np.concatenate(blocks, axis=1), strict=True))


def heard(motor: EmulatedMotor, *outputs: MotorOutput) -> ShaftCourse:
    course = ShaftCourse(motor)
    for output in outputs:
        course.hear(output)
    return course


def angles(course: ShaftCourse, start_s: float, count: int) -> NDArray[np.float64]:
    return np.array([course.angle(start_s + k / RATE) for k in range(count)])


def test_angle_and_marker_show_the_shaft_through_ramp_and_run_and_stop() -> None:
    made = plant()
    standing = samples(made, 0.05)
    assert set(standing["crank.angle"]) == {math.floor(MOTOR.start_angle / COUNT) * COUNT}
    down = MotorOutput(True, 40.0, 0.0, 200.0, NEWS_S + 0.5)
    first = len(standing["crank.angle"]) + 100.25  # news come between samples
    made.drive(UP, first)
    turning = samples(made, 0.4)
    made.drive(down, first + 0.5 * RATE)
    stopping = samples(made, 0.4)
    seen = np.concatenate([each["crank.angle"] for each in (standing, turning, stopping)])
    course = heard(MOTOR, UP, down)
    true = angles(course, NEWS_S - first / RATE, len(seen))
    # whole counts, less what an angle loses by a change of speed that is put on the truth's grid (5 us)
    assert np.abs(seen - (true - COUNT / 2)).max() < COUNT / 2 + 21.0 * 5e-6 + 1e-9
    marker = np.concatenate([each["crank.marker"] for each in (standing, turning, stopping)])
    at_mark = np.mod(true, math.tau)
    # a filter of 51 samples to either side rings at the mark's edges
    inside = (at_mark > np.deg2rad(1.0)) & (at_mark < np.deg2rad(4.0)) & (np.gradient(true) * RATE > 20.0)
    assert inside.sum() > 20
    assert marker[inside].min() > 3.5
    assert np.abs(marker[(at_mark > np.deg2rad(10.0)) & (at_mark < np.deg2rad(350.0))]).max() < 1.0


def test_a_hidden_fluctuation_of_the_speed_is_in_the_angle() -> None:
    shape = SpeedDrive(20.0, 0.05, 1.0, 0.4)
    motor = drawn_motor(5.0, shape, seed=1, run_seed=2)
    made = plant(replace(PLANAR, drive=shape), motor=motor)
    made.drive(replace(UP, level=40.0), 0.0)
    seen = samples(made, 1.0)["crank.angle"]
    true = angles(heard(motor, replace(UP, level=40.0)), NEWS_S, len(seen))
    assert np.abs(seen - (true - COUNT / 2)).max() < COUNT / 2 + 1e-6
    line = np.polyval(np.polyfit(np.arange(len(seen)), seen, 1), np.arange(len(seen)))
    # theta' = omega (1 + a sin theta) swings by a about its mean line, to first order in a; three turns and a
    # third tilt the line by a fifth of that
    assert np.abs(seen - line).max() == pytest.approx(0.05, rel=0.25)


def test_news_that_come_late_put_the_shaft_where_it_has_to_be() -> None:
    made = plant()
    samples(made, 0.1)
    made.drive(UP, 0.06 * RATE)  # 40 ms ago: some of the ramp has been missed
    seen = samples(made, 0.2)["crank.angle"]
    true = angles(heard(MOTOR, UP), NEWS_S + 0.04, len(seen))
    late = 64  # samples that had been computed ahead
    assert np.abs(seen - (true - COUNT / 2))[late:].max() < COUNT / 2 + 21.0 * 5e-6 + 1e-9


def test_a_second_task_finds_the_shaft_where_it_has_come_to() -> None:
    made = plant()
    made.drive(UP, 0.0)
    samples(made, 0.3)
    made.start(RATE)
    made.drive(UP, -0.75 * RATE)  # the card tells again what is put out, which began before the task
    seen = samples(made, 0.1)["crank.angle"]
    true = angles(heard(MOTOR, UP), NEWS_S + 0.75, len(seen))
    assert np.abs(seen - (true - COUNT / 2)).max() < COUNT / 2 + 21.0 * 5e-6 + 1e-9


def test_the_spatial_cranks_tachometer_shows_the_speed_with_its_tolerances() -> None:
    motor = drawn_motor(5.0, SPATIAL.drive, seed=3, run_seed=4)
    made = plant(SPATIAL, 3, 4, motor)
    made.drive(replace(UP, target=46.0), 0.0)
    seen = samples(made, 0.5)["motor.tachometer"]
    speed = 46.0 * motor.rad_s_per_level
    settled = seen[round((46.0 / 200.0 + 2 * STEP_S) * RATE) :]
    # its gain is off by 0.5 % (sd), so 2 % are four of them; its noise is 0.1 % of the scenario's speed
    assert settled.mean() == pytest.approx(speed, rel=0.02)
    assert settled.std() == pytest.approx(1e-3 * SPATIAL.drive.speed, rel=0.1)


def test_a_rig_is_drawn_again_by_its_seeds_and_another_run_has_other_noise() -> None:
    def shown(seed: int, run_seed: int, healthy: bool = True) -> NDArray[np.float64]:
        made = plant(seed=seed, run_seed=run_seed, healthy=healthy)
        made.drive(UP, 0.0)
        return samples(made, 0.1)["crank_frame.acceleration_y"]

    assert np.array_equal(shown(1, 2), shown(1, 2))
    other_run = shown(1, 3) - shown(1, 2)
    # what is left between two runs of one rig is the noise of both, 0.05 m/s2 each, until chaos parts them
    assert other_run[:200].std() == pytest.approx(0.05 * math.sqrt(2.0), rel=0.25)
    assert not np.allclose(shown(2, 2), shown(1, 2), atol=0.5)
    assert not np.allclose(shown(1, 2, healthy=False), shown(1, 2), atol=0.5)


def test_a_plant_that_has_not_been_started_says_so() -> None:
    made = CrankPlant(PLANAR, MOTOR, 1, 2, healthy=True)
    with pytest.raises(ValueError, match="has not been started"):
        made.advance(1)
