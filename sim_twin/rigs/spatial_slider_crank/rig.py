"""The spatial slider-crank as one of the rigs."""

from __future__ import annotations

from sim_twin.rigs.cycles import mark_cycles
from sim_twin.rigs.rig_model import Deferred, RigModel
from sim_twin.rigs.spatial_slider_crank.channels import channel_unit
from sim_twin.rigs.spatial_slider_crank.effects import EFFECTS
from sim_twin.rigs.spatial_slider_crank.healthy import draw_healthy, nominal_sensors, tolerances
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank

MODEL = RigModel(
    name="spatial_slider_crank",
    parameters=SpatialSliderCrank,
    effects=EFFECTS,
    channel_unit=channel_unit,
    nominal_sensors=nominal_sensors,
    draw_healthy=draw_healthy,
    tolerances=tolerances,
    truth=Deferred("sim_twin.rigs.spatial_slider_crank.truth:SpatialTruth"),
    solver_values=Deferred("sim_twin.rigs.spatial_slider_crank.solver_values:solver_values"),
    reference="flywheel.marker",
    follow=mark_cycles,
    fine_rate=51_200.0,
    speed=4.0,
)
