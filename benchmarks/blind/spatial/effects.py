"""What the catalogue's effects change in the rig; those of sensors and clocks are the measuring chain's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from benchmarks.blind.changes import Values
from benchmarks.blind.crank.rig import Ripple
from benchmarks.blind.spatial.rig import Base, Spatial

Change: TypeAlias = Callable[[Spatial, Values], Spatial]


def _base(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, base=Base(values["frequency_hz"], values["mass_kg"], values["damping_ratio"]))


def _socket_clearance(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, socket_clearance=rig.socket_clearance * values["scale"])


def _guide_clearance(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, guide_clearance=rig.guide_clearance * values["scale"])


def _guide_friction(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, friction=replace(rig.friction, coefficient=values["coefficient"]))


def _stiffness(rig: Spatial, values: Values) -> Spatial:
    socket, guide = (
        replace(contact, stiffness=contact.stiffness * values["scale"]) for contact in (rig.socket, rig.guide)
    )
    return replace(rig, socket=socket, guide=guide)


def _damping(rig: Spatial, values: Values) -> Spatial:
    socket, guide = (
        replace(contact, damping=contact.damping * values["scale"]) for contact in (rig.socket, rig.guide)
    )
    return replace(rig, socket=socket, guide=guide)


def _rod(rig: Spatial, values: Values) -> Spatial:
    return replace(rig, rod=replace(rig.rod, modulus=rig.rod.modulus * values["scale"]))


def ripple(rig: Spatial, values: Values) -> Spatial:
    """A motor that does not keep its speed."""
    return replace(rig, ripple=Ripple(values["amplitude"], values["order"], values["phase_rad"]))


CATALOGUE: dict[str, Change] = {
    "base_flexibility": _base,
    "socket_clearance": _socket_clearance,
    "guide_clearance": _guide_clearance,
    "guide_friction": _guide_friction,
    "contact_stiffness": _stiffness,
    "contact_damping": _damping,
    "rod_stiffness": _rod,
    "speed_fluctuation": ripple,
}
CHAIN_EFFECTS = ("sensor_gain", "sensor_droop", "sensor_bandwidth", "time_skew")
