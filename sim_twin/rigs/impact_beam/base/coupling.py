"""Moving parts and base put together, in the modes of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.parts.beam import bending
from sim_twin.parts.modal import Elastic, lowest_modes
from sim_twin.parts.synthesis import Component, craig_bampton
from sim_twin.rigs.impact_beam.base.model import FlexibleBase, Shaker
from sim_twin.rigs.impact_beam.base.standing import (
    CONTACT,
    PIVOT_SLOPE,
    PIVOT_X,
    PIVOT_Z,
    SHAKER,
    standing_on,
)
from sim_twin.rigs.impact_beam.model import ImpactBeam

Array = NDArray[np.float64]
_COIL, _PIVOT_Z, _PIVOT_SLOPE, _PIVOT_X, _SHAKER = range(5)
"""What follows the beam's degrees of freedom."""


@dataclass(frozen=True, slots=True)
class Moving:
    """The reduced parts that move, damped by `C`. Rows (n,): coil minus shaker; coil; beam minus post at the
    pivot.

    `beam` gives the beam's degrees of freedom, shape (dofs, n).
    """

    component: Component
    C: Array
    drive: Array
    coil: Array
    rotation: Array
    beam: Array


def moving_on(rig: ImpactBeam, base: FlexibleBase) -> Moving:
    """Reduce beam, rod and coil to `rig.modes` modes and one more for the rod, damped like the last."""
    beam = rig.beam.elastic()
    dofs = len(beam.M)
    coil = _unit(dofs, _COIL) - base.shaker.share * _unit(dofs, _SHAKER)
    rotation = np.eye(dofs + 5)[1] - _unit(dofs, _PIVOT_SLOPE)
    rise = np.eye(dofs + 5)[0] - _unit(dofs, _PIVOT_Z)
    parts = beam.by(np.eye(dofs, dofs + 5)) + _rod(rig, base.shaker, dofs)
    parts = parts.with_mass(_unit(dofs, _PIVOT_X), rig.beam.mass_per_length * rig.beam.length)
    parts = parts.with_mass(_unit(dofs, _COIL), rig.shaker_mass).with_spring(coil, rig.shaker_stiffness)
    if not rig.clamped:
        parts = parts.with_spring(rotation, rig.rotation_stiffness).with_spring(
            rise, rig.pivot_stiffness or 0.0
        )
    # the mount ties to the post: the pin the beam's deflection, the clamp its slope too
    tie, tied = np.eye(dofs + 5), 2 if rig.clamped else int(rig.pivot_stiffness is None)
    tie[0, dofs + _PIVOT_Z], tie[1, dofs + _PIVOT_SLOPE] = float(tied > 0), float(tied > 1)
    tie = tie[:, tied:]
    boundary = tie[dofs + np.array([_PIVOT_Z, _PIVOT_SLOPE, _PIVOT_X, _SHAKER])]
    component = craig_bampton(parts.by(tie), boundary, rig.modes + 1, "ImpactBeam")
    motion = tie @ component.basis
    drive = coil @ motion
    C = rig.shaker_damping * np.outer(drive, drive)
    ratios = np.array([*rig.modal_damping, rig.modal_damping[-1]])
    interior = component.boundary + np.arange(rig.modes + 1)
    C[interior, interior] += 2 * ratios * component.omega
    alone = _unit(dofs, _COIL) @ motion
    return Moving(component, C, drive, alone, rotation @ motion, motion[:dofs])


def _unit(dofs: int, which: int) -> Array:
    row = np.zeros(dofs + 5)
    row[dofs + which] = 1.0
    return row


def _rod(rig: ImpactBeam, shaker: Shaker, dofs: int) -> Elastic:
    """One element from the coil, which only rises, up to the beam: it stretches, and bends with its slope.

    Its upper end goes along x with the pivot; against the slope dz/dx, a rod along z turns the other way.
    """
    length, d = shaker.rod_length, shaker.rod_diameter
    area, EI = np.pi * d**2 / 4, shaker.rod_modulus * np.pi * d**4 / 64
    along = np.array([_unit(dofs, _COIL), np.pad(rig.beam.deflection_row(rig.drive_position), (0, 5))])
    across = np.array([_unit(dofs, _PIVOT_X), -np.pad(rig.beam.slope_row(rig.drive_position), (0, 5))])
    mass = shaker.rod_density * area * length / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    stretching = Elastic(mass, np.sqrt(shaker.rod_modulus * area / length) * np.array([[-1.0, 1.0]]))
    upper_end = bending(EI, shaker.rod_density * area, length).by(np.eye(4)[:, 2:])
    return stretching.by(along) + upper_end.by(across)


@dataclass(frozen=True, slots=True)
class Coupled:
    """q'' + C q' + K q = forces in mass-normalised modes of the whole; rows as in Structure.

    `beam` gives the beam's degrees of freedom, shape (dofs, n), `contact_point` the yoke's.
    """

    K: Array
    C: Array
    drive: Array
    coil: Array
    rotation: Array
    contact_point: Array
    accelerometer: Array
    cover: Array
    beam: Array


def couple(rig: ImpactBeam, base: FlexibleBase) -> Coupled:
    """Join the moving parts of `rig` to `base` at pivot and shaker."""
    moving, standing = moving_on(rig, base), standing_on(base)
    own, count = standing.component.size, moving.component.size - moving.component.boundary
    shared = np.array([PIVOT_Z, PIVOT_SLOPE, PIVOT_X, SHAKER])
    every = np.eye(own + count)
    of_base, of_beam = every[:own], every[np.concatenate([shared, own + np.arange(count)])]
    whole = standing.component.elastic.by(of_base) + moving.component.elastic.by(of_beam)
    modes = lowest_modes(whole, own + count)
    lower, upper = of_base @ modes.shapes, of_beam @ modes.shapes
    return Coupled(
        np.diag(modes.omega**2),
        lower.T @ standing.C @ lower + upper.T @ moving.C @ upper,
        moving.drive @ upper,
        moving.coil @ upper,
        moving.rotation @ upper,
        lower[CONTACT],
        standing.accelerometer @ lower,
        standing.cover @ lower,
        moving.beam @ upper,
    )
