"""The planar slider-crank as one of the rigs."""

from __future__ import annotations

from sim_twin.rigs.cycles import angle_cycles
from sim_twin.rigs.planar_slider_crank.channels import channel_unit
from sim_twin.rigs.planar_slider_crank.effects import EFFECTS
from sim_twin.rigs.planar_slider_crank.healthy import draw_healthy, nominal_sensors, tolerances
from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank
from sim_twin.rigs.rig_model import Deferred, RigModel

MODEL = RigModel(
    name="planar_slider_crank",
    parameters=PlanarSliderCrank,
    effects=EFFECTS,
    channel_unit=channel_unit,
    nominal_sensors=nominal_sensors,
    draw_healthy=draw_healthy,
    tolerances=tolerances,
    truth=Deferred("sim_twin.rigs.planar_slider_crank.truth:CrankTruth"),
    solver_values=Deferred("sim_twin.rigs.planar_slider_crank.solver_values:solver_values"),
    reference="crank.angle",
    follow=angle_cycles,
    fine_rate=51_200.0,
    speed=55.0,
    joint_records=Deferred("sim_twin.rigs.planar_slider_crank.joint_record:joint_records"),
)
