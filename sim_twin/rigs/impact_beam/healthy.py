"""What a healthy impact beam may differ by; clearance and drive are set anew for each run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.healthy import draw_sensors, scaled
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.channels import channel_unit
from sim_twin.rigs.impact_beam.model import BaseMass, ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.truth import BeamTwin
from sim_twin.sensors import Sensor, SensorChain
from sim_twin.twin import Twin

_NOISE = {"N": 0.05, "m/s2": 0.03}
_DRIVE_NOISE = 0.02
_YOKE_GAIN = 0.01
_STRAY = 1e-3
"""m/s2 for each N, at most."""
Array = NDArray[np.float64]
Base = BaseMass | FlexibleBase | None
_LEAST_SHARE = 0.05
"""Of a damping; the bell curve would reach below zero."""


def nominal_sensors(rig: ImpactBeam, drive: SineDrive | None = None) -> dict[str, Sensor]:
    """The measuring chains without tolerances, noise in place."""
    return {name: SensorChain(noise=_noise_of(name)) for name in rig.channels}


def draw_healthy(
    twin: BeamTwin, rng: np.random.Generator, run_rng: np.random.Generator | None = None
) -> BeamTwin:
    """Return `twin` as a healthy rig may really be, on one run.

    `rng` draws what belongs to the rig, `run_rng` (default: the same) clearance and drive, set anew each run.
    """
    each_run = rng if run_rng is None else run_rng
    noisy = replace(twin, sensors={**nominal_sensors(twin.rig), **twin.sensors})
    rig, sensors = _draw_rig(twin.rig, rng), draw_sensors(noisy, rng, {"yoke.force": _YOKE_GAIN})
    rig = replace(rig, clearance=rig.clearance * scaled(each_run, 0.02))
    return Twin(rig, _draw_drive(twin.drive, each_run), sensors)


def stray(twin: BeamTwin, signals: Array, rng: np.random.Generator) -> Array:
    """Return `signals` (channels, n) with what reaches the base's accelerometer of a rigid base.

    It picks up to 1e-3 m/s2 for each N of contact force, each rig its own share.
    """
    names = twin.channels
    if twin.rig.base is not None:
        return signals
    upper, lower = (signals[names.index(f"contact.force_{side}")] for side in ("upper", "lower"))
    picked = signals.copy()
    picked[names.index("base.acceleration")] += _STRAY * rng.uniform() * (upper - lower)
    return picked


def _noise_of(channel: str) -> float:
    return _DRIVE_NOISE if channel == "drive.force" else _NOISE[channel_unit(channel)]


def _draw_rig(rig: ImpactBeam, rng: np.random.Generator) -> ImpactBeam:
    part = rig.beam
    beam = replace(
        part,
        E=part.E * scaled(rng, 0.01),
        rho=part.rho * scaled(rng, 0.005),
        length=part.length * scaled(rng, 0.003),
        width=part.width * scaled(rng, 0.003),
        thickness=part.thickness * scaled(rng, 0.003),
    )
    common = scaled(rng, 0.12)
    damping = tuple(zeta * max(common * scaled(rng, 0.09), _LEAST_SHARE) for zeta in rig.modal_damping)
    return replace(
        rig,
        beam=beam,
        base=_draw_base(rig.base, rng),
        modal_damping=damping,
        contact_stiffness=rig.contact_stiffness * scaled(rng, 0.05),
        contact_damping=rig.contact_damping * max(scaled(rng, 0.2), _LEAST_SHARE),
        hertz=None if rig.hertz is None else rig.hertz * scaled(rng, 0.05),
        shaker_mass=rig.shaker_mass * scaled(rng, 0.003),
        yoke_frequency=rig.yoke_frequency * scaled(rng, 0.02),
    )


def _draw_base(base: Base, rng: np.random.Generator) -> Base:
    """A plate of its own modulus, density and thickness, its masses and damping; a mere yoke stays."""
    if not isinstance(base, FlexibleBase):
        return base
    sheet = replace(base.sheet, E=base.sheet.E * scaled(rng, 0.01), rho=base.sheet.rho * scaled(rng, 0.005))
    sheet = replace(sheet, thickness=sheet.thickness * scaled(rng, 0.003))
    yoke = replace(base.yoke, sensor_mass=base.yoke.sensor_mass * scaled(rng, 0.003))
    shaker = replace(base.shaker, body_mass=base.shaker.body_mass * scaled(rng, 0.003))
    damping = base.damping_ratio * max(scaled(rng, 0.15), _LEAST_SHARE)
    return replace(base, sheet=sheet, yoke=yoke, shaker=shaker, damping_ratio=damping)


def _draw_drive(drive: SineDrive, rng: np.random.Generator) -> SineDrive:
    return replace(
        drive, amplitude=drive.amplitude * scaled(rng, 0.01), frequency=drive.frequency * scaled(rng, 2e-4)
    )
