"""What one lane simulates, in the words of mechanics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stops:
    """Two stops that w meets at +-`clearance` - `offset` (m); their force only pushes.

    F = `stiffness` d + `damping` d' at depth d > 0 (N/m, N s/m); with `hertz` (N/m^1.5) `hertz` d^1.5 instead
    of `stiffness` d.
    """

    stiffness: float
    damping: float
    clearance: float
    offset: float = 0.0
    hertz: float | None = None


@dataclass(frozen=True, slots=True)
class Harmonics:
    """A force sum of Re(U_k exp(i k p)), p = `omega` t + `phase`; `amplitudes` U_0, U_1, ... in N."""

    amplitudes: NDArray[np.complex128]
    omega: float
    phase: float = 0.0


@dataclass(frozen=True, slots=True)
class Lane:
    """q'' + C q' + K q = drive u - contact F - rotation T, with K, C of shape (n, n).

    Rows of shape (n,): `drive`; `contact`, which gives w = contact . q; `rotation` of the pivot, where the
    Coulomb torque T of at most `friction` N m acts. `accelerations` (rows, n) are recorded: row . q''.
    `start` is [q, q'] at t = 0, out of contact; default: rest.
    """

    K: Array
    C: Array
    drive: Array
    contact: Array
    rotation: Array
    stops: Stops
    harmonics: Harmonics
    friction: float = 0.0
    accelerations: Array | None = None
    start: Array | None = None
