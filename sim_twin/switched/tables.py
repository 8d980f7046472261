"""Turns a switched system into arrays: every regime in its own complex modes, every step a multiplication.

In its modes a regime's motion is s(t + dt) = exp(lambda dt) s(t), with the excitations as further entries of
s (lambda = i order omega), so a step of any length is exact. Conjugate pairs are kept once, with weight two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.switched.simulation import Regime, Row, SwitchedSystem
from sim_twin.vector import LANES, aligned

_WORST_CONDITION = 1e10
DIGIT = 7
FINE_LEVEL = 2 * DIGIT
"""A fine step (one output sample) is 2^14 ticks; a switch is located to one tick (0.3 ns at 204.8 kHz).

A contact then begins at most 0.2 nm late, which is 1e-9 of the energy of a typical impact.
"""
_LONGEST_LEVEL = 6
_PADDING = 16
Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
Index = NDArray[np.int64]


class ComplexModes(NamedTuple):
    """x = Re(`shapes` s), s' = `rates` s, s = `left` x; of a conjugate pair one is kept, with weight two."""

    rates: NDArray[np.complex128]  # (mode,)
    shapes: NDArray[np.complex128]  # (state, mode)
    left: NDArray[np.complex128]  # (mode, state)


def complex_modes(A: NDArray[np.float64]) -> ComplexModes:
    """Modes of A, shape (2 n, 2 n), which has the form [[0, 1], [-K, -C]] or is a projection of it."""
    rates, V = np.linalg.eig(A)
    if np.linalg.cond(V) > _WORST_CONDITION * np.linalg.norm(A):
        # a critically damped pair makes its modes coincide: its damping is moved by 1e-7
        moved, n = A.copy(), len(A) // 2
        moved[n:, n:] *= 1 + 1e-7
        rates, V = np.linalg.eig(moved)
    left = np.linalg.inv(V)
    keep = np.flatnonzero(rates.imag >= 0)
    weight = np.where(rates[keep].imag > 0, 2.0, 1.0)
    return ComplexModes(
        rates[keep].astype(complex), (V[:, keep] * weight).astype(complex), left[keep].astype(complex)
    )


class Tables(NamedTuple):
    """Everything that the kernel reads, in few arrays of few axes, because numba pays for every further one.

    The motion is an array of slots, shape (2, slot): real and imaginary parts of modes and excitations. A row
    of the same shape gives a scalar by its product with the slots. Step k = 0 ... 2^7 is k ticks long, step
    `digits` + k is k 2^7 ticks (the last of them the fine step), and the rest are 2, 4, 8 ... fine steps.
    """

    bits: int
    digits: int
    ticks: Index  # (step,)
    step: Real  # (regime step plane, slot): re, im of the factor; with residual forces 8 planes:
    # the step, half the step, the response of the slots to a unit force held over the one and over the other
    to_state: Real  # (regime state, 2, slot)
    rest: Real  # (regime, state)
    to_slot: Real  # (regime re/im slot, state)
    first_drive: int
    change: (
        Real  # (regime event re/im old slot, 2, new slot): the slots in the regime that the event leads to
    )
    offset: Real  # (regime event, 2, new slot)
    event: Real  # (regime row, 2, slot): two conditions for each event, then the residual force's penetration
    event_numbers: Real  # (regime row, 2): constant, share of the residual force
    event_target: Index  # (regime, event); -1: none
    event_speed: Real  # (regime, slot): greatest change of the first event's condition in a fine step
    opposite: (
        Real  # (regime, 3): 1 where the second event's condition is a + b times the first's (or there is
    )
    # one event only) and neither has a residual force in it, else 0; a; b
    ahead: Real  # (regime, re/im slot, 8): the first condition's row one to eight fine steps ahead, in lanes
    output: Real  # (regime output, 2, slot)
    output_numbers: Real  # (regime output, 2): constant, share of the residual force
    outputs_used: Index  # (regime, output): row in the trace; -1: none
    mirrored: Index  # (regime,): row in the trace that is minus the only event's condition; -1: none
    recorded: Index  # (regime,): how many outputs there are, the mirrored one included
    residual: Real  # (regime, 2): stiffness, linear


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
    drives = len(system.orders)
    slots = -(-(widest + drives) // _PADDING) * _PADDING
    padded = [_pad(each, widest, drives, slots) for each in modes]
    short, fine = np.arange((1 << DIGIT) + 1), 1 << FINE_LEVEL
    ticks = np.concatenate([short, short << DIGIT, fine << np.arange(1, _LONGEST_LEVEL + 1)])
    dt = np.asarray(fine_step * 0.5**FINE_LEVEL * ticks, dtype=np.float64)
    steps = []
    for regime, each in zip(system.regimes, padded, strict=True):
        factors = [np.exp(np.outer(span, each.lam)) for span in (dt, dt / 2)]
        direction = np.zeros(each.to_slot.shape[1]) if regime.residual is None else regime.residual.direction
        factors += [held(each.lam, span[:, None]) * (each.to_slot @ direction) for span in (dt, dt / 2)]
        steps.append(np.stack([part for factor in factors for part in (factor.real, factor.imag)], axis=1))
    planes = np.array(steps)
    laws = [regime.residual for regime in system.regimes]
    if not any(laws):
        planes = planes[:, :, :2]
    rows, event_numbers, target = _event_tables(system, padded, widest)
    output, output_numbers, used, mirrored, recorded = _output_tables(system, padded, widest)
    lam = np.array([each.lam for each in padded])
    turns = np.exp(fine_step * np.arange(1, LANES + 1)[:, None] * lam[:, None, :])
    ahead = aligned((len(lam), 2 * slots, LANES))
    ahead[:] = np.swapaxes(_rows(rows[:, 0][:, None] * turns).reshape(len(lam), LANES, -1), 1, 2)
    return Tables(
        DIGIT,
        (1 << DIGIT) + 1,
        ticks,
        planes.reshape(-1, slots),
        _rows(np.array([each.to_state for each in padded])),
        np.array([each.rest for each in padded]),
        np.concatenate([part for each in padded for part in (each.to_slot.real, each.to_slot.imag)]),
        widest,
        *_changes(target, padded, widest),
        _rows(rows),
        event_numbers.reshape(-1, 2),
        target,
        fine_step * np.abs(rows[:, 0] * lam),
        np.array([_opposite(*each) for each in zip(system.regimes, rows, event_numbers, strict=True)]),
        ahead,
        output,
        output_numbers,
        used,
        mirrored,
        recorded,
        np.array([(law.stiffness, law.linear) if law else (0.0, 0.0) for law in laws]),
    )


def _opposite(regime: Regime, rows: Complex, numbers: Real) -> tuple[float, float, float]:
    if regime.residual is None and len(regime.events) == 1:
        return 1.0, -1.0, 0.0
    mirror = len(regime.events) == 2 and np.allclose(rows[2], -rows[0], rtol=1e-12, atol=0)
    if regime.residual is None and mirror:
        return 1.0, numbers[0, 0] + numbers[2, 0], -1.0
    return 0.0, -1.0, 0.0


def _own_modes(regime: Regime, system: SwitchedSystem, omega: float) -> _RegimeModes:
    lam, V, left = complex_modes(regime.A)
    orders = system.orders
    identity = np.eye(len(regime.A))
    P = np.array(
        [np.linalg.solve(1j * k * omega * identity - regime.A, regime.B[:, i]) for i, k in enumerate(orders)]
    )
    P = P.T.reshape(len(regime.A), len(orders)).astype(complex)
    rest = np.asarray(-np.linalg.solve(regime.A, regime.c), dtype=np.float64)
    drive_lam = np.array([1j * k * omega for k in orders], dtype=complex)
    held = regime.constraint
    if held is None:
        return _RegimeModes(np.concatenate([lam, drive_lam]), np.hstack([V, P]), rest, left, len(lam))
    follow = -np.linalg.solve(regime.A, held.coupling)
    return _RegimeModes(
        np.concatenate([lam, [0.0], drive_lam]),
        np.hstack([held.basis @ V, (held.direction + held.basis @ follow)[:, None], held.basis @ P]),
        held.basis @ rest,
        np.vstack([left @ (held.basis.T - np.outer(follow, held.captured)), held.captured]),
        len(lam) + 1,
    )


def _pad(modes: _RegimeModes, widest: int, drives: int, slots: int) -> _RegimeModes:
    where = np.concatenate([np.arange(modes.used), widest + np.arange(drives)]).astype(int)
    lam = np.zeros(slots, dtype=complex)
    lam[where] = modes.lam
    to_state = np.zeros((len(modes.to_state), slots), dtype=complex)
    to_state[:, where] = modes.to_state
    to_slot = np.zeros((slots, modes.to_slot.shape[1]), dtype=complex)
    to_slot[: modes.used] = modes.to_slot
    return _RegimeModes(lam, to_state, modes.rest, to_slot, modes.used)


def _rows(complex_rows: Complex) -> Real:
    both = np.stack([complex_rows.real, -complex_rows.imag], axis=-2)
    return np.ascontiguousarray(both.reshape(-1, 2, both.shape[-1]))


def _changes(target: Index, modes: list[_RegimeModes], first_drive: int) -> tuple[Real, Real]:
    """From the slots of one regime straight to those of the next: x = rest + Re(to_state s) in between."""
    half = len(modes[0].lam)
    change, shift = np.zeros((*target.shape, 2 * half, 2 * half)), np.zeros((*target.shape, 2 * half))
    drive = np.arange(first_drive, half)
    drive = np.concatenate([drive, half + drive])
    for r, e in zip(*np.nonzero(target >= 0), strict=True):
        old, new = modes[r], modes[target[r, e]]
        to_state, its_own = (_rows(each.to_state).reshape(-1, 2 * half) for each in (old, new))
        to_state[:, drive] -= its_own[:, drive]
        to_slot = np.concatenate([new.to_slot.real, new.to_slot.imag])
        onward = to_slot @ to_state
        onward[drive, drive] = 1.0
        change[r, e] = onward.T
        shift[r, e] = to_slot @ (old.rest - new.rest)
    return change.reshape(-1, 2, half), shift.reshape(-1, 2, half)


def _row(row: Row, modes: _RegimeModes, first_drive: int) -> tuple[Complex, float]:
    slots = row.position @ modes.to_state
    constant = float(row.position @ modes.rest) + row.constant
    if row.rate is not None:
        slots = slots + row.rate @ (modes.to_state * modes.lam)
    if row.drive is not None:
        slots[first_drive : first_drive + len(row.drive)] += row.drive
    return slots, constant


def held(rate: Complex, span: float | Real) -> Complex:
    """Integral of exp(rate t) over `span`."""
    x = rate * span
    small = np.abs(x) < 1e-6
    return np.asarray(np.where(small, 1 + x / 2, np.expm1(x) / np.where(small, 1, x)) * span)


def _residual_gain(row: Row, regime: Regime) -> float:
    if regime.residual is None or row.rate is None:
        return row.residual
    return row.residual + float(row.rate @ regime.residual.direction)


def _event_tables(
    system: SwitchedSystem, modes: list[_RegimeModes], first_drive: int
) -> tuple[Complex, Real, Index]:
    most = max(2, *(len(regime.events) for regime in system.regimes))
    rows = np.zeros((len(modes), 2 * most + 1, len(modes[0].lam)), dtype=complex)
    numbers = np.zeros((*rows.shape[:2], 2))
    numbers[:, :, 0] = -1.0
    target = np.full((len(modes), most), -1)
    for r, regime in enumerate(system.regimes):
        for e, event in enumerate(regime.events):
            target[r, e] = event.target
            for k, row in enumerate((event.condition, event.also), 2 * e):
                if row is None:
                    numbers[r, k] = 1.0, 0.0
                else:
                    rows[r, k], constant = _row(row, modes[r], first_drive)
                    numbers[r, k] = constant, _residual_gain(row, regime)
        if regime.residual is not None:
            rows[r, -1], numbers[r, -1, 0] = _row(regime.residual.penetration, modes[r], first_drive)
    return rows, numbers, target


def _output_tables(
    system: SwitchedSystem, modes: list[_RegimeModes], first_drive: int
) -> tuple[Real, Real, Index, Index, Index]:
    shape = (len(modes), max(1, system.outputs))
    rows = np.zeros((*shape, len(modes[0].lam)), dtype=complex)
    numbers = np.zeros((*shape, 2))
    used, mirrored = np.full(shape, -1), np.full(len(modes), -1)
    for r, regime in enumerate(system.regimes):
        others = [output for output in regime.outputs if not _mirrors(regime, output.row)]
        mirrored[r] = next((o.index for o in regime.outputs if _mirrors(regime, o.row)), -1)
        for o, output in enumerate(others):
            rows[r, o], constant = _row(output.row, modes[r], first_drive)
            numbers[r, o] = constant, _residual_gain(output.row, regime)
            used[r, o] = output.index
    recorded = np.array([len(regime.outputs) for regime in system.regimes])
    return _rows(rows), numbers.reshape(-1, 2), used, mirrored, recorded


def _mirrors(regime: Regime, row: Row) -> bool:
    """Whether an output is minus the condition of the only event, which the kernel knows anyway."""
    if regime.residual is not None or len(regime.events) != 1:
        return False
    first = regime.events[0].condition
    plain = all(each.rate is None and each.drive is None for each in (first, row))
    return plain and first.constant == -row.constant and np.array_equal(first.position, -row.position)
