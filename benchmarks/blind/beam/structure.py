"""The beam by Euler-Bernoulli finite elements, reduced to its lowest modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from benchmarks.blind.finite_elements import Array, bending_matrices

__all__ = ["Array"]
ELEMENTS = 60
MODES = 30
FASTEST = 2 * np.pi * 40e3
"""rad/s; higher modes are made heavier until they are as slow as this. What they yield statically stays."""


@dataclass(frozen=True, slots=True)
class Beam:
    """A beam and what hangs on it; SI. At x = 0 it is clamped, or pinned (`pivot_stiffness` None), or sprung.

    `drive_at` is a fraction of the length. Mass and stiffness of the shaker sit there. `detuned`: a factor
    for the frequency of each mode.
    """

    length: float
    width: float
    thickness: float
    modulus: float
    density: float
    clamped: bool = False
    flexure: float = 0.0
    pivot_stiffness: float | None = None
    drive_at: float = 0.69
    shaker_mass: float = 0.0
    shaker_stiffness: float = 0.0
    shaker_damping: float = 0.0
    tip_mass: float = 0.0
    damping: tuple[float, ...] = (0.01,) * MODES
    detuned: tuple[float, ...] = (1.0,) * MODES


@dataclass(frozen=True, slots=True)
class Reduced:
    """M x'' + D x' + K x = loads; x holds tip deflection, drive point's, rotation at the pin, then the rest.

    `pendulum`: x of the lowest mode with a tip deflection of 1 m. The clamped beam has no pin among x.
    """

    M: Array
    D: Array
    K: Array
    pendulum: Array


TIP, DRIVE, PIN = 0, 1, 2


def reduced(beam: Beam) -> Reduced:
    """The beam in its lowest modes, turned so that what is loaded are coordinates."""
    omega, P, ratios = _gathered(beam)
    rest = null_space(P)
    back = np.column_stack([P.T @ np.linalg.inv(P @ P.T), rest])
    D = back.T @ np.diag(2 * ratios * omega) @ back
    D[DRIVE, DRIVE] += beam.shaker_damping
    pendulum = np.concatenate([P[:, 0], rest[0]]) / P[TIP, 0]
    return Reduced(back.T @ back, D, back.T @ np.diag(omega**2) @ back, pendulum)


def _gathered(beam: Beam) -> tuple[Array, Array, Array]:
    """Circular frequencies, watched rows of the shapes, damping ratios.

    Slowed modes all have one frequency, so only as many of their combinations move as rows are watched.
    """
    omega, shapes, watched = _modes(beam)
    P, ratios, slow = watched @ shapes, np.array(beam.damping), omega > FASTEST
    if not slow.any():
        return omega, P, ratios
    heavy = P[:, slow] * FASTEST / omega[slow]
    turn, _ = np.linalg.qr(heavy.T)
    count = turn.shape[1]
    omega = np.append(omega[~slow], np.full(count, FASTEST))
    ratios = np.append(ratios[~slow], np.full(count, ratios[slow].mean()))
    return omega, np.column_stack([P[:, ~slow], heavy @ turn]), ratios


def frequencies(beam: Beam) -> Array:
    """Natural frequencies of the kept modes, Hz."""
    return _modes(beam)[0] / (2 * np.pi)


def _modes(beam: Beam) -> tuple[Array, Array, Array]:
    """Circular frequencies, shapes at the free degrees of freedom, rows that give the watched ones."""
    M, K = _assembled(beam)
    size = len(M)
    drive = _interpolation(beam)
    M += beam.shaker_mass * np.outer(drive, drive)
    K += beam.shaker_stiffness * np.outer(drive, drive)
    M[-2, -2] += beam.tip_mass
    K[1, 1] += beam.flexure
    K[0, 0] += beam.pivot_stiffness or 0.0
    held = (0, 1) if beam.clamped else (0,) if beam.pivot_stiffness is None else ()
    free = [i for i in range(size) if i not in held]
    M, K = M[np.ix_(free, free)], K[np.ix_(free, free)]
    # Turned about, the slow pendulum is the largest value and keeps its digits.
    inverse, shapes = eigh(M, K, subset_by_index=(len(free) - MODES, len(free) - 1))
    omega = 1 / np.sqrt(inverse[::-1])
    watched = np.array([np.eye(size)[-2], drive] + ([] if beam.clamped else [np.eye(size)[1]]))
    # The shapes are of modal mass 1 and stay.
    return omega * beam.detuned, shapes[:, ::-1] * omega, watched[:, free]


def _assembled(beam: Beam) -> tuple[Array, Array]:
    area, moment = beam.width * beam.thickness, beam.width * beam.thickness**3 / 12
    return bending_matrices(beam.length, beam.modulus * moment, beam.density * area, ELEMENTS)


def _interpolation(beam: Beam) -> Array:
    """The row that gives the deflection where the drive is."""
    h = beam.length / ELEMENTS
    element = int(beam.drive_at * ELEMENTS)
    s = beam.drive_at * ELEMENTS - element
    row = np.zeros(2 * ELEMENTS + 2)
    row[2 * element : 2 * element + 4] = (
        1 - 3 * s**2 + 2 * s**3,
        h * (s - 2 * s**2 + s**3),
        3 * s**2 - 2 * s**3,
        h * (s**3 - s**2),
    )
    return row
