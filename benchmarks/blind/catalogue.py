"""The effects that the three rigs may hide, as plain data: the table of the text, not the twin's own.

A test holds it against the twin's catalogue, so that neither changes alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

BEAM, CRANK, SPATIAL = "impact_beam", "planar_slider_crank", "spatial_slider_crank"
PIVOTED_ONLY = ("pivot_friction", "pivot_compliance")
"""Effects that do not exist on the clamped (aluminium) beam."""

EffectEntry: TypeAlias = dict[str, object]
"""One entry of an effects file: `name` and `parameters`."""
Interval: TypeAlias = tuple[float, float]

_FORCES = ("contact.force_upper", "contact.force_lower", "yoke.force")
_FRAMES = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y")
_TOUCHED = (*(f"slider.force_{point}" for point in range(1, 9)), "socket.force")
_LEAST_DISTORTION = 0.04
Spacing = Literal["log", "even", "whole"]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter in SI: where a rig may lie, and how it is drawn there (by ratio, evenly, whole numbers)."""

    name: str
    intervals: tuple[Interval, ...]
    spacing: Spacing = "log"

    def draw(self, rng: np.random.Generator) -> float:
        """A value in one of the intervals, each as likely."""
        low, high = self.intervals[rng.integers(len(self.intervals))]
        if self.spacing == "whole":
            return float(rng.integers(round(low), round(high) + 1))
        if self.spacing == "even":
            return float(rng.uniform(low, high))
        return float(low * (high / low) ** rng.random())


@dataclass(frozen=True, slots=True)
class Cause:
    """An effect: where it lies, its parameters with the main one first, and the channels it may sit on."""

    name: str
    location: str
    quantities: tuple[Quantity, ...]
    channels: tuple[str, ...] = ()

    def draw(self, rng: np.random.Generator) -> EffectEntry:
        """An entry of an effects file."""
        values: dict[str, object] = {}
        if self.channels:
            values["channel"] = self.channels[rng.integers(len(self.channels))]
        values |= {each.name: each.draw(rng) for each in self.quantities}
        return {"name": self.name, "parameters": values}


@dataclass(frozen=True, slots=True)
class Distortion(Cause):
    """The drive's harmonics: one of them at least large enough to count."""

    def draw(self, rng: np.random.Generator) -> EffectEntry:
        """An entry with at least one harmonic of 0.04."""
        while True:
            second, third = (each.draw(rng) for each in self.quantities)
            if max(second, third) >= _LEAST_DISTORTION:
                return {"name": self.name, "parameters": {"second": second, "third": third}}


def _one(name: str, *intervals: Interval, spacing: Spacing = "log") -> tuple[Quantity, ...]:
    return (Quantity(name, intervals, spacing),)


_GAIN = _one("gain", (0.5, 0.92), (1.08, 2.0))
_BANDWIDTH = _one("corner_hz", (800.0, 8000.0))
_SKEW = _one("seconds", (-2e-3, -5e-5), (5e-5, 2e-3))
_STIFFNESS = _one("scale", (0.2, 0.7), (1.4, 5.0))
_JOINT = _one("scale", (0.3, 0.8), (1.25, 2.5))
_DAMPING = _one("damping_ratio", (0.003, 0.05))

_HARDER = _one("scale", (3.0, 20.0))
_DROOP = _one("corner_hz", (0.3, 10.0))
_BASE = (*_one("frequency_hz", (150.0, 1500.0)), *_one("mass_kg", (0.5, 8.0)), *_DAMPING)
_SPEED = (
    *_one("amplitude", (0.005, 0.05)),
    *_one("order", (1.0, 4.0), spacing="whole"),
    *_one("phase_rad", (-math.pi, math.pi), spacing="even"),
)

_BEAM_CAUSES = (
    Cause("clearance", "contact joint", _one("scale", (0.5, 0.9), (1.1, 2.0))),
    Cause("contact_stiffness", "contact joint", _STIFFNESS),
    Cause("contact_damping", "contact joint", _HARDER),
    Cause("hertzian_contact", "contact joint", _one("stiffness_n_per_m15", (3e9, 3e10))),
    Cause("base_flexibility", "base", _BASE),
    Cause("pivot_friction", "pivot", _one("torque_nm", (0.02, 0.3))),
    Cause("pivot_compliance", "pivot", _one("stiffness_n_per_m", (1e5, 5e7))),
    Cause("structural_damping", "beam", _one("scale", (2.0, 8.0))),
    Cause("shaker_mass", "drive", _one("mass_kg", (0.02, 0.3))),
    Cause(
        "shaker_suspension",
        "drive",
        (*_one("stiffness_n_per_m", (1e3, 3e4)), *_one("damping_ns_per_m", (2.0, 40.0))),
    ),
    Distortion(
        "drive_distortion",
        "drive",
        (*_one("second", (0.0, 0.2), spacing="even"), *_one("third", (0.0, 0.2), spacing="even")),
    ),
    Cause("sensor_gain", "sensor", _GAIN, ("drive.force", *_FORCES)),
    Cause("sensor_droop", "sensor", _DROOP, ("drive.force", *_FORCES)),
    Cause("sensor_bandwidth", "sensor", _BANDWIDTH, _FORCES),
    Cause("time_skew", "clock", _SKEW, ("drive.force", *_FORCES)),
)

_CRANK_CAUSES = (
    Cause("joint1_clearance", "joint 1", _JOINT),
    Cause("joint2_clearance", "joint 2", _JOINT),
    Cause("contact_stiffness", "joints", _STIFFNESS),
    Cause("restitution", "joints", _one("value", (0.3, 0.8), spacing="even")),
    Cause("joint_friction", "joints", _one("coefficient", (0.04, 0.3))),
    Cause("guide_friction", "guide", _one("coefficient", (0.1, 0.5))),
    Cause("rod_flexibility", "rod", (*_one("frequency_hz", (60.0, 500.0)), *_DAMPING)),
    Cause("speed_fluctuation", "drive", _SPEED),
    Cause("piston_mass", "piston", _one("scale", (0.5, 0.85), (1.2, 2.0))),
    Cause("frame_resonance", "frame", _one("frequency_scale", (0.6, 0.9), (1.1, 1.6)), _FRAMES),
    Cause("sensor_gain", "sensor", _GAIN, _FRAMES),
    Cause("sensor_bandwidth", "sensor", _BANDWIDTH, _FRAMES),
    Cause("time_skew", "clock", _SKEW, (*_FRAMES, "crank.marker")),
)

_SPATIAL_CAUSES = (
    Cause("base_flexibility", "base", _BASE),
    Cause("socket_clearance", "socket", _JOINT),
    Cause("guide_clearance", "guide", _JOINT),
    Cause("guide_friction", "guide", _one("coefficient", (0.0, 0.05), (0.16, 0.3), spacing="even")),
    Cause("contact_stiffness", "joints", _STIFFNESS),
    Cause("contact_damping", "joints", _HARDER),
    Cause("rod_stiffness", "rod", _one("scale", (0.4, 0.8), (1.25, 2.5))),
    Cause("speed_fluctuation", "drive", _SPEED),
    Cause("sensor_gain", "sensor", _GAIN, _TOUCHED),
    Cause("sensor_droop", "sensor", _DROOP, _TOUCHED),
    Cause("sensor_bandwidth", "sensor", _BANDWIDTH, _TOUCHED),
    Cause("time_skew", "clock", _SKEW, (*_TOUCHED, "flywheel.marker")),
)

CATALOGUE: Mapping[str, Mapping[str, Cause]] = {
    BEAM: {cause.name: cause for cause in _BEAM_CAUSES},
    CRANK: {cause.name: cause for cause in _CRANK_CAUSES},
    SPATIAL: {cause.name: cause for cause in _SPATIAL_CAUSES},
}


_FACTOR = _one("factor", (-1.05, -0.95), (0.095, 0.105), (9.5, 10.5))


def _wired(sensed: tuple[str, ...], alike: tuple[str, ...], *more: Cause) -> dict[str, Cause]:
    """Of sensors whose sensitivity or sign may be wrong, and of those `alike`, which may be swapped."""
    other = _one("other", (1.0, len(alike) - 1.0), spacing="whole")
    factor = Cause("sensor_factor", "sensor", _FACTOR, sensed)
    swapped = Cause("swapped_channels", "sensor", other, alike)
    return {cause.name: cause for cause in (factor, swapped, *more)}


WIRED: Mapping[str, Mapping[str, Cause]] = {
    BEAM: _wired(("drive.force", *_FORCES), _FORCES),
    CRANK: _wired(_FRAMES, _FRAMES, Cause("analog_delay", "clock", _SKEW)),
    SPATIAL: _wired(_TOUCHED, _TOUCHED),
}
"""What people wire wrongly, which the twins' catalogues hold beside these; a set of its own draws it.

The spatial crank has nothing that its analog channels could be late against.
"""


def swapped_by(values: Mapping[str, Any]) -> tuple[str, str]:
    """The channels of a `swapped_channels`: one, and the `other`-th one after it of its kind, in a ring."""
    one = str(values["channel"])
    ring = next(kind for kind in (_FORCES, _FRAMES, _TOUCHED) if one in kind)
    return one, ring[(ring.index(one) + int(values["other"])) % len(ring)]


def main_parameter(name: str, parameters: Mapping[str, object]) -> str:
    """The parameter that an effect is judged by: the first, or the larger harmonic of a distortion."""
    if name == "drive_distortion":
        return max(("second", "third"), key=lambda each: float(str(parameters[each])))
    every = (*CATALOGUE.values(), *WIRED.values())
    causes = (catalogue[name] for catalogue in every if name in catalogue)
    return next(causes).quantities[0].name
