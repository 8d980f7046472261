"""Every effect does what the table of effects says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.errors import UnphysicalParameter
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank import kernel
from sim_twin.rigs.planar_slider_crank.model import (
    Elastic,
    PlanarSliderCrank,
    RodBending,
    generalised_stiffness,
    nominal,
)
from sim_twin.rigs.planar_slider_crank.motion import CrankTwin, frame_acceleration, numbers
from sim_twin.rigs.planar_slider_crank.rig import MODEL
from sim_twin.sensors import SensorChain
from tests.sim_twin.planar_slider_crank.cranks import DRIVE, RIG, run, twin

# Nothing touches for a long while: what a body does alone can be seen.
LOOSE = replace(RIG, clearance_1=0.04, clearance_2=0.04)


def with_effect(name: str, **values: float | str) -> CrankTwin:
    changed: CrankTwin = MODEL.with_effects(twin(), [(name, values)])
    return changed


def test_the_catalogue_is_the_table() -> None:
    assert set(MODEL.effects) == {
        "joint1_clearance", "joint2_clearance", "contact_stiffness", "restitution", "joint_friction",
        "guide_friction", "rod_flexibility", "speed_fluctuation", "piston_mass", "frame_resonance",
        "sensor_gain", "sensor_factor", "swapped_channels", "sensor_bandwidth", "time_skew", "analog_delay",
    }  # fmt: skip
    locations = {effect.location for effect in MODEL.effects.values()}
    assert locations == {
        "joint 1",
        "joint 2",
        "joints",
        "guide",
        "rod",
        "drive",
        "piston",
        "frame",
        "sensor",
        "clock",
    }


@pytest.mark.parametrize(("name", "joint"), [("joint1_clearance", 0), ("joint2_clearance", 1)])
def test_clearance_takes_the_stiffness_along(name: str, joint: int) -> None:
    rig = with_effect(name, scale=2.0).rig
    steel = Elastic(207e9, 0.3)
    assert (rig.clearance_1, rig.clearance_2)[joint] == 2e-3
    assert (rig.clearance_1, rig.clearance_2)[1 - joint] == 1e-3
    expected = generalised_stiffness(10e-3, -12e-3, steel, steel)
    assert rig.contact_stiffnesses[joint] == pytest.approx(expected)
    assert rig.contact_stiffnesses[1 - joint] == RIG.contact_stiffnesses[1 - joint]


def test_numbers_reach_the_kernel() -> None:
    def p(name: str, **values: float) -> kernel.CrankNumbers:
        changed = with_effect(name, **values)
        return numbers(changed.rig, changed.drive)

    K = RIG.contact_stiffnesses[0]
    stiff = p("contact_stiffness", scale=3.0)
    assert [stiff.joint_1.law.stiffness, stiff.joint_2.law.stiffness] == pytest.approx([3 * K, 3 * K])
    soft = p("restitution", value=0.5)
    assert [soft.joint_1.law.hysteresis, soft.joint_2.law.hysteresis] == pytest.approx([0.75 * 0.75] * 2)
    rough = p("joint_friction", coefficient=0.2)
    assert [rough.joint_1.friction.coefficient, rough.joint_2.friction.coefficient] == [0.2, 0.2]
    assert p("piston_mass", scale=1.5).piston_mass == pytest.approx(1.5 * 2.0205)


def test_all_analog_channels_are_late_against_the_encoder() -> None:
    healthy = replace(twin(), sensors=MODEL.nominal_sensors(RIG, DRIVE))
    late = MODEL.with_effects(healthy, [("analog_delay", {"seconds": 3e-4})])
    assert late.sensors["crank.angle"] == healthy.sensors["crank.angle"]
    analog = {name: each for name, each in late.sensors.items() if isinstance(each, SensorChain)}
    assert len(analog) > 2
    assert all(each.skew == pytest.approx(3e-4) for each in analog.values())


def test_guide_friction_brakes_the_piston_by_its_weight() -> None:
    rough = replace(LOOSE, guide_friction=0.3)
    motion = run(rough, angle=1.0, step=1e-3)
    before = motion.present()[kernel.VS]
    motion.advance(10)
    gained = motion.present()[kernel.VS] - before
    assert gained == pytest.approx(-np.sign(before) * 0.3 * 9.81 * 0.01, rel=1e-6)


def test_guide_friction_is_on_the_absolute_normal_force() -> None:
    # In contact: drag = mu |m4 g + lift|, whichever way the rod pulls.
    rough = replace(RIG, guide_friction=0.3)
    motion = run(rough, step=1e-5)
    outputs = motion.advance(3000).outputs
    free = run(step=1e-5).advance(700).outputs  # the same until the piston has been hit
    assert np.allclose(outputs[kernel.FRAME_X, :520], free[kernel.FRAME_X, :520], atol=0.1)
    assert (outputs[kernel.GUIDE_Y] > 100).any()
    assert (outputs[kernel.GUIDE_Y] < -100).any()


def test_free_rod_rings_at_2_30_times_its_frequency() -> None:
    rig = replace(LOOSE, bending=RodBending(100.0, 0.0), gravity=0.0)
    motion = run(rig, tolerance=1e-9, step=1e-4, drive=SpeedDrive(0.0))
    y = motion.present()
    y[kernel.Q] = 1e-4
    motion.change(motion.parameters, y)
    deflection = []
    for _ in range(400):
        deflection.append(motion.present()[kernel.Q])
        motion.advance(1)
    q = np.array(deflection)
    rising = np.flatnonzero((q[:-1] < 0) & (q[1:] >= 0))
    crossings = rising - q[rising] / (q[rising + 1] - q[rising])
    found = (len(crossings) - 1) / (crossings[-1] - crossings[0]) / 1e-4
    ratio = 1 / np.sqrt(1 - 8 / np.pi**2)
    assert ratio == pytest.approx(2.30, abs=0.005)
    assert found == pytest.approx(100 * ratio, rel=1e-3)  # straight lines between 43 samples a period


def test_free_rod_keeps_its_momentum_while_it_rings() -> None:
    rig = replace(LOOSE, bending=RodBending(100.0, 0.0), gravity=0.0)
    motion = run(rig, tolerance=1e-10, step=1e-3, drive=SpeedDrive(0.0))
    y = motion.present()
    y[kernel.Q] = 1e-3
    motion.change(motion.parameters, y)
    for _ in range(20):
        motion.advance(1)
        y = motion.present()
        # Chord's centre plus the mean deflection 2/pi q, across the rod, which lies along x.
        assert y[kernel.VY] + 2 / np.pi * y[kernel.VQ] == pytest.approx(0.0, abs=1e-7)


def test_falling_rod_does_not_bend() -> None:
    # Gravity included: w^2 q = -(4/pi) (a + g), and a = -g in free fall.
    rig = replace(LOOSE, bending=RodBending(100.0, 0.05))
    motion = run(rig, tolerance=1e-9, step=1e-3, drive=SpeedDrive(0.0))
    motion.advance(20)
    assert motion.present()[kernel.Q] == pytest.approx(0.0, abs=1e-12)


def test_stiff_flexible_rod_is_the_rigid_one() -> None:
    changed = replace(RIG, bending=RodBending(20_000.0, 0.05))
    stiff, rigid = run(changed, 1e-7).advance(60).episodes, run(RIG, 1e-7).advance(60).episodes
    # At 20 kHz the mode is fast against an impact of 0.25 ms, and gives way by a little only.
    assert stiff[0, 3] == pytest.approx(rigid[0, 3], rel=5e-3)


def test_flexible_rod_changes_the_impacts() -> None:
    # The first one is along the rod but for 7 degrees, so little of it bends; five times the solver's error.
    bent = with_effect("rod_flexibility", frequency_hz=100.0, damping_ratio=0.01)
    assert run(bent.rig).advance(100).episodes[0, 3] < 9079.3 * 0.995


def test_speed_fluctuates_with_the_angle() -> None:
    changed = with_effect("speed_fluctuation", amplitude=0.05, order=2.0, phase_rad=0.3)
    theta = run(drive=changed.drive, tolerance=1e-9, step=1e-4).advance(3000).outputs[kernel.ANGLE]
    speed = np.gradient(theta, 1e-4)[1:-1]
    expected = DRIVE.speed * (1 + 0.05 * np.sin(2 * theta[1:-1] + 0.3))
    np.testing.assert_allclose(speed, expected, rtol=1e-6)  # second-order differences, 2 mrad a step


def test_frame_keeps_its_mass_and_rings_elsewhere() -> None:
    channel = "crank_frame.acceleration_x"
    rig = with_effect("frame_resonance", channel=channel, frequency_scale=1.5).rig
    assert rig.frames[channel].frequency == pytest.approx(270.0)
    assert rig.frames["crank_frame.acceleration_y"] == RIG.frames["crank_frame.acceleration_y"]
    kick = np.zeros(204_800)
    kick[0] = 30.0
    ring = frame_acceleration(rig.frames[channel], 204_800.0)(kick)
    # The spectrum of x'' over F peaks at w / sqrt(1 - 2 zeta^2), and goes to 1/m far above it.
    gain = abs(np.fft.rfft(ring)) / 30.0
    assert np.argmax(gain) == pytest.approx(270.0 / np.sqrt(1 - 2 * 0.03**2), abs=1.0)
    assert gain[20_000] == pytest.approx(1 / 30.0, rel=0.05)  # less what a straight line between samples is


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("joint1_clearance", {"scale": 1.1}),
        ("restitution", {"value": 0.9}),
        ("speed_fluctuation", {"amplitude": 0.02, "order": 5.0, "phase_rad": 0.0}),
        ("rod_flexibility", {"frequency_hz": 100.0}),
        ("frame_resonance", {"channel": "crank.angle", "frequency_scale": 1.2}),
    ],
)
def test_refuses_what_the_table_does_not_have(name: str, values: dict[str, float | str]) -> None:
    with pytest.raises(ValueError, match=name):
        MODEL.with_effects(twin(), [(name, values)])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("clearance_1", 0.0),
        ("clearance_2", -1e-3),
        ("rod_mass", 0.0),
        ("rod_length", 0.1),
        ("restitution", 1.1),
        ("friction", -0.1),
        ("gravity", float("nan")),
        ("friction_v_1", 1e-5),
    ],
)
def test_refuses_what_no_rig_can_have(name: str, value: float) -> None:
    with pytest.raises(UnphysicalParameter, match=f"planar slider-crank: {name}"):
        replace(RIG, **{name: value})


def test_materials_scale_masses_and_stiffness() -> None:
    light = nominal("aluminium")
    assert light.rod_mass == pytest.approx(RIG.rod_mass * 2700 / 7800)
    assert light.rod_inertia == pytest.approx(RIG.rod_inertia * 2700 / 7800)
    ratio = (70e9 / (1 - 0.33**2)) / (207e9 / (1 - 0.3**2))
    assert light.contact_stiffnesses[0] == pytest.approx(RIG.contact_stiffnesses[0] * ratio)
    assert isinstance(nominal("brass"), PlanarSliderCrank)
