"""What the catalogue's effects change in the rig; those of sensors and clocks are the measuring chain's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from benchmarks.blind.changes import Values
from benchmarks.blind.crank.rig import Crank, Mode, Ripple

Change: TypeAlias = Callable[[Crank, Values], Crank]


def _clearance_1(crank: Crank, values: Values) -> Crank:
    first, second = crank.clearances
    return replace(crank, clearances=(first * values["scale"], second))


def _clearance_2(crank: Crank, values: Values) -> Crank:
    first, second = crank.clearances
    return replace(crank, clearances=(first, second * values["scale"]))


def _stiffness(crank: Crank, values: Values) -> Crank:
    first, second = crank.stiffness_scales
    return replace(crank, stiffness_scales=(first * values["scale"], second * values["scale"]))


def _ripple(crank: Crank, values: Values) -> Crank:
    return replace(crank, ripple=Ripple(values["amplitude"], values["order"], values["phase_rad"]))


def _frame(crank: Crank, values: Values) -> Crank:
    channel, scale = values["channel"], values["frequency_scale"]
    mode = crank.frames[channel]
    frames = {**crank.frames, channel: replace(mode, frequency=mode.frequency * scale)}
    return replace(crank, frames=frames)


CATALOGUE: dict[str, Change] = {
    "joint1_clearance": _clearance_1,
    "joint2_clearance": _clearance_2,
    "contact_stiffness": _stiffness,
    "restitution": lambda crank, values: replace(crank, restitution=values["value"]),
    "joint_friction": lambda crank, values: replace(crank, friction=values["coefficient"]),
    "guide_friction": lambda crank, values: replace(crank, guide_friction=values["coefficient"]),
    "rod_flexibility": lambda crank, values: replace(
        crank, bending=Mode(values["frequency_hz"], values["damping_ratio"])
    ),
    "speed_fluctuation": _ripple,
    "piston_mass": lambda crank, values: replace(crank, piston_mass=crank.piston_mass * values["scale"]),
    "frame_resonance": _frame,
}
CHAIN_EFFECTS = ("sensor_gain", "sensor_bandwidth", "time_skew")
