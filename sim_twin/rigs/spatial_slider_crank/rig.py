"""The spatial slider-crank as one of the rigs, and what a healthy one may differ by.

The speed is set anew for each run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_twin.healthy import Tolerance, factor, of_sensors, shift
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.cycles import mark_cycles
from sim_twin.rigs.rig_model import Deferred, RigModel, SideBySide
from sim_twin.rigs.spatial_slider_crank.channels import CHANNELS, FORCES, MARKER, TACHOMETER
from sim_twin.rigs.spatial_slider_crank.effects import EFFECTS
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.sensors import Sensor, SensorChain

if TYPE_CHECKING:
    from sim_twin.rigs.spatial_slider_crank.motion import SpatialTwin

_FORCE_NOISE, _MARKER_NOISE, _TACHOMETER_NOISE, _MARKER_RANGE = 0.05, 0.02, 1e-3, 10.0
_PARTS = (
    factor("crank_radius", 0.003, "m", "rig.crank_radius"),
    factor("rod.E", 0.01, "Pa", "rig.rod.E"),
    factor("rod.rho", 0.005, "kg/m3", "rig.rod.rho"),
    factor("rod.diameter", 0.003, "m", "rig.rod.diameter"),
    factor("rod.length", 0.003, "m", "rig.rod.length"),
    factor(
        "slider.mass",
        0.003,
        "kg",
        "rig.slider.mass",
        also={f"rig.slider.inertia.{axis}": 1 for axis in range(3)},
    ),
    factor("modal_damping", 0.15, "", "rig.modal_damping"),
    factor("socket_clearance", 0.02, "m", "rig.socket_clearance"),
    factor("socket_stiffness", 0.05, "N/m", "rig.socket_stiffness"),
    factor("socket_damping", 0.2, "N s/m", "rig.socket_damping"),
    factor("guide_clearance", 0.02, "m", "rig.guide_clearance"),
    factor("guide_stiffness", 0.05, "N/m", "rig.guide_stiffness"),
    factor("guide_damping", 0.2, "N s/m", "rig.guide_damping"),
    factor("contact_span", 0.003, "m", "rig.contact_span"),
    shift("friction", 0.003, "", "rig.friction", low=0.0),
)

_EACH_RUN = (factor("drive.speed", 2e-4, "rad/s", "drive.speed", each_run=True),)


def nominal_sensors(rig: SpatialSliderCrank, drive: SpeedDrive | None = None) -> dict[str, Sensor]:
    """The measuring chains without tolerances, noise in place; a tachometer's goes with the speed."""
    forces: dict[str, Sensor] = {name: SensorChain(noise=_FORCE_NOISE) for name in FORCES}
    speed = drive.speed if drive else 0.0
    marker = SensorChain(noise=_MARKER_NOISE, full_scale=_MARKER_RANGE)
    return {**forces, TACHOMETER: SensorChain(noise=_TACHOMETER_NOISE * speed), MARKER: marker}


def tolerances(twin: SpatialTwin) -> tuple[Tolerance, ...]:
    """All that a healthy rig like `twin` may differ by."""
    return (*_PARTS, *of_sensors(twin), *_EACH_RUN)


MODEL = RigModel(
    parameters=SpatialSliderCrank,
    effects=EFFECTS,
    channels=CHANNELS,
    nominal_sensors=nominal_sensors,
    tolerances=tolerances,
    truth=Deferred("sim_twin.rigs.spatial_slider_crank.motion:SpatialTruth"),
    solver_values=Deferred("sim_twin.rigs.spatial_slider_crank.solver_values:solver_values"),
    side_by_side=SideBySide(Deferred("sim_twin.rigs.spatial_slider_crank.motion:SpatialTruths")),
    reference=CHANNELS.marker,
    follow=mark_cycles,
    fine_rate=51_200.0,
    speed=20.0,
)
