"""The planar slider-crank as one of the rigs, and what a healthy one may differ by.

The speed is set anew for each run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_twin.healthy import Tolerance, factor, of_sensors, shift
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.cycles import angle_cycles
from sim_twin.rigs.planar_slider_crank.channels import ACCELERATIONS, ANGLE, CHANNELS, MARKER
from sim_twin.rigs.planar_slider_crank.effects import EFFECTS
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.rig_model import Deferred, RigModel, SideBySide
from sim_twin.sensors import Encoder, Sensor, SensorChain

if TYPE_CHECKING:
    from sim_twin.rigs.planar_slider_crank.motion import CrankTwin

_NOISE, _MARKER_NOISE, _MARKER_RANGE = 0.05, 0.02, 10.0
_PARTS = (
    factor("crank_length", 0.003, "m", "rig.crank_length", also={"rig.crank_inertia": 2}),
    factor("rod_length", 0.003, "m", "rig.rod_length", also={"rig.rod_inertia": 2}),
    factor("crank_mass", 0.003, "kg", "rig.crank_mass", also={"rig.crank_inertia": 1}),
    factor("rod_mass", 0.003, "kg", "rig.rod_mass", also={"rig.rod_inertia": 1}),
    factor("piston_mass", 0.003, "kg", "rig.piston_mass"),
    factor("journal_radius", 0.003, "m", "rig.journal_radius"),
    factor("elastic.E", 0.01, "Pa", "rig.elastic.E"),
    factor("contact_stiffness_1", 0.05, "", "rig.stiffness_scales.0"),
    factor("contact_stiffness_2", 0.05, "", "rig.stiffness_scales.1"),
    factor("clearance_1", 0.02, "m", "rig.clearance_1"),
    factor("clearance_2", 0.02, "m", "rig.clearance_2"),
    shift("restitution", 0.02, "", "rig.restitution", low=0.0, high=1.0),
    shift("friction", 0.003, "", "rig.friction", low=0.0),
)

_EACH_RUN = (factor("drive.speed", 2e-4, "rad/s", "drive.speed", each_run=True),)


def nominal_sensors(rig: PlanarSliderCrank, drive: SpeedDrive | None = None) -> dict[str, Sensor]:
    """The measuring chains without tolerances, noise in place."""
    accelerometers: dict[str, Sensor] = {name: SensorChain(noise=_NOISE) for name in ACCELERATIONS}
    marker = SensorChain(noise=_MARKER_NOISE, full_scale=_MARKER_RANGE)
    return {**accelerometers, ANGLE: Encoder(), MARKER: marker}


def tolerances(twin: CrankTwin) -> tuple[Tolerance, ...]:
    """All that a healthy rig like `twin` may differ by."""
    frames = []
    for name in twin.rig.frames:
        place = ("rig", "frames", name)
        frames.append(factor(f"{name}.frame_frequency", 0.01, "Hz", (*place, "frequency")))
        frames.append(factor(f"{name}.frame_damping", 0.15, "", (*place, "damping_ratio")))
    return (*_PARTS, *frames, *of_sensors(twin), *_EACH_RUN)


MODEL = RigModel(
    parameters=PlanarSliderCrank,
    effects=EFFECTS,
    channels=CHANNELS,
    nominal_sensors=nominal_sensors,
    tolerances=tolerances,
    truth=Deferred("sim_twin.rigs.planar_slider_crank.motion:CrankTruth"),
    solver_values=Deferred("sim_twin.rigs.planar_slider_crank.solver_values:solver_values"),
    side_by_side=SideBySide(Deferred("sim_twin.rigs.planar_slider_crank.motion:CrankTruths")),
    reference=CHANNELS.angle,
    follow=angle_cycles,
    fine_rate=51_200.0,
    speed=55.0,
    joint_records=Deferred("sim_twin.rigs.planar_slider_crank.joint_record:joint_records"),
)
