"""The motion at the channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_twin.rigs.crank_drive import SpeedDrive, angle_after
from sim_twin.rigs.planar_slider_crank import kernel
from sim_twin.rigs.planar_slider_crank.model import FrameMode
from sim_twin.rigs.planar_slider_crank.motion import CrankTruth, frame_acceleration
from sim_twin.rigs.planar_slider_crank.rig import MODEL
from sim_twin.status import Status
from tests.sim_twin.planar_slider_crank.cranks import DRIVE, RIG, run, twin

RATE = 204_800.0
ANGLE, MARKER = 3, 4


def driven(phase: float = 0.0, drive: SpeedDrive = DRIVE, rig=RIG) -> CrankTruth:  # type: ignore[no-untyped-def]
    truth = CrankTruth(twin(rig, drive), RATE)
    truth.change_drive(drive, phase, 0.0)
    return truth


def test_still_until_it_is_driven() -> None:
    truth = CrankTruth(twin(), RATE)
    assert not truth.advance(1000)[:4].any()
    np.testing.assert_allclose(truth.shape()[1], [RIG.crank_length, 0.0])
    truth.change_drive(DRIVE, 1.0, 0.0)
    # The angle at time 0 was asked for, a thousand steps ago.
    assert truth.advance(1)[ANGLE, 0] == pytest.approx(1.0 + DRIVE.speed * 1000 / RATE, rel=1e-12)


def test_rows_are_the_channels_in_their_order() -> None:
    rows = driven().advance(5000)
    assert rows.shape == (len(RIG.channels), 5000)
    assert RIG.channels[ANGLE] == "crank.angle"
    np.testing.assert_allclose(rows[ANGLE], DRIVE.speed * np.arange(5000) / RATE, atol=1e-12)
    fifth = np.deg2rad(5.0)
    np.testing.assert_array_equal(rows[MARKER], np.where(rows[ANGLE] < fifth, 5.0, 0.0))


def test_blocks_are_the_run_in_one_go() -> None:
    whole = driven().advance(40_000)
    truth = driven()
    parts = np.concatenate([truth.advance(count) for count in (1, 4999, 15_000, 20_000)], axis=1)
    # Bit by bit but for the frame's filters, which sum in the same order too.
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-9)


def test_piston_follows_the_crank_like_ideal_joints() -> None:
    small = 2e-5
    truth = driven(rig=replace(RIG, clearance_1=small, clearance_2=small))
    r, L = RIG.crank_length, RIG.rod_length
    for _ in range(40):
        theta = truth.advance(1500)[ANGLE, -1] + DRIVE.speed / RATE
        ideal = r * np.cos(theta) + np.sqrt(L**2 - (r * np.sin(theta)) ** 2)
        # Both clearances, and as much again for the rod's slope and the contacts' give.
        assert truth.shape()[4, 0] == pytest.approx(ideal, abs=4 * small)
    assert truth.status is Status.COMPLETED


def test_a_drive_that_stays_the_same_leaves_the_motion_alone() -> None:
    whole, truth = driven().advance(9000), driven()
    truth.advance(4500)
    truth.change_drive(DRIVE, 0.0, 0.0)
    # Steps fall elsewhere from then on, so the two part in time: three milliseconds, 1 % of the peaks there.
    np.testing.assert_allclose(truth.advance(600), whole[:, 4500:5100], atol=0.2)


def test_takes_a_new_angle_and_speed_in_its_stride() -> None:
    truth, faster = driven(), SpeedDrive(1.05 * DRIVE.speed)
    truth.advance(30_000)
    truth.change_drive(faster, 2.0, 30_000 / RATE)
    rows = truth.advance(30_000)
    np.testing.assert_allclose(rows[ANGLE], 2.0 + faster.speed * np.arange(30_000) / RATE, atol=1e-9)
    # Were rod and piston left where they are, 10 cm into the bearing, forces of 1e9 N would follow.
    assert abs(rows[:3]).max() < 2000


def test_frame_is_exact_for_a_ramp() -> None:
    mode, rate = FrameMode(30.0, 230.0), 25_600.0
    t = np.arange(200) / rate
    ours = frame_acceleration(mode, rate)(3000.0 * t)
    omega, zeta = 2 * np.pi * 230.0, mode.damping_ratio
    damped = omega * np.sqrt(1 - zeta**2)
    # x'' of a damped oscillator from rest under the force 3000 t.
    exact = 3000.0 / 30.0 * np.exp(-zeta * omega * t) * np.sin(damped * t) / damped
    np.testing.assert_allclose(ours, exact, atol=1e-10)


def test_centrifugal_force_and_pin_are_all_that_the_frame_feels() -> None:
    outputs = run(step=1e-4).advance(40).outputs  # before the first contact at 5.2 ms
    theta = DRIVE.speed * 1e-4 * np.arange(40)
    pull = RIG.crank_mass * RIG.crank_length / 2 * DRIVE.speed**2
    np.testing.assert_allclose(outputs[0], pull * np.cos(theta), rtol=1e-12)
    np.testing.assert_allclose(outputs[1], pull * np.sin(theta), atol=1e-12)
    np.testing.assert_array_equal(outputs[2], 0.0)


@pytest.mark.parametrize("elapsed", [0.31, -0.2])
def test_fluctuating_speed_integrates_to_the_angle(elapsed: float) -> None:
    drive = SpeedDrive(20.0, 0.05, 2.0, 0.4)
    found = solve_ivp(
        lambda _, a: 20.0 * (1 + 0.05 * np.sin(2 * a + 0.4)), (0, elapsed), [1.0], rtol=1e-10, atol=1e-10
    )
    assert angle_after(drive, 1.0, elapsed) == pytest.approx(found.y[0, -1], abs=1e-8)


def test_samples_come_through_the_sensors() -> None:
    rng = np.random.default_rng(4)
    healthy = MODEL.draw_healthy(twin(), rng, rng)
    stream = MODEL.stream(healthy, 25_600.0, rng)
    stream.drive(healthy.drive, 0.5)
    samples = stream.advance(12_800)
    assert samples.shape == (5, 12_800)
    counts = samples[ANGLE] / (2 * np.pi / 4096)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert samples[ANGLE, 0] == pytest.approx(0.5, abs=2 * np.pi / 4096)
    assert 10 < samples[1].std() < 40  # 22 in recordings of another program, +- 10 %


def test_on_an_inclined_guide_gravity_pulls_along_it() -> None:
    # the joints are open at first: the piston falls freely along its guide
    for incline, along in ((0.0, 0.0), (np.pi / 6, 9.81 / 2)):
        motion = run(replace(RIG, incline=incline), step=1e-6)
        assert motion.advance(1).outputs[kernel.PISTON_ACCELERATION, 0] == pytest.approx(along)
