"""The impact beam as one of the rigs."""

from __future__ import annotations

from sim_twin.rigs.cycles import sine_cycles
from sim_twin.rigs.impact_beam.channels import channel_unit
from sim_twin.rigs.impact_beam.effects import EFFECTS
from sim_twin.rigs.impact_beam.healthy import draw_healthy, nominal_sensors, stray, tolerances
from sim_twin.rigs.impact_beam.model import ImpactBeam
from sim_twin.rigs.rig_model import Deferred, RigModel
from sim_twin.rigs.side_by_side import SideBySide

MODEL = RigModel(
    name="impact_beam",
    parameters=ImpactBeam,
    effects=EFFECTS,
    channel_unit=channel_unit,
    nominal_sensors=nominal_sensors,
    draw_healthy=draw_healthy,
    tolerances=tolerances,
    truth=Deferred("sim_twin.rigs.impact_beam.truth:BeamTruth"),
    solver_values=Deferred("sim_twin.rigs.impact_beam.solver_values:solver_values"),
    side_by_side=SideBySide(
        Deferred("sim_twin.rigs.impact_beam.lane_figures:figures"),
        Deferred("sim_twin.rigs.impact_beam.side_by_side:BeamTruths"),
    ),
    smooth_channels=("drive.force",),
    reference="drive.force",
    follow=sine_cycles,
    fine_rate=204_800.0,
    speed=55.0,
    joint_records=Deferred("sim_twin.rigs.impact_beam.joint_record:joint_records"),
    stray=stray,
)
