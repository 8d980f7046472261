"""The table's parameters, channels, healthy spread; what rattle asks of a rig is `MODEL`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

from daq.quantity import Bound, Quantity
from sim_twin.effects import Effect, Parameter, catalogue_of, sensor_gain
from sim_twin.healthy import Tolerance, factor, of_sensors
from sim_twin.ranges import require_bounds
from sim_twin.rigs.channel_table import ChannelTable, RigChannel, Role
from sim_twin.rigs.cycles import sine_cycles
from sim_twin.rigs.rig_model import Deferred, RigModel
from sim_twin.sensors import Sensor, SensorChain
from sim_twin.twin import AnyTwin

DRIVE = RigChannel("drive", "force", "N", Role.DRIVE)
STOP = RigChannel("stop", "force", "N", Role.CONTACT, group="stop")
TABLE = RigChannel("table", "acceleration", "m/s2", Role.VIBRATION)
CHANNELS = ChannelTable((DRIVE, STOP, TABLE))
_NOISE = {DRIVE.name: 0.02, STOP.name: 0.05, TABLE.name: 0.03}


@dataclass(frozen=True, slots=True)
class ImpactTable:
    """Mass m on spring k and damper c on a table, whose stop it meets at the gap; all in SI."""

    kind: ClassVar[str] = "impact_table"

    mass: Annotated[float, Quantity("kg", 0.01, 10), Bound("kg", 0.0, above=True)] = 0.5
    stiffness: Annotated[float, Quantity("N/m", 10, 1e6), Bound("N/m", 0.0, above=True)] = 7900.0
    damping: Annotated[float, Quantity("N s/m", 0, 1e3), Bound("N s/m", 0.0)] = 2.5
    gap: Annotated[float, Quantity("mm", 0.01, 10), Bound("m", 0.0)] = 0.5e-3
    contact_stiffness: Annotated[float, Quantity("N/m", 1e3, 1e8), Bound("N/m", 0.0)] = 1e6
    contact_damping: Annotated[float, Quantity("N s/m", 0, 1e4), Bound("N s/m", 0.0)] = 60.0
    table_mass: Annotated[float, Quantity("kg", 0.1, 100), Bound("kg", 0.0, above=True)] = 5.0
    table_stiffness: Annotated[float, Quantity("N/m", 0, 1e6), Bound("N/m", 0.0)] = 5000.0
    table_damping: Annotated[float, Quantity("N s/m", 0, 1e4), Bound("N s/m", 0.0)] = 30.0

    def __post_init__(self) -> None:
        require_bounds("ImpactTable", self)

    @property
    def model(self) -> RigModel:
        return MODEL

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(CHANNELS)


def nominal() -> ImpactTable:
    return ImpactTable()


def nominal_sensors(rig: ImpactTable, drive: Any) -> dict[str, Sensor]:
    return {name: SensorChain(noise=noise) for name, noise in _NOISE.items()}


def tolerances(twin: AnyTwin) -> tuple[Tolerance, ...]:
    return (
        factor("mass", 0.003, "kg", "rig.mass"),
        factor("stiffness", 0.005, "N/m", "rig.stiffness"),
        factor("damping", 0.1, "N s/m", "rig.damping"),
        factor("contact_stiffness", 0.05, "N/m", "rig.contact_stiffness"),
        factor("contact_damping", 0.1, "N s/m", "rig.contact_damping"),
        *of_sensors(twin),
        factor("gap", 0.02, "m", "rig.gap", each_run=True),
        factor("drive.amplitude", 0.01, "N", "drive.amplitude", each_run=True),
        factor("drive.frequency", 2e-4, "Hz", "drive.frequency", each_run=True),
    )


def scaled(name: str, location: str, field: str, *intervals: tuple[float, float]) -> Effect:
    """An effect that multiplies one of the table's parameters."""

    def change(twin: AnyTwin, values: Any) -> AnyTwin:
        rig = replace(twin.rig, **{field: getattr(twin.rig, field) * values["scale"]})
        return replace(twin, rig=rig)

    return Effect(name, location, (Parameter("scale", "", intervals),), change)


MODEL = RigModel(
    parameters=ImpactTable,
    effects=catalogue_of(
        ImpactTable.kind,
        (
            scaled("gap", "contact joint", "gap", (0.4, 0.8), (1.2, 2.0)),
            scaled("contact_stiffness", "contact joint", "contact_stiffness", (0.1, 0.6), (1.6, 5.0)),
            scaled("table_damping", "base", "table_damping", (3.0, 20.0)),
            sensor_gain((STOP.name, TABLE.name)),
        ),
    ),
    channels=CHANNELS,
    nominal_sensors=nominal_sensors,
    tolerances=tolerances,
    truth=Deferred("impact_table.motion:TableTruth"),
    solver_values=Deferred("impact_table.motion:solver_values"),
    smooth_channels=(DRIVE.name,),
    reference=DRIVE.name,
    follow=sine_cycles,
    fine_rate=204_800.0,
    speed=10.0,
)
