"""The rigid mechanism in absolute coordinates: two free bodies, the joint by Lagrange multipliers, DOP853.

State of both bodies, slider first: place, quaternion (w, x, y, z), velocity, angular velocity in its frame.
Written from the equations of rigid bodies (Haug, Computer-Aided Kinematics and Dynamics, 1989, 11.2).
"""

from __future__ import annotations

from math import cos, sin

import numpy as np
from scipy.integrate import solve_ivp

from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank

NORMALS = np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]] * 2, dtype=float)
Y, Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def skew(a: np.ndarray) -> np.ndarray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rotation(e: np.ndarray) -> np.ndarray:
    e = e / np.linalg.norm(e)
    S = skew(e[1:])
    return np.eye(3) + 2 * e[0] * S + 2 * S @ S


class RigidMechanism:
    def __init__(self, rig: SpatialSliderCrank, speed: float) -> None:
        self.rig, self.speed = rig, speed
        rod, slider = rig.rod, rig.slider
        across = rod.mass * (rod.length**2 / 12 + rod.diameter**2 / 16)
        self.inertias = np.array(slider.inertia), np.array([rod.mass * rod.diameter**2 / 8, across, across])
        self.masses = slider.mass, rod.mass
        self.pins = np.array(slider.pin), np.array([rod.length / 2, 0.0, 0.0])
        self.tip = np.array([-rod.length / 2, 0.0, 0.0])
        across = cos(rig.incline)
        self.gravity = rig.gravity * np.array(
            [sin(rig.incline), -across * sin(rig.roll), -across * cos(rig.roll)]
        )

    def crank(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        a, r, theta = self.rig.axis_angle, self.rig.crank_radius, self.speed * t
        e = np.array([sin(a), -cos(a), 0.0])
        centre = np.array([0.0, *self.rig.slider.pin[1:]])
        return centre + r * (cos(theta) * e + sin(theta) * Z), r * self.speed * (
            cos(theta) * Z - sin(theta) * e
        )

    def start(self) -> np.ndarray:
        """Ideal joints at crank angle 0: the rod stands across the motion of its crank end."""
        pin, v = self.crank(0.0)
        rig = self.rig
        along = np.sqrt(rig.rod.length**2 - (pin[1] - rig.slider.pin[1]) ** 2)
        joint = np.array([pin[0] + along, *rig.slider.pin[1:]])
        x = (joint - pin) / rig.rod.length
        y = np.cross(Z, x) / np.linalg.norm(np.cross(Z, x))
        R = np.column_stack([x, y, np.cross(x, y)])
        turn = np.arctan2(R[1, 0], R[0, 0]) / 2
        spin = np.cross(pin - joint, v) / rig.rod.length**2
        rod = [*(joint + pin) / 2, cos(turn), 0.0, 0.0, sin(turn), *v / 2, *(R.T @ spin)]
        return np.array([*(joint - self.pins[0]), 1.0, *np.zeros(9), *rod])

    def touching(self, t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, list]:
        """Depths and their rates, and (body, arm, normal, velocity) of the nine possible contacts."""
        rig, (s, r) = self.rig, (y[:13], y[13:])
        Rs, Rr = rotation(s[3:7]), rotation(r[3:7])
        where, depth, rate = [], [], []
        for point, normal in zip(rig.guide.points(), NORMALS, strict=True):
            arm = Rs @ point
            v = s[7:10] + np.cross(Rs @ s[10:13], arm)
            depth.append(rig.guide_half_side - normal @ (s[:3] + arm))
            rate.append(-normal @ v)
            where.append((0, arm, normal, v))
        pin, pin_velocity = self.crank(t)
        arm = Rr @ self.tip
        v = r[7:10] + np.cross(Rr @ r[10:13], arm)
        offset = r[:3] + arm - pin
        gap = max(float(np.linalg.norm(offset)), 1e-15)
        where.append((1, arm, -offset / gap, v))
        depth.append(gap - rig.socket_clearance)
        rate.append(offset @ (v - pin_velocity) / gap)
        return np.array(depth), np.array(rate), where

    def forces(self, t: float, y: np.ndarray, touches: np.ndarray) -> np.ndarray:
        depth, rate, _ = self.touching(t, y)
        k = np.array([self.rig.guide_stiffness] * 8 + [self.rig.socket_stiffness])
        c = np.array([self.rig.guide_damping] * 8 + [self.rig.socket_damping])
        return np.where(touches, np.maximum(k * depth + c * rate, 0.0), 0.0)

    def rates(self, t: float, y: np.ndarray, touches: np.ndarray) -> np.ndarray:
        loads = np.zeros((2, 6))
        _, _, where = self.touching(t, y)
        for F, (body, arm, normal, v) in zip(self.forces(t, y, touches), where, strict=True):
            if F > 0:
                push = F * normal
                if body == 0:
                    slip = v - (v @ normal) * normal
                    speed = np.linalg.norm(slip)
                    v_0, v_1 = self.rig.friction_ramp
                    push = (
                        push
                        - self.rig.friction * np.clip((speed - v_0) / (v_1 - v_0), 0, 1) * F * slip / speed
                    )
                loads[body] += [*push, *np.cross(arm, push)]
        return self.accelerate(y, loads)

    def accelerate(self, y: np.ndarray, loads: np.ndarray) -> np.ndarray:
        bodies = y[:13], y[13:]
        R = [rotation(b[3:7]) for b in bodies]
        W = [turn @ b[10:13] for turn, b in zip(R, bodies, strict=True)]
        A, rhs = np.zeros((16, 16)), np.zeros(16)
        arms = [turn @ pin for turn, pin in zip(R, self.pins, strict=True)]
        ys, zr = R[0] @ Y, R[1] @ Z
        across = np.cross(ys, zr)
        for i, sign in ((0, 1.0), (1, -1.0)):
            at, inertia = 6 * i, R[i] @ np.diag(self.inertias[i]) @ R[i].T
            A[at : at + 3, at : at + 3] = self.masses[i] * np.eye(3)
            A[at + 3 : at + 6, at + 3 : at + 6] = inertia
            rhs[at : at + 3] = loads[i, :3] + self.masses[i] * self.gravity
            rhs[at + 3 : at + 6] = loads[i, 3:] - np.cross(W[i], inertia @ W[i])
            J = np.zeros((4, 6))
            J[:3, :3], J[:3, 3:], J[3, 3:] = sign * np.eye(3), -sign * skew(arms[i]), sign * across
            A[12:, at : at + 6], A[at : at + 6, 12:] = J, J.T
            rhs[12:15] -= sign * np.cross(W[i], np.cross(W[i], arms[i]))
        rhs[15] = -(W[0] - W[1]) @ (np.cross(np.cross(W[0], ys), zr) + np.cross(ys, np.cross(W[1], zr)))
        solved = np.linalg.solve(A, rhs)
        dy = np.zeros(26)
        for i, b in enumerate(bodies):
            w, e = b[10:13], b[3:7]
            turning = 0.5 * np.array([-e[1:] @ w, *(e[0] * w + np.cross(e[1:], w))])
            spin = R[i].T @ solved[6 * i + 3 : 6 * i + 6]
            dy[13 * i : 13 * i + 13] = [*b[7:10], *turning, *solved[6 * i : 6 * i + 3], *spin]
        return dy

    def impacts(self, count: int, until: float) -> list[tuple[float, int, float]]:
        """(onset s, contact, peak N) of the first `count` contacts that end, in the order of their ends."""
        t, y, touches = 0.0, self.start(), np.zeros(9, dtype=bool)
        onsets, peaks, found = np.zeros(9), np.zeros(9), []
        while len(found) < count and t < until:
            events = [self._event(j, touches) for j in range(9)]
            leg = solve_ivp(
                self.rates,
                (t, until),
                y,
                "DOP853",
                args=(touches,),
                events=events,
                rtol=1e-9,
                atol=1e-12,
                dense_output=True,
                max_step=1e-4,
            )
            for j in np.flatnonzero(touches):
                fine = np.linspace(t, leg.t[-1], 400)
                peaks[j] = max(peaks[j], *(self.forces(x, leg.sol(x), touches)[j] for x in fine))
            t, y = leg.t[-1], leg.y[:, -1]
            for j in (j for j in range(9) if len(leg.t_events[j])):
                if touches[j]:
                    found.append((onsets[j], j, peaks[j]))
                onsets[j], peaks[j], touches[j] = t, 0.0, not touches[j]
        return found

    def _event(self, j: int, touches: np.ndarray):
        def depth(t: float, y: np.ndarray, _: np.ndarray) -> float:
            return self.touching(t, y)[0][j]

        depth.terminal, depth.direction = True, -1.0 if touches[j] else 1.0
        return depth
