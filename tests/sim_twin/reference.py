"""The impact beam written a second time, from the text of the physics: own elements, own integrator.

Hermite elements by Gauss quadrature, contact as a law F(d, d'), DOP853 from scipy with terminal events. It
shares nothing with the twin, so agreement of the two is evidence for both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

Array = NDArray[np.float64]
ELEMENTS = 37


@dataclass(frozen=True)
class Rig:
    """Numbers of the physics text, SI; steel unless changed."""

    E: float = 207e9
    rho: float = 7800.0
    h: float = 0.00635
    clamped: bool = False
    k: float = 1.5e7
    c: float = 20.0
    g: float = 0.127e-3
    offset: float = 0.0
    zeta: float = 0.01
    frequency: float = 20.0
    harmonics: dict[int, float] = field(default_factory=lambda: {1: 1.0})
    moving_mass: float = 0.0
    suspension: tuple[float, float] = (0.0, 0.0)
    pivot_spring: float | None = None
    hertz: float | None = None
    yoke: tuple[float, float, float] | None = None  # Hz, kg, damping ratio
    friction: float = 0.0
    modes: int = 15


ALUMINIUM = Rig(E=70e9, rho=2700.0, h=0.00318, clamped=True, k=9.6e6, c=7.0)
L, WIDTH, DRIVE_AT, AMPLITUDE, FLEXURE = 0.28, 0.019, 0.69, 9.0, 0.16


def shape_functions(x: float, le: float) -> tuple[Array, Array]:
    """Cubic Hermite functions and their second derivatives at x in 0..le."""
    s = x / le
    N = np.array([1 - 3 * s**2 + 2 * s**3, le * s * (1 - s) ** 2, s**2 * (3 - 2 * s), le * s**2 * (s - 1)])
    B = np.array([12 * s - 6, le * (6 * s - 4), 6 - 12 * s, le * (6 * s - 2)]) / le**2
    return N, B


def free_beam(rig: Rig) -> tuple[Array, Array]:
    le, size = L / ELEMENTS, 2 * ELEMENTS + 2
    M, K = np.zeros((size, size)), np.zeros((size, size))
    EI, mu = rig.E * WIDTH * rig.h**3 / 12, rig.rho * WIDTH * rig.h
    nodes, weights = leggauss(4)  # exact to degree 7; the mass needs 6
    for element in range(ELEMENTS):
        dofs = np.ix_(range(2 * element, 2 * element + 4), range(2 * element, 2 * element + 4))
        for node, weight in zip(nodes, weights, strict=True):
            N, B = shape_functions((node + 1) * le / 2, le)
            M[dofs] += mu * np.outer(N, N) * weight * le / 2
            K[dofs] += EI * np.outer(B, B) * weight * le / 2
    return M, K


def row_at(fraction: float) -> Array:
    element = min(int(fraction * ELEMENTS), ELEMENTS - 1)
    le = L / ELEMENTS
    row = np.zeros(2 * ELEMENTS + 2)
    row[2 * element : 2 * element + 4], _ = shape_functions(fraction * L - element * le, le)
    return row


@dataclass(frozen=True)
class Structure:
    """Modes after added masses and springs: q'' + C q' + W q = rows' forces."""

    W: Array
    C: Array
    drive: Array
    tip: Array  # minus the yoke, if there is one
    rotation: Array
    yoke: Array


def structure(rig: Rig) -> Structure:
    M, K = free_beam(rig)
    drive = row_at(DRIVE_AT)
    M += rig.moving_mass * np.outer(drive, drive)
    K += rig.suspension[0] * np.outer(drive, drive)
    kept = np.arange(2, len(M)) if rig.clamped else np.arange(1, len(M))
    if not rig.clamped:
        K[1, 1] += FLEXURE
        if rig.pivot_spring is not None:
            kept = np.arange(len(M))
            K[0, 0] += rig.pivot_spring
    squared, shapes = eigh(K[np.ix_(kept, kept)], M[np.ix_(kept, kept)])
    omega, shapes = np.sqrt(squared[: rig.modes]), shapes[:, : rig.modes]
    full = np.zeros((len(M), rig.modes))
    full[kept] = shapes
    n = rig.modes + (rig.yoke is not None)
    W, C = np.zeros(n), np.zeros((n, n))
    W[: rig.modes] = omega**2
    rows = np.zeros((4, n))
    rows[0, : rig.modes], rows[1, : rig.modes], rows[2, : rig.modes] = (
        drive @ full,
        row_at(1.0) @ full,
        full[1],
    )
    C[: rig.modes, : rig.modes] = np.diag(2 * rig.zeta * omega)
    C += rig.suspension[1] * np.outer(rows[0], rows[0])
    if rig.yoke is not None:
        hertz, mass, ratio = rig.yoke
        W[-1], C[-1, -1] = (2 * np.pi * hertz) ** 2, 4 * np.pi * hertz * ratio
        rows[3, -1] = 1 / np.sqrt(mass)
        rows[1] -= rows[3]
    return Structure(W, C, *rows)


@dataclass
class Motion:
    """Solution in pieces; `onsets` are the times at which a stop was touched."""

    rig: Rig
    parts: Structure
    pieces: list[tuple[float, float, int, Callable[[float], Array]]]

    @property
    def onsets(self) -> Array:
        return np.array([begin for begin, _, side, _ in self.pieces if side])

    def forces(self, times: Array) -> Array:
        """Upper and lower contact force in N and acceleration of the yoke in m/s2, shape (3, n)."""
        out = np.zeros((3, len(times)))
        for begin, end, side, solution in self.pieces:
            for i in np.flatnonzero((times >= begin) & (times < end)):
                x = solution(times[i])
                force = side * push(self.rig, self.parts, x, side) if side else 0.0
                out[0, i], out[1, i] = max(force, 0.0), max(-force, 0.0)
                n = len(x) // 2
                out[2, i] = self.parts.yoke @ acceleration(self.rig, self.parts, x, force, times[i])[:n]
        return out


def gap(rig: Rig, parts: Structure, x: Array, side: int) -> tuple[float, float]:
    n = len(x) // 2
    return side * float(parts.tip @ x[:n]) - rig.g + side * rig.offset, side * float(parts.tip @ x[n:])


def push(rig: Rig, parts: Structure, x: Array, side: int) -> float:
    """Force of a stop by its law, before it is cut at zero."""
    d, rate = gap(rig, parts, x, side)
    spring = rig.k * d if rig.hertz is None else rig.hertz * max(d, 0.0) ** 1.5
    return spring + rig.c * rate


def acceleration(rig: Rig, parts: Structure, x: Array, contact: float, t: float) -> Array:
    n = len(x) // 2
    p = 2 * np.pi * rig.frequency * t
    drive = AMPLITUDE * sum(share * np.sin(order * p) for order, share in rig.harmonics.items())
    return np.asarray(parts.drive * drive - parts.W * x[:n] - parts.C @ x[n:] - contact * parts.tip)


def simulate(rig: Rig, end: float, tolerance: float = 1e-10) -> Motion:
    """From rest at t = 0 to `end`."""
    parts = structure(rig)
    x, t, side = np.zeros(2 * len(parts.W)), 0.0, 0
    pieces: list[tuple[float, float, int, Callable[[float], Array]]] = []

    def rate(t: float, x: Array, side: int) -> Array:
        force = side * push(rig, parts, x, side) if side else 0.0
        return np.concatenate([x[len(x) // 2 :], acceleration(rig, parts, x, force, t)])

    def touches(side: int) -> Callable[[float, Array, int], float]:
        def event(t: float, x: Array, _: int) -> float:
            return min(1e5 * gap(rig, parts, x, side)[0], push(rig, parts, x, side))

        event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
        return event

    def leaves(t: float, x: Array, side: int) -> float:
        return push(rig, parts, x, side)

    leaves.terminal, leaves.direction = True, -1.0  # type: ignore[attr-defined]
    while t < end:
        events = [leaves] if side else [touches(1), touches(-1)]
        part = solve_ivp(
            rate, (t, end), x, "DOP853", dense_output=True, events=events, args=(side,),
            rtol=tolerance, atol=tolerance * 1e-5, max_step=2e-5,
        )  # fmt: skip
        pieces.append((t, float(part.t[-1]), side, part.sol))
        t, x = float(part.t[-1]), part.y[:, -1]
        hit = [index for index, found in enumerate(part.t_events) if len(found)]
        if hit:
            side = 0 if side else (1, -1)[hit[0]]
    return Motion(rig, parts, pieces)


def with_regularised_friction(rig: Rig, end: float, slope: float, times: Array) -> Array:
    """Upper and lower force where the pivot's torque is T clip(theta' / slope, -1, 1), slope in rad/s.

    Implicit (Radau) because the slope is steep; the switches are left to its step control.
    """
    parts = structure(replace(rig, friction=0.0))
    n = len(parts.W)
    linear = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(parts.W), -parts.C]])

    def split(x: Array) -> tuple[float, Array]:
        force, slopes = 0.0, linear.copy()
        for side in (1, -1):
            d, _ = gap(rig, parts, x, side)
            if d > 0 and push(rig, parts, x, side) > 0:
                force += side * push(rig, parts, x, side)
                slopes[n:, :n] -= rig.k * np.outer(parts.tip, parts.tip)
                slopes[n:, n:] -= rig.c * np.outer(parts.tip, parts.tip)
        if abs(parts.rotation @ x[n:]) < slope:
            slopes[n:, n:] -= rig.friction / slope * np.outer(parts.rotation, parts.rotation)
        return force, slopes

    def rate(t: float, x: Array) -> Array:
        torque = rig.friction * np.clip(parts.rotation @ x[n:] / slope, -1, 1)
        return np.concatenate([x[n:], acceleration(rig, parts, x, split(x)[0], t) - torque * parts.rotation])

    solution = solve_ivp(
        rate, (0, end), np.zeros(2 * n), "Radau", jac=lambda t, x: split(x)[1], t_eval=times,
        rtol=1e-7, atol=1e-11, max_step=2e-6,
    )  # fmt: skip
    signed = np.array([split(x)[0] for x in solution.y.T])
    return np.array([np.maximum(signed, 0), np.maximum(-signed, 0)])
