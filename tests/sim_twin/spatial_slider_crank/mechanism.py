"""The mechanism written anew from its geometry alone, as a cloud of mass points.

It shares parameters with the twin and the meaning of its coordinates q = pin, Gibbs vector, alpha, beta,
bending in both planes; nothing else. Masses and forces come from differences of the points' places.
"""

from __future__ import annotations

from math import pi

import numpy as np
from scipy.spatial.transform import Rotation

from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank

PINNED_FREE = (3.92660231, 7.06858275, 10.21017612)
FIRST = 1e-6
SECOND = 1e-4
"""Steps of first and second differences, in units of the coordinates."""


class Mechanism:
    """Places of all mass points, shape (points, 3), over the coordinates."""

    def __init__(self, rig: SpatialSliderCrank) -> None:
        self.rig, self.modes = rig, rig.bending_modes
        self.n = 8 + 2 * self.modes
        x, w = np.polynomial.legendre.leggauss(24)
        rod = rig.rod
        self.s, self.dm = rod.length * (1 + x) / 2, rod.mass * w / 2
        self.shapes = np.array([self.shape(k, self.s) for k in range(self.modes)]).reshape(self.modes, 24)
        self.tips = np.array([self.shape(k, np.array([rod.length]))[0] for k in range(self.modes)])
        bending = np.sqrt(rod.E * pi / 64 * rod.diameter**4 / (rod.mass / rod.length))
        self.omega = np.array(PINNED_FREE[: self.modes]) ** 2 / rod.length**2 * bending
        # A round section has the inertia of four points at d / sqrt(8); a body that of six on its axes.
        ring = rod.diameter / np.sqrt(8)
        self.section = ring * np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
        a, b, c = rig.slider.inertia
        arms = np.sqrt(1.5 / rig.slider.mass * np.array([b + c - a, a + c - b, a + b - c]))
        self.slider = np.vstack([np.diag(arms), -np.diag(arms)]) - np.array(rig.slider.pin)
        self.masses = np.concatenate([np.repeat(self.dm / 4, 4), np.full(6, rig.slider.mass / 6)])

    def shape(self, k: int, s: np.ndarray) -> np.ndarray:
        b, L = PINNED_FREE[k], self.rig.rod.length
        return (np.sin(b * s / L) / np.sin(b) + np.sinh(b * s / L) / np.sinh(b)) / np.sqrt(self.rig.rod.mass)

    def turns(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations of slider and rod."""
        slider = Rotation.from_quat([*q[3:6], 1.0]).as_matrix()
        return slider, slider @ Rotation.from_euler("YZ", q[6:8]).as_matrix()

    def points(self, q: np.ndarray) -> np.ndarray:
        slider, rod = self.turns(q)
        u, w = q[8 : 8 + self.modes] @ self.shapes, q[8 + self.modes :] @ self.shapes
        centres = np.stack([-self.s, u, w], axis=1)
        cloud = (centres[:, None, :] + self.section).reshape(-1, 3)
        return q[:3] + np.concatenate([cloud @ rod.T, self.slider @ slider.T])

    def touching_points(self, q: np.ndarray) -> np.ndarray:
        """The eight points of the shell and the ball, shape (9, 3)."""
        slider, rod = self.turns(q)
        shell = self.rig.guide.points() - np.array(self.rig.slider.pin)
        bent = [q[8 : 8 + self.modes] @ self.tips, q[8 + self.modes :] @ self.tips]
        return q[:3] + np.vstack([shell @ slider.T, rod @ [-self.rig.rod.length, *bent]])

    def crank_pin(self, theta: float) -> np.ndarray:
        a, r = self.rig.axis_angle, self.rig.crank_radius
        turned = r * np.array([np.sin(a) * np.cos(theta), -np.cos(a) * np.cos(theta), np.sin(theta)])
        return turned + np.array([0.0, *self.rig.slider.pin[1:]])

    def depths(self, q: np.ndarray, theta: float) -> np.ndarray:
        """Overlap of the eight points and in the socket, shape (9,)."""
        p, h = self.touching_points(q), self.rig.guide.half_side
        sides = [p[0, 1], -p[1, 1], p[2, 2], -p[3, 2], p[4, 1], -p[5, 1], p[6, 2], -p[7, 2]]
        gap = np.linalg.norm(p[8] - self.crank_pin(theta)) - self.rig.socket_clearance
        return np.array([*(h - np.array(sides)), gap])

    def velocity(self, places, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Rate of `places(q)` along `qd`."""
        return (places(q + FIRST * qd) - places(q - FIRST * qd)) / (2 * FIRST)

    def jacobian(self, places, q: np.ndarray) -> np.ndarray:
        """Partial velocities, shape (points, 3, n)."""
        return np.stack([self.velocity(places, q, unit) for unit in np.eye(self.n)], axis=-1)

    def accelerations(self, q: np.ndarray, qd: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """q'' under `forces` (9, 3) at the touching points, by the principle of virtual power."""
        J = self.jacobian(self.points, q)
        M = np.einsum("p,pxi,pxj->ij", self.masses, J, J)
        h = SECOND / np.linalg.norm(qd)
        bias = (self.points(q + h * qd) - 2 * self.points(q) + self.points(q - h * qd)) / h**2
        push = np.einsum("pxi,px->i", self.jacobian(self.touching_points, q), forces)
        Q = push + np.einsum("p,pxi,px->i", self.masses, J, self.gravity() - bias)
        stiffness = np.tile(self.omega, 2)
        Q[8:] -= stiffness**2 * q[8:] + 2 * self.rig.modal_damping * stiffness * qd[8:]
        return np.linalg.solve(M, Q)

    def gravity(self) -> np.ndarray:
        across, roll = np.cos(self.rig.incline), self.rig.roll
        along = np.sin(self.rig.incline)
        return self.rig.gravity * np.array([along, -across * np.sin(roll), -across * np.cos(roll)])

    def energy(self, q: np.ndarray, qd: np.ndarray, theta: float) -> float:
        """Kinetic, elastic and of gravity, contacts included, J."""
        v = self.velocity(self.points, q, qd)
        kinetic = 0.5 * np.sum(self.masses[:, None] * v**2)
        weight = -np.sum(self.masses[:, None] * self.points(q) * self.gravity())
        bending = 0.5 * np.sum(np.tile(self.omega, 2) ** 2 * q[8:] ** 2)
        stiffness = np.array([self.rig.guide_stiffness] * 8 + [self.rig.socket_stiffness])
        return float(kinetic + weight + bending + 0.5 * stiffness @ np.maximum(self.depths(q, theta), 0) ** 2)

    def state(self, q: np.ndarray, qd: np.ndarray, theta: float) -> np.ndarray:
        """The twin's state vector of this motion; angular velocities from differences of the rotations."""
        h = FIRST
        rod = [self.turns(q + t * qd)[1] for t in (-h, h)]
        skew = self.turns(q)[1].T @ (rod[1] - rod[0]) / (2 * h)
        Omega = np.array([skew[2, 1] - skew[1, 2], skew[0, 2] - skew[2, 0], skew[1, 0] - skew[0, 1]]) / 2
        return np.concatenate([q, qd[:3], Omega, qd[6:], [theta, 0.0, 0.0]])

    def rates_of(self, y: np.ndarray) -> np.ndarray:
        """q' of a state vector of the twin."""
        n, q = self.n, y[: self.n]
        qd = np.concatenate([y[n : n + 3], np.zeros(3), y[n + 6 : 2 * n]])

        # What the Gibbs vector's rate must be for the rod's angular velocity to come out: linear in it.
        def rod_spin(rate: np.ndarray) -> np.ndarray:
            return self.state(q, np.concatenate([qd[:3], rate, qd[6:]]), 0.0)[n + 3 : n + 6]

        at_rest = rod_spin(np.zeros(3))
        columns = np.stack([rod_spin(unit) - at_rest for unit in np.eye(3)], axis=-1)
        qd[3:6] = np.linalg.solve(columns, y[n + 3 : n + 6] - at_rest)
        return qd
