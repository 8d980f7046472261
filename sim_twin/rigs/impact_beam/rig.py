"""The impact beam as one of the rigs, and what a healthy one may differ by.

Clearance and drive are set anew for each run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim_twin.healthy import Tolerance, factor, of_sensors
from sim_twin.rigs.cycles import sine_cycles
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.channels import BASE, CHANNELS, DRIVE, LOWER, UPPER, YOKE
from sim_twin.rigs.impact_beam.effects import EFFECTS
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.rig_model import Deferred, RigModel, SideBySide
from sim_twin.sensors import Sensor, SensorChain

if TYPE_CHECKING:
    from sim_twin.rigs.impact_beam.truth import BeamTwin

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
    return {
        name: SensorChain(noise=_DRIVE_NOISE if name == DRIVE.name else _NOISE[CHANNELS[name].unit])
        for name in rig.channels
    }


def tolerances(twin: BeamTwin) -> tuple[Tolerance, ...]:
    """All that a healthy rig like `twin` may differ by."""
    places = [f"rig.modal_damping.{mode}" for mode in range(twin.rig.modes)]
    return (
        *_PARTS,
        factor("modal_damping", 0.12, "", places[0], also=dict.fromkeys(places[1:], 1)),
        *(factor(f"modal_damping_{mode + 1}", 0.09, "", place) for mode, place in enumerate(places)),
        *(_BASE if isinstance(twin.rig.base, FlexibleBase) else ()),
        *of_sensors(twin, {YOKE.name: _YOKE_GAIN}),
        *_EACH_RUN,
    )


def stray(twin: BeamTwin, signals: Array, rng: np.random.Generator) -> Array:
    """Return `signals` (channels, n) with what reaches the base's accelerometer of a rigid base.

    It picks up to 1e-3 m/s2 for each N of contact force, each rig its own share.
    """
    names = twin.channels
    if twin.rig.base is not None:
        return signals
    upper, lower = (signals[names.index(side.name)] for side in (UPPER, LOWER))
    picked = signals.copy()
    picked[names.index(BASE.name)] += _STRAY * rng.uniform() * (upper - lower)
    return picked


MODEL = RigModel(
    parameters=ImpactBeam,
    effects=EFFECTS,
    channels=CHANNELS,
    nominal_sensors=nominal_sensors,
    tolerances=tolerances,
    truth=Deferred("sim_twin.rigs.impact_beam.truth:BeamTruth"),
    solver_values=Deferred("sim_twin.rigs.impact_beam.solver_values:solver_values"),
    side_by_side=SideBySide(
        Deferred("sim_twin.rigs.impact_beam.lanes:BeamTruths"),
        Deferred("sim_twin.rigs.impact_beam.lane_figures:figures"),
    ),
    smooth_channels=(CHANNELS.drive,),
    reference=CHANNELS.drive,
    follow=sine_cycles,
    fine_rate=204_800.0,
    speed=55.0,
    joint_records=Deferred("sim_twin.rigs.impact_beam.joint_record:joint_records"),
    stray=stray,
)
