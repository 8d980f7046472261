"""What a healthy spatial slider-crank may differ by; the speed is set anew for each run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_twin.healthy import draw_sensors, scaled
from sim_twin.parts.rod import Rod
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.channels import FORCES, MARKER, TACHOMETER
from sim_twin.rigs.spatial_slider_crank.model import Slider, SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.truth import SpatialTwin
from sim_twin.sensors import Sensor, SensorChain
from sim_twin.twin import Twin

_MODULUS, _DENSITY, _PART, _MODAL_DAMPING = 0.01, 0.005, 0.003, 0.15
_STIFFNESS, _DAMPING, _CLEARANCE, _FRICTION, _SPEED = 0.05, 0.2, 0.02, 0.003, 2e-4
_LEAST_DAMPING = 0.05
_FORCE_NOISE, _MARKER_NOISE, _TACHOMETER_NOISE, _MARKER_RANGE = 0.05, 0.02, 1e-3, 10.0


def nominal_sensors(rig: SpatialSliderCrank, drive: SpeedDrive | None = None) -> dict[str, Sensor]:
    """The measuring chains without tolerances, noise in place; a tachometer's goes with the speed."""
    forces: dict[str, Sensor] = {name: SensorChain(noise=_FORCE_NOISE) for name in FORCES}
    speed = drive.speed if drive else 0.0
    marker = SensorChain(noise=_MARKER_NOISE, full_scale=_MARKER_RANGE)
    return {**forces, TACHOMETER: SensorChain(noise=_TACHOMETER_NOISE * speed), MARKER: marker}


def draw_healthy(
    twin: SpatialTwin, rng: np.random.Generator, run_rng: np.random.Generator | None = None
) -> SpatialTwin:
    """Return `twin` as a healthy rig may really be, on one run.

    `rng` draws what belongs to the rig, `run_rng` (default: the same) the speed.
    """
    noisy = replace(twin, sensors={**nominal_sensors(twin.rig, twin.drive), **twin.sensors})
    rig, sensors = draw_rig(twin.rig, rng), draw_sensors(noisy, rng)
    return Twin(rig, draw_run(twin.drive, rng if run_rng is None else run_rng), sensors)


def draw_rig(rig: SpatialSliderCrank, rng: np.random.Generator) -> SpatialSliderCrank:
    """Rod, slider and joints of one rig; the slider's inertia goes with its mass."""
    return replace(
        rig,
        crank_radius=rig.crank_radius * scaled(rng, _PART),
        rod=_drawn_rod(rig.rod, rng),
        slider=_drawn_slider(rig.slider, rng),
        modal_damping=rig.modal_damping * _lossy(rng, _MODAL_DAMPING),
        socket_clearance=rig.socket_clearance * scaled(rng, _CLEARANCE),
        socket_stiffness=rig.socket_stiffness * scaled(rng, _STIFFNESS),
        socket_damping=rig.socket_damping * _lossy(rng, _DAMPING),
        guide_clearance=rig.guide_clearance * scaled(rng, _CLEARANCE),
        guide_stiffness=rig.guide_stiffness * scaled(rng, _STIFFNESS),
        guide_damping=rig.guide_damping * _lossy(rng, _DAMPING),
        contact_span=rig.contact_span * scaled(rng, _PART),
        friction=max(0.0, float(rig.friction + _FRICTION * rng.standard_normal())),
    )


def draw_run(drive: SpeedDrive, rng: np.random.Generator) -> SpeedDrive:
    """The speed of one run."""
    return replace(drive, speed=drive.speed * scaled(rng, _SPEED))


def _lossy(rng: np.random.Generator, deviation: float) -> float:
    return max(scaled(rng, deviation), _LEAST_DAMPING)


def _drawn_rod(rod: Rod, rng: np.random.Generator) -> Rod:
    return replace(
        rod,
        E=rod.E * scaled(rng, _MODULUS),
        rho=rod.rho * scaled(rng, _DENSITY),
        diameter=rod.diameter * scaled(rng, _PART),
        length=rod.length * scaled(rng, _PART),
    )


def _drawn_slider(slider: Slider, rng: np.random.Generator) -> Slider:
    mass = scaled(rng, _PART)
    about_x, about_y, about_z = (mass * moment for moment in slider.inertia)
    return replace(slider, mass=slider.mass * mass, inertia=(about_x, about_y, about_z))
