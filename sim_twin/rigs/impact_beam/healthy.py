"""What a healthy impact beam may differ by; clearance and drive are set anew for each run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim_twin.healthy import Tolerance, drawn, factor, of_sensors
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.channels import channel_unit
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.sensors import Sensor, SensorChain

_NOISE = {"N": 0.05, "m/s2": 0.03}
_DRIVE_NOISE = 0.02
_YOKE_GAIN = 0.01
_STRAY = 1.1e-3
"""m/s2 for each N, at most."""
Array = NDArray[np.float64]


_PARTS = (
    factor("beam.E", 0.01, "Pa", "rig.beam.E"),
    factor("beam.rho", 0.005, "kg/m3", "rig.beam.rho"),
    factor("beam.length", 0.003, "m", "rig.beam.length"),
    factor("beam.width", 0.003, "m", "rig.beam.width"),
    factor("beam.thickness", 0.003, "m", "rig.beam.thickness"),
    factor("contact_stiffness", 0.05, "N/m", "rig.contact_stiffness", also={"rig.hertz": 1}),
    factor("contact_damping", 0.2, "N s/m", "rig.contact_damping"),
    factor("shaker_mass", 0.003, "kg", "rig.shaker_mass"),
    factor("yoke_frequency", 0.02, "Hz", "rig.yoke_frequency"),
)

if TYPE_CHECKING:
    from sim_twin.rigs.impact_beam.truth import BeamTwin
_BASE = (
    factor("base.E", 0.01, "Pa", "rig.base.sheet.E"),
    factor("base.rho", 0.005, "kg/m3", "rig.base.sheet.rho"),
    factor("base.thickness", 0.003, "m", "rig.base.sheet.thickness"),
    factor("base.yoke_mass", 0.003, "kg", "rig.base.yoke.sensor_mass"),
    factor("base.shaker_mass", 0.003, "kg", "rig.base.shaker.body_mass"),
    factor("base.damping", 0.15, "", "rig.base.damping_ratio"),
)
"""Of a plate; a mere yoke stays."""
_EACH_RUN = (
    factor("clearance", 0.02, "m", "rig.clearance", each_run=True),
    factor("drive.amplitude", 0.01, "N", "drive.amplitude", each_run=True),
    factor("drive.frequency", 2e-4, "Hz", "drive.frequency", each_run=True),
)


def nominal_sensors(rig: ImpactBeam, drive: SineDrive | None = None) -> dict[str, Sensor]:
    """The measuring chains without tolerances, noise in place."""
    return {name: SensorChain(noise=_noise_of(name)) for name in rig.channels}


def tolerances(twin: BeamTwin) -> tuple[Tolerance, ...]:
    """All that a healthy rig like `twin` may differ by."""
    return (
        *_PARTS,
        *_dampings(twin.rig.modes),
        *(_BASE if isinstance(twin.rig.base, FlexibleBase) else ()),
        *of_sensors(twin, {"yoke.force": _YOKE_GAIN}),
        *_EACH_RUN,
    )


def draw_healthy(
    twin: BeamTwin, rng: np.random.Generator, run_rng: np.random.Generator | None = None
) -> BeamTwin:
    """Return `twin` as a healthy rig may really be, on one run.

    `rng` draws what belongs to the rig, `run_rng` (default: the same) clearance and drive, set anew each run.
    """
    noisy = replace(twin, sensors={**nominal_sensors(twin.rig), **twin.sensors})
    return drawn(noisy, tolerances(noisy), rng, run_rng)


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


def _dampings(modes: int) -> list[Tolerance]:
    """In common to all modes, and each mode by itself."""
    places = [f"rig.modal_damping.{mode}" for mode in range(modes)]
    common = factor("modal_damping", 0.12, "", places[0], also=dict.fromkeys(places[1:], 1))
    own = (factor(f"modal_damping_{mode + 1}", 0.09, "", place) for mode, place in enumerate(places))
    return [common, *own]
