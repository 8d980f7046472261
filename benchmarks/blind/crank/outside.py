"""What may be wrong that the catalogue does not hold: in the mechanism, on the way, in a channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from scipy import signal

from benchmarks.blind.changes import Values
from benchmarks.blind.crank.effects import Change
from benchmarks.blind.crank.parts import Array
from benchmarks.blind.crank.rig import CRANK_X, CRANK_Y, PISTON_Y, Crank, Ripple
from benchmarks.blind.outsiders import ANY_PHASE, FAULTS, Outside, either_way, of_channels, outside
from benchmarks.blind.pages import EXPONENT, MODES_OFF, STRIBECK, detuned, wrong_values

__all__ = ["FAULTS", "MECHANICAL", "MILD", "ON_THE_WAY", "PAGES", "STRONG"]
ACCELERATIONS = (CRANK_Y, CRANK_X, PISTON_Y)
_ACROSS = (CRANK_Y, PISTON_Y)
_TOWARDS = {CRANK_Y: CRANK_X, CRANK_X: CRANK_Y, PISTON_Y: CRANK_X}
_ONE_OF_TWO = ((1.0, 1.0), (2.0, 2.0))
_JOINTS = ("joint 1", "joint 2")
OnTheWay: TypeAlias = Callable[[dict[str, Array], float, Values, np.random.Generator], dict[str, Array]]

STRONG = (
    outside("rod_mass", "rod", scale=either_way(0.35, 0.6)),
    outside("crank_length", "drive", also=("joint 1", "model"), scale=either_way(0.15, 0.3)),
    outside("oval_bearing", "joints", also=_JOINTS, joint=_ONE_OF_TWO, fraction=(0.4, 0.8)),
    outside("guide_offset", "guide", also=("piston",), offset_m=((-0.22, -0.12), (0.12, 0.22))),
    outside("air_spring", "piston", also=("guide",), stiffness_n_per_m=(1e3, 8e3)),
    outside("piston_drag", "piston", also=("guide",), damping_ns_per_m=(30.0, 200.0)),
    outside("oil_film", "joints", also=_JOINTS, damping_ns_per_m=(100.0, 1000.0)),
    outside("softer_law", "joints", also=_JOINTS, exponent=(1.05, 1.15)),
    outside("belt_ripple", "drive", amplitude=(0.03, 0.06), order=(6.2, 11.8), phase_rad=ANY_PHASE),
    outside("cross_axis", "sensor", _ACROSS, also=("frame",), fraction=(0.3, 0.7)),
    outside(
        "loose_mount", "sensor", ACCELERATIONS, ("frame",),
        frequency_hz=(900.0, 5000.0), damping_ratio=(0.02, 0.08),
    ),
    outside(
        "neighbour_machine", "frame", also=("sensor",),
        frequency_hz=(40.0, 700.0), amplitude_m_per_s2=(8.0, 30.0),
    ),
    *of_channels(ACCELERATIONS, True, (4.0, 20.0), None),
)  # fmt: skip
MILD = (
    outside("rod_mass", "rod", scale=either_way(0.08, 0.2)),
    outside("crank_length", "drive", also=("joint 1", "model"), scale=either_way(0.03, 0.07)),
    outside("oval_bearing", "joints", also=_JOINTS, joint=_ONE_OF_TWO, fraction=(0.1, 0.25)),
    outside("guide_offset", "guide", also=("piston",), offset_m=((-0.05, -0.02), (0.02, 0.05))),
    outside("air_spring", "piston", also=("guide",), stiffness_n_per_m=(150.0, 500.0)),
    outside("piston_drag", "piston", also=("guide",), damping_ns_per_m=(4.0, 15.0)),
    outside("oil_film", "joints", also=_JOINTS, damping_ns_per_m=(10.0, 50.0)),
    outside("softer_law", "joints", also=_JOINTS, exponent=(1.25, 1.35)),
    outside("belt_ripple", "drive", amplitude=(0.005, 0.015), order=(6.2, 11.8), phase_rad=ANY_PHASE),
    outside("cross_axis", "sensor", _ACROSS, also=("frame",), fraction=(0.06, 0.15)),
    outside(
        "loose_mount", "sensor", ACCELERATIONS, ("frame",),
        frequency_hz=(5000.0, 9000.0), damping_ratio=(0.02, 0.08),
    ),
    outside(
        "neighbour_machine", "frame", also=("sensor",),
        frequency_hz=(40.0, 700.0), amplitude_m_per_s2=(1.5, 5.0),
    ),
    *of_channels(ACCELERATIONS, False, (0.8, 3.0), None),
)  # fmt: skip


def _oval(crank: Crank, values: Values) -> Crank:
    moved, joint = [0.0, 0.0], int(values["joint"]) - 1
    moved[joint] = values["fraction"] * crank.clearances[joint]
    return replace(crank, ovality=(moved[0], moved[1]))


def _detuned(crank: Crank, values: Values) -> Crank:
    factors = detuned(values, len(crank.frames))
    frames = {
        name: replace(mode, frequency=mode.frequency * factor)
        for (name, mode), factor in zip(crank.frames.items(), factors, strict=True)
    }
    return replace(crank, frames=frames)


def _scaled(field: str) -> Change:
    return lambda crank, values: replace(crank, **{field: getattr(crank, field) * values["scale"]})


_VALUES: Mapping[str, tuple[float, float, Change]] = {
    "crank_length": (0.015, 0.04, _scaled("crank_length")),
    "rod_length": (0.015, 0.04, _scaled("rod_length")),
    "rod_mass": (0.04, 0.12, _scaled("rod_mass")),
    "gravity": (0.03, 0.1, _scaled("gravity")),
}
"""Keys of [model]: by how much somebody may have them wrong, of one, and what that is in the rig."""

PAGES: Mapping[str, Sequence[Outside]] = {
    "exponent": (EXPONENT,),
    "modes": (MODES_OFF,),
    "friction": (STRIBECK,),
    "value": wrong_values(_VALUES),
}

MECHANICAL: dict[str, Change] = {
    "rod_mass": _scaled("rod_mass"),
    "crank_length": _scaled("crank_length"),
    "oval_bearing": _oval,
    "guide_offset": lambda crank, v: replace(crank, guide_offset=v["offset_m"]),
    "air_spring": lambda crank, v: replace(crank, air_spring=v["stiffness_n_per_m"]),
    "piston_drag": lambda crank, v: replace(crank, drag=v["damping_ns_per_m"]),
    "softer_law": lambda crank, v: replace(crank, exponent=v["exponent"]),
    "oil_film": lambda crank, v: replace(crank, film=v["damping_ns_per_m"]),
    "belt_ripple": lambda crank, v: replace(crank, ripple=Ripple(v["amplitude"], v["order"], v["phase_rad"])),
    EXPONENT.name: lambda crank, v: replace(crank, exponent=v["exponent"]),
    MODES_OFF.name: _detuned,
    STRIBECK.name: lambda crank, v: replace(crank, stribeck=(v["more"], v["fading_m_per_s"])),
    **{f"wrong_{key}": change for key, (_, _, change) in _VALUES.items()},
}


def _cross_axis(
    fine: dict[str, Array], rate: float, values: Values, rng: np.random.Generator
) -> dict[str, Array]:
    channel, sine = values["channel"], values["fraction"]
    mixed = np.sqrt(1 - sine**2) * fine[channel] + sine * fine[_TOWARDS[channel]]
    return {**fine, channel: mixed}


def _loose_mount(
    fine: dict[str, Array], rate: float, values: Values, rng: np.random.Generator
) -> dict[str, Array]:
    channel, omega = values["channel"], 2 * np.pi * values["frequency_hz"]
    b, a = signal.bilinear([omega**2], [1.0, 2 * values["damping_ratio"] * omega, omega**2], fs=rate)
    return {**fine, channel: np.asarray(signal.lfilter(b, a, fine[channel]))}


def _neighbour(
    fine: dict[str, Array], rate: float, values: Values, rng: np.random.Generator
) -> dict[str, Array]:
    """A machine next door: one tone of any phase, not the same at every accelerometer."""
    turned = 2 * np.pi * values["frequency_hz"] / rate
    shaken = dict(fine)
    for channel in ACCELERATIONS:
        share, phase = rng.uniform(0.3, 1.0), rng.uniform(0, 2 * np.pi)
        tone = np.sin(turned * np.arange(len(fine[channel])) + phase)
        shaken[channel] = fine[channel] + share * values["amplitude_m_per_s2"] * tone
    return shaken


ON_THE_WAY: dict[str, OnTheWay] = {
    "cross_axis": _cross_axis,
    "loose_mount": _loose_mount,
    "neighbour_machine": _neighbour,
}
