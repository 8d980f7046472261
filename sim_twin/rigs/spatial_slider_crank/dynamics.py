"""Equations of motion: slider, universal joint and elastic rod, all inertia terms, compiled.

Newton-Euler about the pin in the rod's frame. The bending modes are orthogonal to each other and to the rod's
rotation, so their accelerations drop out exactly and eight equations remain: pin acceleration (0-2), rod's
angular acceleration (3-5), joint accelerations (6, 7). Gravity enters as an acceleration of the frame.
The rod's own deflection is linear (no foreshortening); its cross-sections spin but do not tilt with bending.
"""

from __future__ import annotations

from sim_twin.compiled import mechanical
from sim_twin.joints.vectors import Vector, added, cross, dot, inward, scaled, subtracted
from sim_twin.rigs.spatial_slider_crank.constants import RIGID, Array, Constants
from sim_twin.rigs.spatial_slider_crank.pose import Pose


@mechanical
def elastic_forces(p: Constants, y: Array, pose: Pose, ball_force: Vector, dy: Array) -> None:
    """Write to `dy` the modal accelerations as they would be with pin and spin unaccelerated.

    `ball_force` in N in the rod's frame.
    """
    m = p.modes
    n = RIGID + 2 * m
    O1, O2, O3 = pose.Omega
    square, cross_term = O1 * O1, O2 * O3
    for k in range(m):
        u, w, u_rate, w_rate = y[RIGID + k], y[RIGID + m + k], y[n + RIGID + k], y[n + RIGID + m + k]
        stiffness, loss = p.omega[k] * p.omega[k], 2.0 * p.damping * p.omega[k]
        dy[n + RIGID + k] = (
            (square + O3 * O3 - stiffness) * u - cross_term * w + 2.0 * O1 * w_rate
            - loss * u_rate + p.tip[k] * ball_force[1]
        )  # fmt: skip
        dy[n + RIGID + m + k] = (
            (square + O2 * O2 - stiffness) * w - cross_term * u - 2.0 * O1 * u_rate
            - loss * w_rate + p.tip[k] * ball_force[2]
        )  # fmt: skip


@mechanical
def set_rod(p: Constants, y: Array, pose: Pose, dy: Array, A: Array) -> None:
    """Set `A` to the rod's mass matrix and, in its last row, minus its inertia forces at no acceleration."""
    m = p.modes
    n = RIGID + 2 * m
    Au = Aw = vu = vw = fu = fw = sway2 = uu = ww = uw = spin = 0.0
    growth = bend_u = bend_w = 0.0
    O1, O2, O3 = pose.Omega
    for k in range(m):
        u, w, u_rate, w_rate = y[RIGID + k], y[RIGID + m + k], y[n + RIGID + k], y[n + RIGID + m + k]
        f, g, a = dy[n + RIGID + k], dy[n + RIGID + m + k], p.sway[k]
        Au, Aw, vu, vw = Au + a * u, Aw + a * w, vu + a * u_rate, vw + a * w_rate
        fu, fw, sway2 = fu + a * f, fw + a * g, sway2 + a * a
        uu, ww, uw = uu + u * u, ww + w * w, uw + u * w
        spin += u * g - w * f
        along = u * O2 + w * O3
        growth += u * u_rate + w * w_rate
        bend_u, bend_w = bend_u + u_rate * along, bend_w + w_rate * along
    first = 0.5 * p.rod_mass * p.rod_length
    # The lower triangle only.
    for i in range(8):
        for j in range(i + 1):
            A[i, j] = 0.0
    A[0, 0] = p.rod_mass
    A[1, 1] = A[2, 2] = p.rod_mass - sway2
    A[3, 3] = p.rod_spin
    A[4, 4], A[5, 5], A[5, 4] = p.rod_swing + ww, p.rod_swing + uu, -uw
    A[4, 0], A[5, 0] = Aw, -Au
    A[4, 2], A[5, 1] = first, -first
    D = (-first, Au, Aw)
    force = added(cross(pose.Omega, cross(pose.Omega, D)), scaled(2.0, cross(pose.Omega, (0.0, vu, vw))))
    H = (
        (uu + ww + p.rod_spin) * O1,
        (p.rod_swing + ww) * O2 - uw * O3,
        (p.rod_swing + uu) * O3 - uw * O2,
    )
    moment = added(cross(pose.Omega, H), (2.0 * growth * O1 + spin, 2.0 * (growth * O2 - bend_u), 0.0))
    A[8, 0], A[8, 1], A[8, 2] = -force[0], -force[1] - fu, -force[2] - fw
    A[8, 3], A[8, 4], A[8, 5] = -moment[0], -moment[1], -moment[2] - 2.0 * (growth * O3 - bend_w)
    A[8, 6], A[8, 7] = 0.0, 0.0


@mechanical
def add_slider(p: Constants, pose: Pose, A: Array) -> None:
    """Add the slider's part to the matrix and to the last row of `A`."""
    m, C = p.slider_mass, pose.joint
    omega = subtracted(pose.Omega, pose.relative)
    arm = inward(C, (p.pin[0], p.pin[1], p.pin[2]))
    I11, I22, I33 = _turned(p.inertia, C, 0, 0), _turned(p.inertia, C, 1, 1), _turned(p.inertia, C, 2, 2)
    I21, I31, I32 = _turned(p.inertia, C, 1, 0), _turned(p.inertia, C, 2, 0), _turned(p.inertia, C, 2, 1)
    I0 = (I11, I21, I31), (I21, I22, I32), (I31, I32, I33)
    x, y, z = arm
    about = (
        (I11 + m * (y * y + z * z), I21 - m * x * y, I31 - m * x * z),
        (I21 - m * x * y, I22 + m * (x * x + z * z), I32 - m * y * z),
        (I31 - m * x * z, I32 - m * y * z, I33 + m * (x * x + y * y)),
    )
    _add_slider_matrix(m, arm, about, pose.axis, A)
    # Accelerations of the slider while those of pin, rod and joint are zero: the joint's own axes turn.
    about_y = scaled(dot(pose.axis, pose.relative), cross(omega, pose.axis))
    turn = added(about_y, scaled(pose.relative[2], cross(pose.Omega, (0.0, 0.0, 1.0))))
    force = scaled(-m, added(cross(arm, turn), cross(omega, cross(omega, arm))))
    H = (dot(I0[0], omega), dot(I0[1], omega), dot(I0[2], omega))
    moment = subtracted(cross(omega, H), (dot(I0[0], turn), dot(I0[1], turn), dot(I0[2], turn)))
    add_slider_load(pose, scaled(-1.0, force), subtracted(cross(arm, force), moment), A)


@mechanical
def add_slider_load(pose: Pose, force: Vector, moment: Vector, A: Array) -> None:
    """Add a force on the slider (N) and its moment about the pin (N m), rod's frame, to the last row."""
    for i in range(3):
        A[8, i] += force[i]
        A[8, 3 + i] += moment[i]
    A[8, 6] -= dot(pose.axis, moment)
    A[8, 7] -= moment[2]


@mechanical
def add_rod_load(force: Vector, at: Vector, A: Array) -> None:
    """Add a force on the rod (N) that acts `at` from the pin (m), rod's frame, to the last row."""
    moment = cross(at, force)
    for i in range(3):
        A[8, i] += force[i]
        A[8, 3 + i] += moment[i]


@mechanical
def _turned(inertia: Array, C: tuple[Vector, Vector, Vector], i: int, j: int) -> float:
    """Entry i, j of the slider's inertia in the rod's frame."""
    total = inertia[0] * C[0][i] * C[0][j] + inertia[1] * C[1][i] * C[1][j]
    return float(total + inertia[2] * C[2][i] * C[2][j])


@mechanical
def _add_slider_matrix(
    m: float, arm: Vector, about: tuple[Vector, Vector, Vector], axis: Vector, A: Array
) -> None:
    x, y, z = arm
    A[0, 0] += m
    A[1, 1] += m
    A[2, 2] += m
    A[4, 0] -= m * z
    A[5, 0] += m * y
    A[3, 1] += m * z
    A[5, 1] -= m * x
    A[3, 2] -= m * y
    A[4, 2] += m * x
    for i in range(3):
        for j in range(i + 1):
            A[3 + i, 3 + j] += about[i][j]
    # The joint's axes turn the slider the other way.
    across, last = (dot(about[0], axis), dot(about[1], axis), dot(about[2], axis)), about[2]
    A[6, 0], A[6, 1], A[6, 2] = m * z * axis[1], -m * z * axis[0], m * (y * axis[0] - x * axis[1])
    A[7, 0], A[7, 1] = -m * y, m * x
    for i in range(3):
        A[6, 3 + i], A[7, 3 + i] = -across[i], -last[i]
    A[6, 6], A[7, 6], A[7, 7] = dot(axis, across), across[2], about[2][2]


@mechanical
def solve(A: Array) -> None:
    """Solve the eight equations by L D L^T; the accelerations replace the last row of `A`.

    Below the diagonal stays L D, above it comes L, on it the inverse of D.
    """
    for j in range(3):  # nothing couples the pin's three accelerations
        A[j, j] = 1.0 / A[j, j]
        for i in range(3, 8):
            A[j, i] = A[i, j] * A[j, j]
    for j in range(3, 8):
        for i in range(j, 9):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[k, j]
            A[i, j] = total
        A[j, j] = 1.0 / A[j, j]
        for i in range(j + 1, 8):
            A[j, i] = A[i, j] * A[j, j]
    for j in range(7, -1, -1):
        total = A[8, j] * A[j, j]
        for k in range(max(j + 1, 3), 8):
            total -= A[j, k] * A[8, k]
        A[8, j] = total
