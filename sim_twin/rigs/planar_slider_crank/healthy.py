"""What a healthy planar slider-crank may differ by; the speed is set anew for each run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_twin.contact.stiffness import Elastic
from sim_twin.healthy import draw_sensors, scaled
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, ANGLE, MARKER
from sim_twin.rigs.planar_slider_crank.model import FrameMode, PlanarSliderCrank
from sim_twin.rigs.planar_slider_crank.truth import CrankTwin
from sim_twin.sensors import Encoder, Sensor, SensorChain
from sim_twin.twin import Twin

_MODULUS, _PART, _STIFFNESS, _CLEARANCE = 0.01, 0.003, 0.05, 0.02
_RESTITUTION, _FRICTION = 0.02, 0.003
_FRAME_FREQUENCY, _FRAME_DAMPING, _SPEED = 0.01, 0.15, 2e-4
_NOISE, _MARKER_NOISE, _MARKER_RANGE = 0.05, 0.02, 10.0


def nominal_sensors(rig: PlanarSliderCrank, drive: SpeedDrive | None = None) -> dict[str, Sensor]:
    """The measuring chains without tolerances, noise in place."""
    accelerometers: dict[str, Sensor] = {name: SensorChain(noise=_NOISE) for name in ACCELERATIONS}
    marker = SensorChain(noise=_MARKER_NOISE, full_scale=_MARKER_RANGE)
    return {**accelerometers, ANGLE: Encoder(), MARKER: marker}


def draw_healthy(
    twin: CrankTwin, rng: np.random.Generator, run_rng: np.random.Generator | None = None
) -> CrankTwin:
    """Return `twin` as a healthy rig may really be, on one run.

    `rng` draws what belongs to the rig, `run_rng` (default: the same) the speed.
    """
    noisy = replace(twin, sensors={**nominal_sensors(twin.rig), **twin.sensors})
    rig, sensors = draw_rig(twin.rig, rng), draw_sensors(noisy, rng)
    return Twin(rig, draw_run(twin.drive, rng if run_rng is None else run_rng), sensors)


def draw_rig(rig: PlanarSliderCrank, rng: np.random.Generator) -> PlanarSliderCrank:
    """Lengths, masses, joints and frame of one rig; inertias go with mass and length squared."""
    crank, rod, crank_mass, rod_mass = (scaled(rng, _PART) for _ in range(4))
    first, second = rig.stiffness_scales
    return replace(
        rig,
        crank_length=rig.crank_length * crank,
        rod_length=rig.rod_length * rod,
        crank_mass=rig.crank_mass * crank_mass,
        rod_mass=rig.rod_mass * rod_mass,
        crank_inertia=rig.crank_inertia * crank_mass * crank**2,
        rod_inertia=rig.rod_inertia * rod_mass * rod**2,
        piston_mass=rig.piston_mass * scaled(rng, _PART),
        journal_radius=rig.journal_radius * scaled(rng, _PART),
        elastic=Elastic(rig.elastic.E * scaled(rng, _MODULUS), rig.elastic.nu),
        stiffness_scales=(first * scaled(rng, _STIFFNESS), second * scaled(rng, _STIFFNESS)),
        clearance_1=rig.clearance_1 * scaled(rng, _CLEARANCE),
        clearance_2=rig.clearance_2 * scaled(rng, _CLEARANCE),
        restitution=float(np.clip(rig.restitution + _RESTITUTION * rng.standard_normal(), 0.0, 1.0)),
        friction=max(0.0, float(rig.friction + _FRICTION * rng.standard_normal())),
        frames={name: _drawn_frame(mode, rng) for name, mode in rig.frames.items()},
    )


def draw_run(drive: SpeedDrive, rng: np.random.Generator) -> SpeedDrive:
    """The speed of one run."""
    return replace(drive, speed=drive.speed * scaled(rng, _SPEED))


def _drawn_frame(mode: FrameMode, rng: np.random.Generator) -> FrameMode:
    damping = mode.damping_ratio * max(scaled(rng, _FRAME_DAMPING), 0.05)
    return replace(mode, frequency=mode.frequency * scaled(rng, _FRAME_FREQUENCY), damping_ratio=damping)
