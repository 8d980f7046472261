"""The connecting rod: round, of finite elements, pinned where the universal joint is and free at the ball."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from benchmarks.blind.finite_elements import Array, bending_matrices

ELEMENTS = 80
"""The third bending mode comes out 2e-7 too high; at twice as many the first one loses digits."""


@dataclass(frozen=True, slots=True)
class Rod:
    """SI. `damping`: one ratio for each bending mode, first across the one way, then across the other.

    `detuned`: a factor for the frequency of each of them.
    """

    modulus: float = 207e9
    density: float = 7800.0
    diameter: float = 6.4e-3
    length: float = 0.19
    damping: tuple[float, ...] = (0.01,) * 6
    detuned: tuple[float, ...] = (1.0,) * 6

    @property
    def mass(self) -> float:
        """In kg."""
        return self.density * pi / 4 * self.diameter**2 * self.length


class Bending(NamedTuple):
    """Lowest bending modes of one plane, of modal mass 1 kg; arrays of shape (modes,).

    `omega` in rad/s; `tip`: deflection at the ball; `sway`: integral of the shape over the mass; `swing`: of
    the shape times the distance from the middle, positive towards the slider.
    """

    omega: Array
    tip: Array
    sway: Array
    swing: Array


def bending(rod: Rod) -> Bending:
    """As many modes as the rod has damping ratios in a plane."""
    modes = len(rod.damping) // 2
    M, K = bending_matrices(
        rod.length, rod.modulus * pi / 64 * rod.diameter**4, rod.mass / rod.length, ELEMENTS
    )
    # nodes from the ball to the pin, where the rod does not deflect
    free = np.delete(np.arange(len(M)), -2)
    values, shapes = eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], subset_by_index=(0, modes))
    # the ball deflects upwards in all of them
    kept = shapes[:, 1:] * np.sign(shapes[0, 1:])
    along = np.linspace(-rod.length / 2, rod.length / 2, ELEMENTS + 1)
    whole, slanted = np.zeros((2, len(M)))
    whole[::2] = 1.0
    slanted[::2], slanted[1::2] = along, 1.0
    return Bending(np.sqrt(values[1:]), kept[0], (whole @ M)[free] @ kept, (slanted @ M)[free] @ kept)
