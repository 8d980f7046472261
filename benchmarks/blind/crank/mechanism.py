"""The mechanism in Exudyn: a crank too heavy to be slowed, rod, piston, contacts of spheres in hollow ones.

Nothing in Python runs while it moves. A rod that bends is a kinematic tree: a part of the rod's mass slides
across its middle on spring and damper. With the sliding mass 8 m3/pi^2 and its travel pi q/4 this is the mode
sin(pi s/L) with modal mass m3/2, coupled by 2 m3/pi. A guide with friction is a pair of spheres so large that
they are flat, so stiff that they ring above the channels' band.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.blind.crank.parts import Array, Parts
from benchmarks.blind.crank.rig import JOURNAL_RADIUS, Crank, Mode

APPROACH_FLOOR, FRICTION_RAMP = 0.01, 1e-3  # m/s
_HEAVY = 1e12  # kg and kg m2
_GUIDE_RADIUS, _GUIDE_STIFFNESS, _GUIDE_DAMPING_RATIO = 1e5, 2e10, 0.05


@dataclass(frozen=True, slots=True)
class Motion:
    """At every step: forces on both journals in N, shape (n, 2), and the crank's angle in rad, shape (n,)."""

    pin: Array
    piston: Array
    angle: Array


@dataclass(frozen=True, slots=True)
class Start:
    """Ideal joints: crank's angle, speed; rod's x, y, angle; piston's way from mid stroke; velocities."""

    angle: float
    speed: float
    rod: tuple[float, float, float]
    rod_velocity: tuple[float, float, float]
    piston: float
    piston_velocity: float


def moved(crank: Crank, angle: float, step: float, count: int) -> Motion:
    """Return the motion from ideal joints at the crank's `angle` in rad, in `count` steps of `step` s."""
    parts, start = Parts(), started(crank, angle)
    wheel, turning = _wheel(parts, crank, start)
    rod = (
        _rod(parts, crank, start)
        if crank.bending is None
        else _bending_rod(parts, crank, start, crank.bending)
    )
    piston = _piston(parts, crank, start)
    journals = parts.point(wheel, crank.crank_length), parts.point(piston, 0.0)
    watched = [_joint(parts, crank, which, journals[which], rod) for which in (0, 1)]
    angles = parts.watch_coordinates(turning)
    parts.solve(step, count)
    pin, slider = (sum((parts.stored(s)[:, :2] for s in joint), start=np.zeros(2)) for joint in watched)
    motion = Motion(pin, slider, parts.stored(angles)[:, 2])
    parts.forget()
    return motion


def started(crank: Crank, angle: float) -> Start:
    """Return where ideal joints have the parts, and how they move, with the crank at `angle` in rad."""
    r, L, ripple = crank.crank_length, crank.rod_length, crank.ripple
    speed = crank.speed * (1 + ripple.amplitude * np.sin(ripple.order * angle + ripple.phase))
    sine, cosine = np.sin(angle), np.cos(angle)
    lean = np.arcsin((crank.guide_offset - r * sine) / L)
    turn = -r * cosine * speed / (L * np.cos(lean))
    up, along = np.sin(lean), np.cos(lean)
    return Start(
        angle,
        speed,
        (r * cosine + L / 2 * along, r * sine + L / 2 * up, lean),
        (-r * speed * sine - L / 2 * turn * up, r * speed * cosine + L / 2 * turn * along, turn),
        r * cosine + L * along - L,
        -r * speed * sine - L * turn * up,
    )


def _wheel(parts: Parts, crank: Crank, start: Start) -> tuple[int, int]:
    wheel, node = parts.body([0.0] * 3, [0.0, 0.0, start.angle], [0.0, 0.0, start.speed], _HEAVY, _HEAVY)
    ripple = crank.ripple
    if ripple.amplitude:
        symbolic = parts.exu.symbolic

        # The torque under which the speed follows its law; Exudyn wants just these arguments.
        def torque(mbs: Any, t: Any, item: Any, angle: Any, rate: Any, k: Any, d: Any, offset: Any) -> Any:
            at = ripple.order * angle + ripple.phase
            return -k * symbolic.cos(at) * (1 + ripple.amplitude * symbolic.sin(at))

        parts.law(
            parts.spring(node, 2, _HEAVY * ripple.amplitude * ripple.order * crank.speed**2, 0.0), torque
        )
    return wheel, node


def _rod(parts: Parts, crank: Crank, start: Start) -> Any:
    rod, _ = parts.body(start.rod, [0.0] * 3, start.rod_velocity, crank.rod_mass, crank.rod_inertia)
    parts.weight(rod, crank.gravity)
    return lambda x: parts.point(rod, x)


def _bending_rod(parts: Parts, crank: Crank, start: Start, mode: Mode) -> Any:
    exu, item = parts.exu, parts.item
    omega, sliding = 2 * np.pi * mode.frequency, 8 / np.pi**2 * crank.rod_mass
    kind, none = exu.JointType, np.zeros((3, 3))
    node = parts.mbs.AddNode(
        item.NodeGenericODE2(
            numberOfODE2Coordinates=4,
            referenceCoordinates=[0.0] * 4,
            initialCoordinates=[*start.rod, 0.0],
            initialCoordinates_t=[*start.rod_velocity, 0.0],
        )
    )
    rod = parts.mbs.AddObject(
        item.ObjectKinematicTree(
            nodeNumber=node,
            gravity=[0.0, -crank.gravity, 0.0],
            jointTypes=[kind.PrismaticX, kind.PrismaticY, kind.RevoluteZ, kind.PrismaticY],
            linkParents=[-1, 0, 1, 2],
            jointTransformations=exu.Matrix3DList([np.eye(3)] * 4),
            jointOffsets=exu.Vector3DList([[0.0] * 3] * 4),
            linkInertiasCOM=exu.Matrix3DList([none, none, crank.rod_inertia * np.eye(3), none]),
            linkCOMs=exu.Vector3DList([[0.0] * 3] * 4),
            linkMasses=[0.0, 0.0, crank.rod_mass - sliding, sliding],
            jointPControlVector=[0.0, 0.0, 0.0, sliding * omega**2],
            jointDControlVector=[0.0, 0.0, 0.0, 2 * mode.damping_ratio * omega * sliding],
            jointPositionOffsetVector=[0.0] * 4,
            jointVelocityOffsetVector=[0.0] * 4,
        )
    )

    def point(x: float) -> int:
        return int(
            parts.mbs.AddMarker(
                item.MarkerKinematicTreeRigid(objectNumber=rod, linkNumber=2, localPosition=[x, 0.0, 0.0])
            )
        )

    return point


def _piston(parts: Parts, crank: Crank, start: Start) -> int:
    place = (crank.rod_length, crank.guide_offset)
    if crank.guide_friction:
        moved, velocity = [start.piston, 0.0, 0.0], [start.piston_velocity, 0.0, 0.0]
        piston, node = parts.body([*place, 0.0], moved, velocity, crank.piston_mass, _HEAVY)
        parts.weight(piston, crank.gravity)
        _guide(parts, crank, piston, node)
    else:
        piston, node = parts.slider(place, start.piston, start.piston_velocity, crank.piston_mass)
    if crank.air_spring or crank.drag:
        parts.spring(node, 0, crank.air_spring, crank.drag)
    return piston


def _guide(parts: Parts, crank: Crank, piston: int, node: int) -> None:
    for side in (1, -1):
        parts.contact(
            parts.point(piston, 0.0),
            parts.point(parts.ground, crank.rod_length, crank.guide_offset + side * _GUIDE_RADIUS),
            (JOURNAL_RADIUS, _GUIDE_RADIUS - JOURNAL_RADIUS),
            contactStiffness=_GUIDE_STIFFNESS,
            dynamicFriction=crank.guide_friction,
            frictionProportionalZone=FRICTION_RAMP,
        )
    damping = 2 * _GUIDE_DAMPING_RATIO * np.sqrt(_GUIDE_STIFFNESS * crank.piston_mass)
    parts.spring(node, 1, 0.0, damping)


def _joint(parts: Parts, crank: Crank, which: int, journal: int, rod: Any) -> list[int]:
    """Return the sensors whose forces add up to the joint's."""
    end, oval = (-1, 1)[which] * crank.rod_length / 2, crank.ovality[which]
    frictions = _frictions(crank)
    connectors = [
        parts.contact(
            journal,
            rod(end + shift),
            (JOURNAL_RADIUS, JOURNAL_RADIUS + crank.clearances[which]),
            isHollowSphere1=True,
            dynamicFriction=friction,
            frictionProportionalZone=ramp,
            contactStiffness=crank.joint_stiffness(which) / len(frictions),
            contactStiffnessExponent=crank.exponent,
            # Exudyn's factor 3 (1 - e)/2 (Hunt and Crossley) is made the rig's 3 (1 - e^2)/4.
            restitutionCoefficient=1 - (1 - crank.restitution**2) / 2,
            minimumImpactVelocity=APPROACH_FLOOR,
            impactModel=1,
        )
        for shift in ((-oval, oval) if oval else (0.0,))
        for friction, ramp in frictions
    ]
    if crank.film:
        connectors.append(parts.damper(journal, rod(end), crank.film))
    return [parts.watch_force(connector) for connector in connectors]


def _frictions(crank: Crank) -> list[tuple[float, float]]:
    """Coefficients and the speeds (m/s) at which they are whole, of as many contacts that share the force."""
    more, fading = crank.stribeck
    if not more:
        return [(crank.friction, FRICTION_RAMP)]
    return [(2 * crank.friction * (1 + more), FRICTION_RAMP), (-2 * crank.friction * more, fading)]
