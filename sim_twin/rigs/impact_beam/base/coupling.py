"""Moving parts and base put together, in the modes of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_twin.parts.modal import lowest_modes
from sim_twin.rigs.impact_beam.base.model import FlexibleBase
from sim_twin.rigs.impact_beam.base.moving import moving_on
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


@dataclass(frozen=True, slots=True)
class Coupled:
    """q'' + C q' + K q = forces in mass-normalised modes of the whole; rows as in Structure.

    `beam` gives the beam's degrees of freedom, shape (dofs, n), `contact_point` the yoke's.
    """

    K: Array
    C: Array
    drive: Array
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
        moving.rotation @ upper,
        lower[CONTACT],
        standing.accelerometer @ lower,
        standing.cover @ lower,
        moving.beam @ upper,
    )
