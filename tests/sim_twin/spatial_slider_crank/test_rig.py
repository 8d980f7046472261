"""The rig's parameters, channels, kinematics, statics, effects and healthy spread."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin, sqrt

import numpy as np
import pytest

from daq.errors import SimulationFailed, UnphysicalParameter
from sim_twin.effects import BaseMass
from sim_twin.mechanisms.run import CONTACT, PEAK
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after
from sim_twin.rigs.rig_model import SolverValues
from sim_twin.rigs.spatial_slider_crank import solver_values as values
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS, FORCES
from sim_twin.rigs.spatial_slider_crank.constants import SOCKET, constants, layout
from sim_twin.rigs.spatial_slider_crank.model import Slider, SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.motion import eccentricity, ideal_state, simulation, step_limits
from sim_twin.rigs.spatial_slider_crank.rig import MODEL
from sim_twin.status import Status
from sim_twin.twin import Twin

SPEED = 230 * 2 * pi / 60
TWIN = Twin(SpatialSliderCrank(), SpeedDrive(SPEED))
RATE = 204_800.0


def rod_angle(rig: SpatialSliderCrank, theta: float) -> float:
    """Place of the universal joint along the guide with ideal joints, m."""
    a, r, L = rig.axis_angle, rig.crank_radius, rig.rod.length
    across = (r * cos(a) * cos(theta)) ** 2 + (r * sin(theta)) ** 2
    return r * sin(a) * cos(theta) + sqrt(L**2 - across)


@pytest.mark.parametrize(("degrees", "stroke"), [(90.0, 0.100), (65.0, 0.0906)])
def test_stroke_of_the_source(degrees: float, stroke: float) -> None:
    """Table 4: 4 in at 90 degrees; 3.6 in at 65 in the source, 90.6 mm by geometry."""
    rig = SpatialSliderCrank(axis_angle=np.deg2rad(degrees))
    p = constants(rig, SpeedDrive(SPEED))
    places = [ideal_state(p, theta)[0] for theta in np.linspace(0, 2 * pi, 181)]
    assert np.ptp(places) == pytest.approx(stroke, abs=0.05e-3)


@pytest.mark.parametrize("degrees", [90.0, 75.0, 65.0])
def test_tight_joints_move_as_ideal_ones(degrees: float) -> None:
    tight = SpatialSliderCrank(
        axis_angle=np.deg2rad(degrees), rod_modes=0, socket_clearance=5e-6, guide_clearance=5e-6,
        socket_damping=3000.0, guide_damping=3000.0,
    )  # fmt: skip
    motion = simulation(tight, SpeedDrive(2 * pi), 0.0, 0.02)
    for _ in range(26):
        motion.advance(1)
        y = motion.present()
        # Two clearances of 5 um along the rod and a contact's flexibility.
        assert y[0] == pytest.approx(rod_angle(tight, y[16]), abs=2e-5)


def test_joints_without_clearance_hold_and_nothing_strikes() -> None:
    """A held ball carries r omega^2 = 29 m/s2 of slider and rod, some 15 N, twice that while it rings."""
    socket = []
    for clearance in (0.0, 0.25e-3):
        rig = SpatialSliderCrank(rod_modes=0, socket_clearance=clearance, guide_clearance=clearance)
        trace = simulation(rig, SpeedDrive(SPEED), 0.0, 1 / RATE).advance(round(0.03 * RATE))
        assert trace.status is Status.COMPLETED
        socket.append(trace.outputs[SOCKET])
    held, free = socket
    assert np.mean(held > 0.0) > 0.95
    assert np.mean(free > 0.0) < 0.8
    assert held.max() < 0.5 * free.max()


@pytest.mark.parametrize("theta", [0.0, 1.0, 2.5, 4.4])
def test_the_start_is_centred_and_as_fast_as_ideal_joints(theta: float) -> None:
    rig = SpatialSliderCrank(axis_angle=1.2, slider=Slider(pin=(0.01, 2e-3, -3e-3)))
    p = constants(rig, SpeedDrive(SPEED))
    y, h = ideal_state(p, theta), 1e-6
    offset, rate = eccentricity(p, y)
    assert offset == pytest.approx(0.0, abs=1e-15)
    assert rate == pytest.approx(0.0, abs=1e-14)
    speed = (rod_angle(rig, theta + h) - rod_angle(rig, theta - h)) / (2 * h) * SPEED
    assert y[layout(p.modes, False).speeds] == pytest.approx(speed, abs=1e-8)


def test_slider_at_rest_shares_its_weight_between_its_upper_points() -> None:
    """Two levers: the rod hangs between joint and ball, the slider between its ends; 10 mm off the middle."""
    slider = Slider(pin=(0.01, 0.0, 0.0))
    rig = SpatialSliderCrank(
        rod_modes=0,
        friction=0.0,
        incline=0.0,
        roll=0.0,
        slider=slider,
        socket_damping=4000.0,
        guide_damping=4000.0,
    )
    forces = simulation(rig, SpeedDrive(0.0), 0.0, 0.5).advance(3).outputs[:9, -1]
    half_rod, weight, b = 0.5 * rig.rod.mass * 9.81, slider.mass * 9.81, rig.contact_span
    front, rear = (0.5 * weight + 0.5 * half_rod * (1 + side * 0.01 / b) for side in (-1.0, 1.0))
    # The ball hangs 0.25 mm under the pin over 0.19 m: a slope of 0.1 % turns some of the forces.
    assert forces[[2, 6]] == pytest.approx([front, rear], rel=5e-3)
    assert forces[8] == pytest.approx(half_rod, rel=2e-2)
    assert forces[[0, 1, 3, 4, 5, 7]] == pytest.approx(0.0, abs=1e-9)


def test_channels_and_units() -> None:
    assert TWIN.channels == tuple(CHANNELS)
    assert [CHANNELS[name].unit for name in ("slider.force_8", "motor.tachometer", "flywheel.marker")] == [
        "N", "rad/s", "V",
    ]  # fmt: skip
    with pytest.raises(KeyError, match="crank"):
        MODEL.channel_unit("crank.angle")


def test_marker_and_tachometer_follow_the_crank() -> None:
    truth = MODEL.truth(TWIN, RATE, False)
    truth.change_drive(SpeedDrive(SPEED), 1.0, 0.0)
    steps = round(2 * pi / SPEED * RATE)
    samples = dict(zip(CHANNELS, truth.advance(steps), strict=True))
    assert samples["motor.tachometer"] == pytest.approx(SPEED)
    high = np.flatnonzero(samples["flywheel.marker"] > 2.5)
    assert high[0] / RATE == pytest.approx((2 * pi - 1.0) / SPEED, abs=1 / RATE)
    assert len(high) == pytest.approx(np.deg2rad(5.0) / SPEED * RATE, abs=1)


def test_nothing_moves_before_the_first_drive() -> None:
    truth = MODEL.truth(TWIN, RATE, False)
    assert not truth.advance(100)[:-1].any()
    assert truth.shape().shape == (4, 3)


def test_blocks_of_any_size_give_the_same_run() -> None:
    whole, parts = (MODEL.truth(TWIN, RATE, False) for _ in range(2))
    for truth in (whole, parts):
        truth.change_drive(SpeedDrive(SPEED), 0.0, 0.0)
    joined = np.hstack([parts.advance(count) for count in (1, 700, 1299, 1000)])
    assert np.array_equal(joined, whole.advance(3000))


def test_a_new_speed_leaves_the_ball_where_it_is_in_its_socket() -> None:
    truth = MODEL.truth(TWIN, RATE, False)
    truth.change_drive(SpeedDrive(SPEED), 0.0, 0.0)
    samples, before = 4000, truth.advance(4000)[:9, -1]
    while before.max() < 20.0:
        samples, before = samples + 1, truth.advance(1)[:9, 0]
    truth.change_drive(SpeedDrive(1.01 * SPEED), SPEED * samples / RATE + 0.01, samples / RATE)
    after, later = truth.advance(2)[:9].T
    # One sample of 5 us passes in between, and as much in the next.
    assert np.abs(after - before).max() < 1.5 * np.abs(later - after).max() + 1.0


@pytest.mark.parametrize(
    "drive", [SpeedDrive(20.0), SpeedDrive(20.0, 0.3, 2.5, 0.7), SpeedDrive(20.0, 0.05, 1.0, -2.0)]
)
def test_crank_angle_by_its_formula_is_the_integrated_one(drive: SpeedDrive) -> None:
    motion = simulation(SpatialSliderCrank(rod_modes=0), drive, 0.4, 0.13)
    motion.advance(5)
    assert motion.present()[16] == pytest.approx(angle_after(drive, 0.4, 0.65), abs=1e-8)
    assert angle_after(drive, angle_after(drive, 0.4, 0.65), -0.65) == pytest.approx(0.4, abs=1e-12)


def solver(twin: Twin[SpatialSliderCrank, SpeedDrive]) -> SolverValues:
    return MODEL.solver_values(twin, 0.0, 0.05)


def test_solver_values_of_the_nominal_rig() -> None:
    found = MODEL.solver_values(TWIN, 0.3, 0.9)
    rigid = MODEL.solver_values(replace(TWIN, rig=replace(TWIN.rig, rod_modes=0)), 0.0, 0.02)
    stiff = replace(TWIN.rig, rod_modes=0)
    finest = simulation(stiff, TWIN.drive, 0.0, 1e-3, step_limits(stiff, 1e-13)).advance(21).episodes
    first = finest[finest[:, CONTACT] == SOCKET][0, PEAK]
    assert rigid["first_peak_socket_n"] == pytest.approx(first, rel=2e-3)
    assert found["onsets_per_revolution_socket"] > 50
    # An ideal slider's rms is r omega^2 sqrt((1 + lambda^2) / 2) = 21 m/s2; impacts add to it.
    assert 21.0 < found["slider_acceleration_rms"] < 60.0
    assert found["cycle_peak_guide_sd_n"] > 0.0


def test_a_run_without_contact_has_no_peaks() -> None:
    still = MODEL.solver_values(replace(TWIN, drive=SpeedDrive(0.1)), 0.0, 1e-4)
    assert still["first_peak_socket_n"] is None
    assert still["cycle_peak_guide_mean_n"] is None


@pytest.mark.parametrize(
    ("name", "parameters", "expected"),
    [
        ("socket_clearance", {"scale": 2.0}, {"socket_clearance": 0.5e-3}),
        ("guide_clearance", {"scale": 0.5}, {"guide_clearance": 0.125e-3}),
        ("guide_friction", {"coefficient": 0.2}, {"friction": 0.2}),
        ("contact_stiffness", {"scale": 2.0}, {"socket_stiffness": 5.6e7, "guide_stiffness": 2.8e7}),
        ("contact_damping", {"scale": 10.0}, {"socket_damping": 440.0, "guide_damping": 510.0}),
        (
            "base_flexibility",
            {"frequency_hz": 400.0, "mass_kg": 2.0, "damping_ratio": 0.02},
            {"base": BaseMass(400.0, 2.0, 0.02)},
        ),
    ],
)
def test_effects_change_what_the_table_says(
    name: str, parameters: dict[str, float], expected: dict[str, object]
) -> None:
    changed = MODEL.with_effects(TWIN, [(name, parameters)])
    assert changed == replace(TWIN, rig=replace(TWIN.rig, **expected))
    assert solver(changed) != solver(TWIN)


def test_a_stiffer_rod_rings_higher() -> None:
    stiff = MODEL.with_effects(TWIN, [("rod_stiffness", {"scale": 2.25})])
    before, after = (constants(twin.rig, twin.drive).omega for twin in (TWIN, stiff))
    assert after == pytest.approx(1.5 * before)
    rigid = replace(TWIN, rig=replace(TWIN.rig, rod_modes=0))
    with pytest.raises(ValueError, match="the rod is rigid"):
        MODEL.with_effects(rigid, [("rod_stiffness", {"scale": 2.0})])


def test_speed_fluctuates_as_its_formula() -> None:
    uneven = MODEL.with_effects(
        TWIN, [("speed_fluctuation", {"amplitude": 0.05, "order": 2.0, "phase_rad": 0.3})]
    )
    truth = MODEL.truth(uneven, RATE, False)
    truth.change_drive(uneven.drive, 0.0, 0.0)
    tachometer = truth.advance(3000)[9]
    angles = [angle_after(uneven.drive, 0.0, k / RATE) for k in (0, 1500, 2999)]
    assert tachometer[[0, 1500, 2999]] == pytest.approx(
        [SPEED * (1 + 0.05 * sin(2 * a + 0.3)) for a in angles]
    )


def test_a_base_on_springs_lowers_the_first_peak_in_the_guide() -> None:
    soft = {"frequency_hz": 150.0, "mass_kg": 0.5, "damping_ratio": 0.02}
    first = solver(MODEL.with_effects(TWIN, [("base_flexibility", soft)]))["first_peak_guide_n"]
    # A slider of 0.35 kg against 0.5 kg meets sqrt(0.5 / 0.85) = 0.77 of the reduced mass's impedance.
    assert first < 0.9 * solver(TWIN)["first_peak_guide_n"]


def test_the_catalogue_is_the_table() -> None:
    locations = {effect.name: effect.location for effect in MODEL.effects.values()}
    assert locations == {
        "base_flexibility": "base",
        "socket_clearance": "socket",
        "guide_clearance": "guide",
        "guide_friction": "guide",
        "contact_stiffness": "joints",
        "contact_damping": "joints",
        "rod_stiffness": "rod",
        "speed_fluctuation": "drive",
        "sensor_gain": "sensor",
        "sensor_factor": "sensor",
        "swapped_channels": "sensor",
        "sensor_droop": "sensor",
        "sensor_bandwidth": "sensor",
        "time_skew": "clock",
        "analog_delay": "clock",
    }
    assert MODEL.effects["sensor_gain"].channels == FORCES
    assert MODEL.effects["time_skew"].channels == (*FORCES, "flywheel.marker")


def test_healthy_rigs_spread_as_stated() -> None:
    rigs = [MODEL.draw_healthy(TWIN, *[np.random.default_rng(seed)] * 2) for seed in range(400)]
    spread = {
        "socket_stiffness": 0.05, "guide_damping": 0.2, "socket_clearance": 0.02, "modal_damping": 0.15,
        "crank_radius": 0.003,
    }  # fmt: skip
    for name, deviation in spread.items():
        drawn = np.array([getattr(twin.rig, name) for twin in rigs]) / getattr(TWIN.rig, name)
        # 400 draws know a deviation to 3.5 %; four of those.
        assert drawn.std() == pytest.approx(deviation, rel=0.15)
    assert np.std([twin.drive.speed for twin in rigs]) / SPEED == pytest.approx(2e-4, rel=0.15)
    assert np.std([twin.rig.friction for twin in rigs]) == pytest.approx(0.003, rel=0.15)
    sensors = rigs[0].sensors
    assert sensors["slider.force_1"].noise == 0.05
    assert sensors["motor.tachometer"].noise == pytest.approx(1e-3 * SPEED)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rod_modes": 7}, "even"),
        ({"rod_modes": 28}, "rod_modes"),
        ({"modal_damping": 1.5}, "modal_damping"),
        ({"modal_damping": -0.1}, "modal_damping"),
        ({"axis_angle": 0.1}, "axis_angle"),
        ({"socket_clearance": -1e-6}, "clearance"),
        ({"guide_stiffness": -1.0}, "guide_stiffness"),
        ({"friction": float("nan")}, "friction"),
        ({"crank_radius": 0.2}, "crank_radius"),
        ({"contact_offset": 8e-3}, "offset"),
    ],
)
def test_unphysical_rigs_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(UnphysicalParameter, match=message):
        SpatialSliderCrank(**change)


@pytest.mark.parametrize("parameters", [{"mass": 0.0}, {"inertia": (1e-5, 0.0, 1e-5)}])
def test_unphysical_sliders_are_refused(parameters: dict[str, object]) -> None:
    with pytest.raises(UnphysicalParameter, match=next(iter(parameters))):
        Slider(**parameters)


def test_too_few_steps_are_told() -> None:
    limits = step_limits(TWIN.rig, budget=50)
    trace = simulation(TWIN.rig, TWIN.drive, 0.0, 1 / RATE, limits).advance(20_000)
    assert trace.status is Status.STEPS_EXHAUSTED


def test_figures_of_an_impossible_motion_are_not_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(values, "STEP_BUDGET", 50)
    with pytest.raises(SimulationFailed, match="the crank stopped"):
        solver(TWIN)
