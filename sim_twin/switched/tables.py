"""Turns a switched system into arrays: every regime in its own complex modes, every step a multiplication.

In its modes a regime's motion is s(t + dt) = exp(lambda dt) s(t), with the excitations as further entries of s
(lambda = i order omega), so a step of any length is exact. Conjugate pairs are kept once, with weight two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.switched.system import Regime, Row, SwitchedSystem

FINE_LEVEL = 14
"""A fine step (one output sample) is 2^14 ticks; a switch is located to one tick (0.3 ns at 204.8 kHz).

A contact then begins at most 0.2 nm late, which is 1e-9 of the energy of a typical impact.
"""
_LANES = 8
_WORST_CONDITION = 1e10

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]


class Tables(NamedTuple):
    """Everything that the kernel reads; complex arrays as pairs of real ones, first axis the regime."""

    fine_level: int
    step_re: Real  # (regime, level, slot); the last level is twice a fine step, for regimes without outputs
    step_im: Real
    push_re: Real  # (regime, level, slot): response of each slot to a unit residual force held over a step
    push_im: Real
    to_state_re: Real  # (regime, state, slot)
    to_state_im: Real
    rest: Real  # (regime, state)
    to_slot_re: Real  # (regime, slot, state)
    to_slot_im: Real
    state_slots: NDArray[np.int64]  # (regime,): slots before the excitations that are in use
    first_drive: int
    event_re: Real  # (regime, 2 event + condition, slot)
    event_im: Real
    event_constant: Real  # (regime, 2 event + condition)
    event_residual: Real  # (regime, 2 event + condition)
    event_target: NDArray[np.int64]  # (regime, event); -1: none
    output_re: Real  # (regime, output, slot)
    output_im: Real
    output_constant: Real  # (regime, output)
    output_residual: Real  # (regime, output)
    outputs_used: NDArray[np.int64]  # (regime, output): row in the trace; -1: none
    residual: Real  # (regime, 3): stiffness, linear, constant of the penetration
    penetration_re: Real  # (regime, 1, slot)
    penetration_im: Real


class _RegimeModes(NamedTuple):
    lam: Complex  # (slot,)
    to_state: Complex  # (state, slot)
    rest: Real  # (state,)
    to_slot: Complex  # (slot, state), excitations left out
    used: int


def build_tables(system: SwitchedSystem, omega: float, fine_step: float) -> Tables:
    """Tabulate `system` for drive frequency `omega` (rad/s) and an output step of `fine_step` (s)."""
    modes = [_own_modes(regime, system, omega) for regime in system.regimes]
    widest = max(each.used for each in modes)
    drives = len(system.excitations)
    slots = -(-(widest + drives) // _LANES) * _LANES
    padded = [_pad(each, widest, drives, slots) for each in modes]
    levels = np.arange(FINE_LEVEL + 2)
    dt = fine_step * 2.0 ** (levels - FINE_LEVEL)
    exponent = np.array([np.outer(dt, each.lam) for each in padded])
    step = np.exp(exponent)
    push = np.array([_push(r, m, dt) for r, m in zip(system.regimes, padded, strict=True)])
    to_state = np.array([each.to_state for each in padded])
    to_slot = np.array([each.to_slot for each in padded])
    return Tables(
        FINE_LEVEL,
        *_parts(step),
        *_parts(push),
        *_parts(to_state),
        np.array([each.rest for each in padded]),
        *_parts(to_slot),
        np.array([each.used for each in padded]),
        widest,
        *_event_tables(system, padded, widest),
        *_output_tables(system, padded, widest),
        *_residual_tables(system, padded, widest),
    )


def _own_modes(regime: Regime, system: SwitchedSystem, omega: float) -> _RegimeModes:
    lam, V = np.linalg.eig(_well_conditioned(regime.A))
    left = np.linalg.inv(V)
    keep = np.flatnonzero(lam.imag >= 0)
    lam, V, left = lam[keep], V[:, keep] * np.where(lam[keep].imag > 0, 2.0, 1.0), left[keep]
    orders = [excitation.order for excitation in system.excitations]
    identity = np.eye(len(regime.A))
    P = np.array(
        [
            np.linalg.solve(1j * k * omega * identity - regime.A, regime.B[:, i])
            for i, k in enumerate(orders)
        ]
    )
    P = P.T.reshape(len(regime.A), len(orders)).astype(complex)
    rest = -np.linalg.solve(regime.A, regime.c)
    drive_lam = np.array([1j * k * omega for k in orders], dtype=complex)
    held = regime.constraint
    if held is None:
        return _RegimeModes(
            np.concatenate([lam, drive_lam]), np.hstack([V, P]), rest, left.astype(complex), len(lam)
        )
    follow = -np.linalg.solve(regime.A, held.coupling)
    return _RegimeModes(
        np.concatenate([lam, [0.0], drive_lam]),
        np.hstack([held.basis @ V, (held.direction + held.basis @ follow)[:, None], held.basis @ P]),
        held.basis @ rest,
        np.vstack([left @ (held.basis.T - np.outer(follow, held.captured)), held.captured]),
        len(lam) + 1,
    )


def _well_conditioned(A: Real) -> Real:
    """Return A, or A with its damping moved by 1e-7 where a critically damped pair makes its modes coincide."""
    _, V = np.linalg.eig(A)
    if np.linalg.cond(V / np.linalg.norm(V, axis=0)) < _WORST_CONDITION * np.linalg.norm(A):
        return A
    n = len(A) // 2
    moved = A.copy()
    moved[n:, n:] *= 1 + 1e-7
    return moved


def _pad(modes: _RegimeModes, widest: int, drives: int, slots: int) -> _RegimeModes:
    where = np.concatenate([np.arange(modes.used), widest + np.arange(drives)]).astype(int)
    lam = np.zeros(slots, dtype=complex)
    lam[where] = modes.lam
    to_state = np.zeros((len(modes.to_state), slots), dtype=complex)
    to_state[:, where] = modes.to_state
    to_slot = np.zeros((slots, modes.to_slot.shape[1]), dtype=complex)
    to_slot[: modes.used] = modes.to_slot
    return _RegimeModes(lam, to_state, modes.rest, to_slot, modes.used)


def _parts(array: Complex) -> tuple[Real, Real]:
    return np.ascontiguousarray(array.real), np.ascontiguousarray(array.imag)


def _row(row: Row, modes: _RegimeModes, first_drive: int) -> tuple[Complex, float]:
    slots = row.position @ modes.to_state
    constant = float(row.position @ modes.rest) + row.constant
    if row.rate is not None:
        slots = slots + row.rate @ (modes.to_state * modes.lam)
    if row.drive is not None:
        slots[first_drive : first_drive + len(row.drive)] += row.drive
    return slots, constant


def _push(regime: Regime, modes: _RegimeModes, dt: Real) -> Complex:
    if regime.residual is None:
        return np.zeros((len(dt), len(modes.lam)), dtype=complex)
    x = np.outer(dt, modes.lam)
    small = np.abs(x) < 1e-6
    growth = np.where(small, 1 + x / 2, np.expm1(x) / np.where(small, 1, x)) * dt[:, None]
    return np.asarray(growth * (modes.to_slot @ regime.residual.direction))


def _residual_gain(row: Row, regime: Regime) -> float:
    if regime.residual is None or row.rate is None:
        return row.residual
    return row.residual + float(row.rate @ regime.residual.direction)


def _event_tables(
    system: SwitchedSystem, modes: list[_RegimeModes], first_drive: int
) -> tuple[Real, Real, Real, Real, NDArray[np.int64]]:
    most = max(2, *(len(regime.events) for regime in system.regimes))
    shape = (len(modes), 2 * most)
    rows = np.zeros((*shape, len(modes[0].lam)), dtype=complex)
    constants, gains = np.full(shape, -1.0), np.zeros(shape)
    target = np.full((len(modes), most), -1)
    for r, regime in enumerate(system.regimes):
        for e, event in enumerate(regime.events):
            target[r, e] = event.target
            for c, row in enumerate((event.condition, event.also)):
                k = 2 * e + c
                if row is None:
                    constants[r, k] = 1.0
                else:
                    rows[r, k], constants[r, k] = _row(row, modes[r], first_drive)
                    gains[r, k] = _residual_gain(row, regime)
    return *_parts(rows), constants, gains, target


def _output_tables(
    system: SwitchedSystem, modes: list[_RegimeModes], first_drive: int
) -> tuple[Real, Real, Real, Real, NDArray[np.int64]]:
    shape = (len(modes), max(1, system.outputs))
    rows = np.zeros((*shape, len(modes[0].lam)), dtype=complex)
    constants, gains = np.zeros(shape), np.zeros(shape)
    used = np.full(shape, -1)
    for r, regime in enumerate(system.regimes):
        for o, output in enumerate(regime.outputs):
            rows[r, o], constants[r, o] = _row(output.row, modes[r], first_drive)
            gains[r, o], used[r, o] = _residual_gain(output.row, regime), output.index
    return *_parts(rows), constants, gains, used


def _residual_tables(
    system: SwitchedSystem, modes: list[_RegimeModes], first_drive: int
) -> tuple[Real, Real, Real]:
    numbers = np.zeros((len(modes), 3))
    rows = np.zeros((len(modes), 1, len(modes[0].lam)), dtype=complex)
    for r, regime in enumerate(system.regimes):
        if regime.residual is not None:
            rows[r, 0], constant = _row(regime.residual.penetration, modes[r], first_drive)
            numbers[r] = regime.residual.stiffness, regime.residual.linear, constant
    return numbers, *_parts(rows)
