"""The planar slider-crank in the source's own form: absolute coordinates and constraints.

Slow and plain, to check the fast one by: seed 001 eq. 1-14 with scipy's DOP853, restarted wherever a contact
begins or ends, and Baumgarte's stabilisation. Rigid rod, frictionless guide, constant speed. Coordinates q:
x, y (m) and angle (rad) of crank, rod and piston.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, hypot, sin

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_twin.rigs.planar_slider_crank.model import PlanarSliderCrank

Array = NDArray[np.float64]
CRANK, ROD, PISTON = 0, 3, 6
_SAMPLES_A_CONTACT = 400


@dataclass(frozen=True, slots=True)
class Impact:
    """A contact that has ended: joint (0 crank pin, 1 piston pin), onset and end s, approach m/s, peak N."""

    joint: int
    onset: float
    end: float
    approach: float
    peak: float


@dataclass(frozen=True, slots=True)
class ConstrainedCrank:
    """The mechanism at crank speed `omega` rad/s; `alpha` and `beta` (1/s) are Baumgarte's coefficients."""

    rig: PlanarSliderCrank
    omega: float
    alpha: float = 50.0
    beta: float = 50.0

    @property
    def masses(self) -> Array:
        """Diagonal of M, shape (9,): kg, kg, kg m2 for each body (the piston's inertia does not matter)."""
        rig = self.rig
        crank, rod, piston = rig.crank_mass, rig.rod_mass, rig.piston_mass
        return np.array([crank, crank, rig.crank_inertia, rod, rod, rig.rod_inertia, piston, piston, 1.0])

    def start(self) -> Array:
        """Crank along x, joints centred, velocities of ideal joints; q and its rates, shape (18,)."""
        rig, omega = self.rig, self.omega
        r, L = rig.crank_length, rig.rod_length
        spin = -omega * r / L
        at = rig.crank_centre * r
        q = [at, 0.0, 0.0, r + rig.rod_centre * L, 0.0, 0.0, r + L, 0.0, 0.0]
        v = [0.0, at * omega, omega, 0.0, r * omega + rig.rod_centre * L * spin, spin, 0.0, 0.0, 0.0]
        return np.array(q + v)

    def constraints(self, t: float, q: Array) -> Array:
        """Phi, shape (5,): crank bearing x and y, motor, guide y, piston's angle."""
        s = self.rig.crank_centre * self.rig.crank_length
        theta = q[CRANK + 2]
        return np.array(
            [q[0] - s * cos(theta), q[1] - s * sin(theta), theta - self.omega * t, q[PISTON + 1], q[8]]
        )

    def jacobian(self, q: Array) -> Array:
        """Phi_q, shape (5, 9)."""
        s = self.rig.crank_centre * self.rig.crank_length
        rows = np.zeros((5, 9))
        rows[0, 0], rows[0, 2] = 1.0, s * sin(q[2])
        rows[1, 1], rows[1, 2] = 1.0, -s * cos(q[2])
        rows[2, 2] = rows[3, PISTON + 1] = rows[4, PISTON + 2] = 1.0
        return rows

    def accelerations(self, t: float, z: Array, v0: Array) -> Array:
        """q'' of eq. 14, shape (9,); `v0` (2,) are the latched approach speeds, 0 where a joint is open."""
        q, v = z[:9], z[9:]
        s = self.rig.crank_centre * self.rig.crank_length
        gamma = np.zeros(5)
        gamma[0], gamma[1] = -s * cos(q[2]) * v[2] ** 2, -s * sin(q[2]) * v[2] ** 2
        rows = self.jacobian(q)
        motor = np.array([0.0, 0.0, self.omega, 0.0, 0.0])
        drift = 2 * self.alpha * (rows @ v - motor) + self.beta**2 * self.constraints(t, q)
        system = np.zeros((14, 14))
        system[:9, :9] = np.diag(self.masses)
        system[:9, 9:], system[9:, :9] = rows.T, rows
        right = np.concatenate([self.forces(z, v0), gamma - drift])
        return np.asarray(np.linalg.solve(system, right)[:9])

    def forces(self, z: Array, v0: Array) -> Array:
        """f, shape (9,): weights and what the journals do to the bearings (eq. 7, 8, 12)."""
        f = np.zeros(9)
        f[[CRANK + 1, ROD + 1, PISTON + 1]] = -self.rig.gravity * self.masses[[0, ROD, PISTON]]
        for joint in (0, 1):
            if v0[joint] > 0:
                self._add_contact(f, z, joint, float(v0[joint]))
        return f

    def _add_contact(self, f: Array, z: Array, joint: int, v0: float) -> None:
        e, _, normal_speed = self._gap(z, joint)
        d = hypot(*e) - self._clearance(joint)
        if d <= 0:
            return
        n = e / hypot(*e)
        normal = self.normal_force(joint, d, normal_speed, v0)
        journal, _, at_bearing = self._ends(z, joint)
        point = self._centre(z, ROD, at_bearing) + (self.rig.journal_radius + self._clearance(joint)) * n
        slip = self._velocity(z, journal, point) - self._velocity(z, ROD, point)
        t = np.array([-n[1], n[0]])
        force = normal * n + self._friction(float(slip @ t)) * normal * t
        for body, sign in ((ROD, 1.0), (journal, -1.0)):
            arm = point - z[body : body + 2]
            f[body : body + 2] += sign * force
            f[body + 2] += sign * (arm[0] * force[1] - arm[1] * force[0])

    def normal_force(self, joint: int, d: float, rate: float, v0: float) -> float:
        """Eq. 8 and 11, never negative; penetration `d` m, its `rate` m/s, approach `v0` m/s."""
        K = self.rig.contact_stiffnesses[joint]
        return float(max(0.0, K * d**1.5 * (1 + 0.75 * (1 - self.rig.restitution**2) * rate / v0)))

    def _friction(self, slip: float) -> float:
        """Eq. 12-13: share of the normal force that drags the bearing along with the journal."""
        ramp = (abs(slip) - self.rig.friction_v_0) / (self.rig.friction_v_1 - self.rig.friction_v_0)
        return float(self.rig.friction * np.clip(ramp, 0.0, 1.0) * np.sign(slip))

    def penetration(self, z: Array, joint: int) -> float:
        """Penetration in m, negative where the joint is open (eq. 1)."""
        return hypot(*self._gap(z, joint)[0]) - self._clearance(joint)

    def _clearance(self, joint: int) -> float:
        return self.rig.clearance_1 if joint == 0 else self.rig.clearance_2

    def _gap(self, z: Array, joint: int) -> tuple[Array, Array, float]:
        """Eccentricity, its rate, and the rate's part along it (eq. 2-6)."""
        journal, at_journal, at_bearing = self._ends(z, joint)
        centre, bearing = self._centre(z, journal, at_journal), self._centre(z, ROD, at_bearing)
        e = centre - bearing
        rate = self._velocity(z, journal, centre) - self._velocity(z, ROD, bearing)
        return e, rate, float(e @ rate) / (hypot(*e) or 1.0)

    def _ends(self, z: Array, joint: int) -> tuple[int, float, float]:
        """The journal's body, and where along their bodies journal and bearing sit, from the centres, m."""
        rig = self.rig
        if joint == 0:
            return CRANK, (1 - rig.crank_centre) * rig.crank_length, -rig.rod_centre * rig.rod_length
        return PISTON, 0.0, (1 - rig.rod_centre) * rig.rod_length

    @staticmethod
    def _centre(z: Array, body: int, along: float) -> Array:
        x, y, angle = z[body : body + 3]
        return np.array([x + along * cos(angle), y + along * sin(angle)])

    @staticmethod
    def _velocity(z: Array, body: int, point: Array) -> Array:
        arm = point - z[body : body + 2]
        vx, vy, spin = z[9 + body : 12 + body]
        return np.array([vx - spin * arm[1], vy + spin * arm[0]])

    def approach(self, z: Array, joint: int) -> float:
        """Speed in m/s at which the journal nears the bearing's wall."""
        return self._gap(z, joint)[2]


def first_impacts(
    crank: ConstrainedCrank, count: int, tolerance: float = 1e-9, end: float = 1.0
) -> list[Impact]:
    """The first `count` contacts that have ended, in the order of their ends; at most `end` s are run."""
    z, t, v0 = crank.start(), 0.0, np.zeros(2)
    begun: dict[int, tuple[float, float]] = {}
    peaks = np.zeros(2)
    impacts: list[Impact] = []
    while len(impacts) < count and t < end:
        events = [_wall(crank, joint, opening=v0[joint] > 0) for joint in (0, 1)]
        part = solve_ivp(
            lambda t, z: np.concatenate([z[9:], crank.accelerations(t, z, v0)]), (t, end), z, "DOP853",
            events=events, rtol=tolerance, atol=tolerance * 1e-3, max_step=1e-3, dense_output=True,
        )  # fmt: skip
        _follow_peaks(crank, part, v0, peaks)
        t, z = float(part.t[-1]), part.y[:, -1]
        found = part.t_events or []
        for joint in (0, 1):
            if not len(found[joint]):
                continue
            if v0[joint] > 0:
                impacts.append(Impact(joint, begun[joint][0], t, begun[joint][1], float(peaks[joint])))
                v0[joint] = 0.0
            else:
                begun[joint], peaks[joint] = (t, crank.approach(z, joint)), 0.0
                v0[joint] = max(begun[joint][1], crank.rig.approach_floor)
    return impacts


def _wall(crank: ConstrainedCrank, joint: int, opening: bool) -> Callable[[float, Array], float]:
    def event(_: float, z: Array) -> float:
        return crank.penetration(z, joint)

    event.terminal, event.direction = True, -1.0 if opening else 1.0  # type: ignore[attr-defined]
    return event


def _follow_peaks(crank: ConstrainedCrank, part: object, v0: Array, peaks: Array) -> None:
    """Raise `peaks` by the forces within one piece of the solution."""
    times, sol = part.t, part.sol  # type: ignore[attr-defined]
    for t in np.linspace(times[0], times[-1], _SAMPLES_A_CONTACT) if v0.any() else ():
        for joint in (k for k in (0, 1) if v0[k] > 0):
            z = sol(t)
            d, rate = crank.penetration(z, joint), crank.approach(z, joint)
            peaks[joint] = max(peaks[joint], crank.normal_force(joint, max(d, 0.0), rate, float(v0[joint])))
