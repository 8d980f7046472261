"""Scenario sections and channels of the planar slider-crank (physics.md section 2; Erkaya's rig)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final, Literal

from pydantic.dataclasses import dataclass

from rig.crank.channels import PLANAR_SLIDER_CRANK
from rig.files.benches.planar_slider_crank import BENCH
from rig.files.fields import Measured, Word
from rig.files.rigs.kind import RigKind, unit_or_none
from rig.files.rigs.speed import MAXIMUM_SPEED, SpeedSection, highest_speed, revolutions_per_second
from rig.files.section import SECTION, Check
from sim_twin.rigs.planar_slider_crank.channels import CHANNELS, channel_unit

_DEFAULT_LENGTHS_M: Final = {"crank_length": 0.150, "rod_length": 0.564}


@dataclass(frozen=True, slots=True, config=SECTION)
class PlanarSliderCrankSection:
    """What the operator believes the mechanism to be, in SI; None is the default.

    Clearances are radial: 1 at the crank pin, 2 at the piston pin. Gravity acts downwards.
    """

    clearance_1: Annotated[float | None, Measured("mm", 0.001, 10)] = None
    clearance_2: Annotated[float | None, Measured("mm", 0.001, 10)] = None
    restitution: Annotated[float | None, Measured("", 0.05, 1)] = None
    friction: Annotated[float | None, Measured("", 0, 1)] = None
    journal_radius: Annotated[float | None, Measured("mm", 1, 100)] = None
    material: Annotated[
        Literal["steel", "aluminium", "brass"] | None, Word(("steel", "aluminium", "brass"))
    ] = None
    crank_length: Annotated[float | None, Measured("m", 0.01, 2)] = None
    rod_length: Annotated[float | None, Measured("m", 0.02, 5)] = None
    crank_mass: Annotated[float | None, Measured("kg", 0.001, 100)] = None
    rod_mass: Annotated[float | None, Measured("kg", 0.001, 100)] = None
    piston_mass: Annotated[float | None, Measured("kg", 0.001, 100)] = None
    crank_inertia: Annotated[float | None, Measured("kg m^2", 1e-7, 100)] = None
    rod_inertia: Annotated[float | None, Measured("kg m^2", 1e-7, 100)] = None
    gravity: Annotated[float | None, Measured("m/s^2", 0, 100)] = None


def _turns_over(model: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    crank, rod = (model[key] or default for key, default in _DEFAULT_LENGTHS_M.items())
    if rod <= crank:
        key = "rod_length" if model["rod_length"] else "crank_length"
        yield key, f"a rod longer than the crank, or it cannot turn over: {rod:g} m and {crank:g} m"


KIND: Final = RigKind(
    name="planar_slider_crank",
    actuator="inverter",
    bench=BENCH,
    set_up=("clearance_1", "clearance_2"),
    model=PlanarSliderCrankSection,
    model_checks=(Check(("crank_length", "rod_length"), _turns_over),),
    drive=SpeedSection,
    drive_checks=(),
    channels=CHANNELS,
    channel_unit=unit_or_none(channel_unit),
    drive_frequency=revolutions_per_second,
    drive_peak=highest_speed,
    highest=MAXIMUM_SPEED,
    by_hand={
        "clearance_1": "fit the crank pin with that radial clearance",
        "clearance_2": "fit the piston pin with that radial clearance",
        "material": "mount the links of that material",
    },
    extras=("encoder",),
    crank=PLANAR_SLIDER_CRANK,
)
