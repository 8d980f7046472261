"""The linear structure of the impact beam, in mass-normalised coordinates: everything but stops and pivot
friction.

Coordinates q: modes of beam with flexure, moving shaker mass and suspension, and of the yoke on a `BaseMass`;
with a `FlexibleBase` the modes of beam, connecting rod and base together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from sim_twin.effects import BaseMass
from sim_twin.parts.modal import Modes, by_one_thread, lowest_modes
from sim_twin.rigs.impact_beam.base.coupling import couple
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.model import ImpactBeam

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Structure:
    """q'' + C q' + K q = sum of rows times forces, M = I; K, C of shape (n, n).

    Rows of shape (n,): motion at which the `drive` works (of the drive point; on a flexible base of the coil
    minus the shaker), `contact` (tip minus yoke), `rotation` at the pivot (beam minus post), and each of
    `stations` (stations, n). `base` is the row of the accelerometer on the base, None where it is rigid;
    `cover` has those of the accelerometers in the middle and near a corner of the cover, (2, n), or none;
    `coil` is the motion of the shaker's moving mass.
    """

    K: Array
    C: Array
    drive: Array
    contact: Array
    rotation: Array
    stations: Array
    base: Array | None
    cover: Array = field(default_factory=lambda: np.zeros((0, 0)))
    coil: Array = field(default_factory=lambda: np.zeros(0))


def structure_of(rig: ImpactBeam) -> Structure:
    """Return the structure of `rig`; raises UnphysicalParameter for more modes than the meshes have."""
    return _structure_of(replace(rig, **BESIDE))


BESIDE: Final[Mapping[str, Any]] = {
    "clearance": 0.0,
    "rest_offset": 0.0,
    "contact_stiffness": 1.0,
    "contact_damping": 0.0,
    "hertz": None,
    "pivot_friction": 0.0,
    "yoke_frequency": 700.0,
    "yoke_damping": 0.0,
    "stinger_gauge": False,
}
"""What a structure does not hang on: with these in, runs that differ by nothing else have the same."""


@lru_cache(maxsize=256)
@by_one_thread
def _structure_of(rig: ImpactBeam) -> Structure:
    if isinstance(rig.base, FlexibleBase):
        s = couple(rig, rig.base)
        tip = rig.beam.deflection_row(1.0) @ s.beam - s.contact_point
        stations = _deflection_rows(rig, np.array(rig.stations) / 100) @ s.beam
        return Structure(s.K, s.C, s.drive, tip, s.rotation, stations, s.accelerometer, s.cover, s.coil)
    modes, kept = _modes(rig), _kept_dofs(rig)

    def row(fraction: float) -> Array:
        return np.asarray(rig.beam.deflection_row(fraction)[kept] @ modes.shapes)

    drive = row(rig.drive_position)
    K = np.diag(modes.omega**2)
    C = np.diag(2 * np.array(rig.modal_damping) * modes.omega)
    C += rig.shaker_damping * np.outer(drive, drive)
    rotation = np.zeros(rig.modes) if rig.clamped else modes.shapes[np.searchsorted(kept, 1)]
    stations = np.array([row(percent / 100) for percent in rig.stations]).reshape(-1, rig.modes)
    fixed = Structure(K, C, drive, row(1.0), rotation, stations, None, coil=drive)
    return fixed if rig.base is None else _with_yoke(rig.base, fixed)


def deflection_shapes(rig: ImpactBeam, fractions: Array) -> Array:
    """Deflection rows at `fractions` of L, shape (len(fractions), 2 n), m per unit of state."""
    rows = _deflection_rows(rig, fractions)
    if isinstance(rig.base, FlexibleBase):
        shapes = rows @ couple(rig, rig.base).beam
    else:
        shapes = rows[:, _kept_dofs(rig)] @ _modes(rig).shapes
        shapes = np.pad(shapes, ((0, 0), (0, int(rig.base is not None))))
    return np.hstack([shapes, np.zeros_like(shapes)])


def _deflection_rows(rig: ImpactBeam, fractions: Array) -> Array:
    rows = [rig.beam.deflection_row(float(fraction)) for fraction in fractions]
    return np.array(rows).reshape(len(fractions), 2 * (rig.beam.elements + 1))


def _kept_dofs(rig: ImpactBeam) -> NDArray[np.int64]:
    fixed = 2 if rig.clamped else (1 if rig.pivot_stiffness is None else 0)
    return np.arange(fixed, 2 * (rig.beam.elements + 1))


def _modes(rig: ImpactBeam) -> Modes:
    beam, drive = rig.beam.elastic(), rig.beam.deflection_row(rig.drive_position)
    beam = beam.with_mass(drive, rig.shaker_mass).with_spring(drive, rig.shaker_stiffness)
    free = np.eye(len(beam.M))
    if not rig.clamped:
        beam = beam.with_spring(free[1], rig.rotation_stiffness).with_spring(
            free[0], rig.pivot_stiffness or 0.0
        )
    return lowest_modes(beam.by(free[:, _kept_dofs(rig)]), rig.modes)


def _with_yoke(base: BaseMass, fixed: Structure) -> Structure:
    omega = 2 * np.pi * base.frequency
    n = len(fixed.K)

    def grown(row: Array, last: float = 0.0) -> Array:
        return np.append(row, last)

    K, C = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    K[:n, :n], C[:n, :n] = fixed.K, fixed.C
    K[n, n], C[n, n] = omega**2, 2 * base.damping_ratio * omega
    return Structure(
        K,
        C,
        grown(fixed.drive),
        grown(fixed.contact, -1 / np.sqrt(base.mass)),
        grown(fixed.rotation),
        np.array([grown(row) for row in fixed.stations]).reshape(-1, n + 1),
        grown(np.zeros(n), 1 / np.sqrt(base.mass)),
        coil=grown(fixed.coil),
    )


@dataclass(frozen=True, slots=True)
class RestingBeam:
    """A beam that touches nothing.

    `compliance` in m/N is what a constant force at the drive moves its tip, `frequency` in Hz its lowest
    natural frequency, `decay_s` the time in which its slowest free motion falls to 1/e.
    """

    compliance: float
    frequency: float
    decay_s: float


def resting(rig: ImpactBeam) -> RestingBeam:
    """How the tip of `rig` stands between the stops."""
    s = structure_of(rig)
    n = len(s.K)
    poles = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-s.K, -s.C]]))
    lowest = float(np.sqrt(np.linalg.eigvalsh(s.K)[0])) / (2 * pi)
    return RestingBeam(tip_response(rig, 0.0).real, lowest, float(-1.0 / poles.real.max()))


def tip_response(rig: ImpactBeam, frequency: float) -> complex:
    """Complex motion of the tip (m) for each newton of a sine of `frequency` Hz at the drive."""
    s, omega = structure_of(rig), 2 * pi * frequency
    dynamic = np.asarray(s.K - omega**2 * np.eye(len(s.K)) + 1j * omega * s.C)
    return complex(s.contact @ np.linalg.solve(dynamic, s.drive))
