"""Assembles the impact beam: free or touching a stop, slipping or stuck at the pivot.

Outputs: upper force, lower force, base acceleration, stations, accelerometers of the cover; with a gauge in
the stinger what of the coil's force stays before it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.model import ImpactBeam
from sim_twin.rigs.impact_beam.structure import Structure, structure_of
from sim_twin.switched.simulation import (
    Constraint,
    Event,
    Output,
    Regime,
    Residual,
    Row,
    SwitchedSystem,
)

Array = NDArray[np.float64]
FREE, UPPER, LOWER = 0, 1, 2
SLIP_UP, SLIP_DOWN, STUCK = 0, 1, 2
_TYPICAL_FORCE = 30.0
"""N; the linear part of a Hertzian contact is its secant here, so that the residual stays small."""


def assemble(rig: ImpactBeam, drive_orders: tuple[int, ...] = (1,)) -> SwitchedSystem:
    """Return the switched system of `rig` with one excitation (N at the drive point) for each order."""
    structure = structure_of(rig)
    pivots = (SLIP_UP, SLIP_DOWN, STUCK) if rig.pivot_friction > 0 else (SLIP_UP,)
    regimes = tuple(
        _regime(rig, structure, contact, pivot, len(drive_orders))
        for pivot in pivots
        for contact in (FREE, UPPER, LOWER)
    )
    return SwitchedSystem(
        states=2 * len(structure.K),
        orders=drive_orders,
        regimes=regimes,
        outputs=3 + len(structure.stations) + len(structure.cover) + rig.stinger_gauge,
        rest_regime=3 * pivots.index(pivots[-1]),
    )


def _regime(rig: ImpactBeam, s: Structure, contact: int, pivot: int, drives: int) -> Regime:
    n = len(s.K)
    K, C, force, residual = _contact_terms(rig, s, contact)
    if rig.pivot_friction > 0 and pivot != STUCK:
        force = force - np.where(pivot == SLIP_UP, 1.0, -1.0) * rig.pivot_friction * s.rotation
    B = np.zeros((2 * n, drives))
    B[n:] = s.drive[:, None]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    c = np.concatenate([np.zeros(n), force])
    if contact == FREE:
        events = tuple(
            Event(_penetration(rig, s, side), 3 * pivot + side, _approach(rig, s, side))
            for side in (UPPER, LOWER)
        )
    else:
        events = (Event(_contact_force(rig, s, contact, -1.0), 3 * pivot + FREE),)
    if rig.pivot_friction > 0:
        events = (*events, *_pivot_events(rig, s, contact, pivot, A, B, c, residual))
    outputs = [] if contact == FREE else [Output(contact - 1, _contact_force(rig, s, contact))]
    measured = {} if s.base is None else {2: s.base}
    measured |= dict(enumerate((*s.stations, *s.cover), start=3))
    for index, row in measured.items():
        outputs.append(Output(index, Row(np.zeros(2 * n), rate=np.concatenate([np.zeros(n), row]))))
    if rig.stinger_gauge:
        held = np.concatenate([rig.shaker_stiffness * s.drive, rig.shaker_damping * s.drive])
        inertia = np.concatenate([np.zeros(n), rig.shaker_mass * s.coil])
        outputs.append(Output(3 + len(s.stations) + len(s.cover), Row(held, rate=inertia)))
    regime = Regime(A, B, c, events, tuple(outputs), residual)
    return regime if pivot != STUCK else _held(regime, s.rotation)


def _contact_terms(
    rig: ImpactBeam, s: Structure, contact: int
) -> tuple[Array, Array, Array, Residual | None]:
    """K, C and constant force of the structure with the stop's spring and damper in, if it touches."""
    n = len(s.K)
    if contact == FREE:
        return s.K, s.C, np.zeros(n), None
    k, c = _linear_stiffness(rig), rig.contact_damping
    pair = np.outer(s.contact, s.contact)
    sign, gap = _side(rig, contact)
    residual = None
    if rig.hertz is not None:
        direction = np.concatenate([np.zeros(n), -sign * s.contact])
        residual = Residual(rig.hertz, k, _penetration(rig, s, contact), direction)
    return s.K + k * pair, s.C + c * pair, sign * k * gap * s.contact, residual


def _linear_stiffness(rig: ImpactBeam) -> float:
    if rig.hertz is None:
        return rig.contact_stiffness
    return float(_TYPICAL_FORCE / (_TYPICAL_FORCE / rig.hertz) ** (2 / 3))


def _side(rig: ImpactBeam, contact: int) -> tuple[float, float]:
    """Direction of the stop and the free way to it, m."""
    if contact == UPPER:
        return 1.0, rig.clearance - rig.rest_offset
    return -1.0, rig.clearance + rig.rest_offset


def _penetration(rig: ImpactBeam, s: Structure, contact: int) -> Row:
    sign, gap = _side(rig, contact)
    return Row(np.concatenate([sign * s.contact, np.zeros(len(s.contact))]), -gap)


def _contact_force(rig: ImpactBeam, s: Structure, contact: int, factor: float = 1.0) -> Row:
    sign, gap = _side(rig, contact)
    k, c = _linear_stiffness(rig), rig.contact_damping
    row = factor * sign * np.concatenate([k * s.contact, c * s.contact])
    return Row(row, -factor * k * gap, residual=factor)


def _approach(rig: ImpactBeam, s: Structure, side: int) -> Row:
    """Positive where the stop would push: the linear law's force, or with Hertz's law the closing speed."""
    if rig.hertz is None:
        return _contact_force(rig, s, side)
    sign, _ = _side(rig, side)
    return Row(np.concatenate([np.zeros(len(s.contact)), sign * s.contact]))


def _pivot_events(
    rig: ImpactBeam,
    s: Structure,
    contact: int,
    pivot: int,
    A: Array,
    B: Array,
    c: Array,
    residual: Residual | None,
) -> tuple[Event, ...]:
    n = len(s.K)
    velocity = np.concatenate([np.zeros(n), s.rotation])
    if pivot != STUCK:
        sign = 1.0 if pivot == SLIP_UP else -1.0
        # Also while slowing down: a slip that has just begun must not end on the rounding of its zero speed.
        slowing = Row(np.zeros(2 * n), rate=-sign * velocity)
        return (Event(Row(-sign * velocity), 3 * STUCK + contact, slowing),)
    inertia = float(s.rotation @ s.rotation)
    torque, drive, constant = velocity @ A / inertia, velocity @ B / inertia, float(velocity @ c) / inertia
    extra = 0.0 if residual is None else float(velocity @ residual.direction) / inertia
    return tuple(
        Event(
            Row(sign * torque, sign * constant - rig.pivot_friction, None, sign * drive, sign * extra),
            3 * target + contact,
        )
        for sign, target in ((1.0, SLIP_UP), (-1.0, SLIP_DOWN))
    )


def _held(regime: Regime, rotation: Array) -> Regime:
    """The same regime with the pivot's rotation held where it is."""
    n = len(rotation)
    unit = rotation / np.linalg.norm(rotation)
    free = np.linalg.svd(unit[None, :])[2][1:].T
    basis = np.block([[free, np.zeros_like(free)], [np.zeros_like(free), free]])
    direction = np.concatenate([rotation / (rotation @ rotation), np.zeros(n)])
    captured = np.concatenate([rotation, np.zeros(n)])
    return Regime(
        basis.T @ regime.A @ basis,
        basis.T @ regime.B,
        basis.T @ regime.c,
        regime.events,
        regime.outputs,
        regime.residual,
        Constraint(basis, captured, direction, basis.T @ regime.A @ direction),
    )
