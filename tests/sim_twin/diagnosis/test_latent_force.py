"""What is missing at a joint shows as a force: on records of another program, and on closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import TransferFunction, freqresp

from sim_twin.diagnosis.campaign import Campaign, RunSetting
from sim_twin.diagnosis.fingerprint import Columns
from sim_twin.diagnosis.latent_force import DISPLACEMENT, Axis, Curve, LatentForce, latent_forces
from sim_twin.diagnosis.subject import Draw
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.cycles import Cycles
from sim_twin.rigs.impact_beam.joint_record import joint_records as at_the_stops
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import MODEL as BEAM
from sim_twin.rigs.planar_slider_crank.channels import CRANK_X
from sim_twin.rigs.planar_slider_crank.joint_record import joint_records as on_the_frame
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.rig import MODEL as CRANK
from sim_twin.twin import Twin

RATE = 25_600.0
SPRING = 2400.0
"""N/m."""


def crank() -> Twin[Any, Any]:
    rig, drive = PlanarSliderCrank(), SpeedDrive(200 * 2 * np.pi / 60)
    return Twin(rig, drive, CRANK.nominal_sensors(rig, drive))


def beam() -> Twin[Any, Any]:
    rig, drive = nominal(), SineDrive(9.0, 20.0)
    return Twin(rig, drive, BEAM.nominal_sensors(rig, drive))


def campaign(twin: Twin[Any, Any], frequency: float) -> Campaign:
    channels = twin.channels
    angles = tuple(name for name in channels if name == "crank.angle")
    return Campaign((RunSetting(twin, Columns(channels, (), frequency, RATE, angles), 8, 6),))


def all_sound(records: Any) -> np.ndarray:
    return np.ones(min(len(each) for each in records.values()), dtype=bool)


def curve_of(found: list[LatentForce], joint: str, axis: Axis) -> Curve:
    (latent,) = [each for each in found if each.joint == joint]
    return next(curve for curve in latent.curves if curve.axis is axis)


@pytest.mark.long
def test_a_spring_of_another_program_shows_as_a_line_over_displacement() -> None:
    from benchmarks.blind.crank.record import record

    scenario = {"speed": 200 * 2 * np.pi / 60, "clearance_1": 1e-3, "clearance_2": 1e-3,
                "sample_rate": RATE, "settle": 1.0, "duration": 4.0}  # fmt: skip
    spring = {"name": "air_spring", "parameters": {"stiffness_n_per_m": SPRING}}
    shown = record(scenario, (spring,), 3, 1).channels
    found = latent_forces(campaign(crank(), 200 / 60), [shown], [all_sound(shown)], 0)

    assert found[0].joint == "crank bearing, along the guide"
    curve = curve_of(found, found[0].joint, DISPLACEMENT)
    middles = (curve.edges[:-1] + curve.edges[1:]) / 2
    known = np.isfinite(curve.latent)
    slope, _ = np.polyfit(middles[known], curve.latent[known], 1)
    # what presses on the piston presses on the frame the other way; 12 healthy rigs scatter by some 40 N
    assert slope == pytest.approx(-SPRING, rel=0.15)


def test_healthy_records_lack_nothing_and_a_softer_stop_does() -> None:
    setting = campaign(beam(), 20.0)
    softer = ("contact_stiffness", {"scale": 0.2})

    def at_upper_stop(*effects: Any) -> list[Curve]:
        (rigs,) = setting.records([Draw(effects, seed, blocks=4) for seed in (61, 66, 71)])
        found = [latent_forces(setting, [records], [all_sound(records)], 0) for records in rigs]
        return [curve_of(each, "upper stop", DISPLACEMENT) for each in found]

    usual, lacking = at_upper_stop(), at_upper_stop(softer)
    # In units of what 12 healthy rigs scatter by, one more lies about 1 away (0.4 to 1.3 in 30, once 2.5).
    assert np.median([curve.size for curve in usual]) < 1.5
    assert np.median([curve.size for curve in lacking]) > 2.0
    pressed = [np.nanmean(curve.latent[curve.edges[1:] > 1e-6]) for curve in lacking]
    assert max(pressed) < 0, "a softer stop pushes less at the same displacement"


def test_the_force_on_a_frame_is_that_of_its_equation_of_motion() -> None:
    rig, frequency, count = crank().rig, 200 / 60, int(4 * RATE)
    mode, t = rig.frames[CRANK_X], np.arange(count) / RATE
    omega, decay = 2 * np.pi * mode.frequency, 2 * mode.damping_ratio * 2 * np.pi * mode.frequency
    oscillator = TransferFunction([1 / mode.mass, 0.0, 0.0], [1.0, decay, omega**2])
    orders, sizes = np.array([1, 2, 7, 60]), np.array([300.0, 80.0, 40.0, 200.0])
    _, response = freqresp(oscillator, 2 * np.pi * frequency * orders)
    turns = np.exp(2j * np.pi * frequency * np.outer(orders, t))
    force = sizes @ turns.real
    acceleration = ((sizes * response)[:, None] * turns).real.sum(axis=0)

    (found,) = on_the_frame(crank(), {CRANK_X: acceleration}, Cycles(frequency, 0.0, RATE))
    known = np.isfinite(found.force)
    assert known.mean() > 0.8
    # the ends are faded out: what leaks below the lowest harmonic is lost, some 3 %
    assert np.std(found.force[known] - force[known]) < 0.04 * np.std(force)
    assert found.displacement[0] == pytest.approx(rig.crank_length)
    assert found.velocity == pytest.approx(np.gradient(found.displacement, 1 / RATE), abs=0.02)


def test_a_joint_that_never_touches_tells_nothing() -> None:
    quiet = {name: np.zeros(4096) for name in ("drive.force", "contact.force_upper", "contact.force_lower")}
    assert at_the_stops(beam(), quiet, Cycles(20.0, 0.0, RATE)) == ()
    assert at_the_stops(beam(), {"drive.force": np.zeros(9)}, Cycles(20.0, 0.0, RATE)) == ()
