"""Turns a lane into the numbers that the kernel multiplies by: its complex modes over one step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.lanes import kernel
from sim_twin.lanes.lane import Lane
from sim_twin.switched.modes import complex_modes

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_LEAST_PART = 1e-12


class Coefficients(NamedTuple):
    """One lane of the kernel's arrays."""

    slot: Array  # (slots, 6), with friction (slots, 10)
    row: Array  # (rows, slots, 2)
    row_gain: Array  # (rows, 2)
    number: Array  # (NUMBERS,)
    start: Array  # (slots, 2)
    scalar: Array  # (SCALARS,)


class _Slots(NamedTuple):
    """The motion in slots s' = `rate` s + `by_force` F + `by_torque` T; scalars are Re(row s)."""

    rate: Complex  # (slots,)
    gap: Complex
    spin: Complex  # the pivot's rotation rate
    acceleration: Complex  # (rows, slots)
    by_force: Complex
    by_torque: Complex
    start: Complex


def coefficients(lane: Lane, step: float) -> Coefficients:
    """Return the numbers of `lane` for steps of `step` s."""
    slots, rest = _slots(lane)
    if len(slots.rate) % 2:
        slots = _with_an_idle_slot(slots)
    seen = _part_of_gap(slots.gap)
    half, held = np.exp(slots.rate * step / 2), _held(slots.rate, step)
    start = _pairs(seen * slots.start)
    columns = [np.exp(slots.rate * step), seen * half * held * slots.by_force, slots.rate.conj()]
    if lane.friction > 0:
        columns += [seen * half * held * slots.by_torque, (slots.spin * half / seen).conj()]
    slot = np.hstack([_pairs(column) for column in columns])
    rate = slot[:, [kernel.RATE_RE, kernel.RATE_IM]]
    scalar = np.zeros(kernel.SCALARS)
    scalar[kernel.GAP], scalar[kernel.RATE] = start[:, 0].sum(), np.sum(rate * start)
    if lane.friction > 0:
        scalar[kernel.SPIN] = np.sum(slot[:, [kernel.SPIN_RE, kernel.SPIN_IM]] * start)
    row = _pairs((slots.acceleration / seen).conj())
    return Coefficients(
        slot, row, _row_gains(lane, slots, step), _numbers(lane, slots, rest, step), start, scalar
    )


def _slots(lane: Lane) -> tuple[_Slots, float]:
    """The slots, modes first, and the gap (m) about which they move."""
    n = len(lane.K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-lane.K, -lane.C]])
    modes = complex_modes(A)
    amplitudes, p = lane.harmonics.amplitudes, lane.harmonics.phase
    orders = [k for k in range(1, len(amplitudes)) if amplitudes[k]]
    rates = 1j * lane.harmonics.omega * np.array(orders, dtype=complex)
    push = np.concatenate([np.zeros(n), lane.drive])
    answers = np.array([np.linalg.solve(rate * np.eye(2 * n) - A, push) for rate in rates], dtype=complex)
    answers = answers.reshape(-1, 2 * n).T
    driven = np.array([amplitudes[k] * np.exp(1j * k * p) for k in orders], dtype=complex)
    rest = np.linalg.solve(lane.K, lane.drive * amplitudes[0].real) if amplitudes[0] else np.zeros(n)
    begin = np.zeros(2 * n) if lane.start is None else lane.start
    free = modes.left @ (begin - (answers @ driven).real - np.concatenate([rest, np.zeros(n)]))
    shapes, rate = np.hstack([modes.shapes, answers]), np.concatenate([modes.rates, rates])
    still = np.zeros(len(orders))
    rows = np.zeros((0, n)) if lane.accelerations is None else lane.accelerations
    slots = _Slots(
        rate,
        lane.contact @ shapes[:n],
        lane.rotation @ shapes[n:],
        rows @ (shapes[n:] * rate),
        np.concatenate([modes.left[:, n:] @ -lane.contact, still]),
        np.concatenate([modes.left[:, n:] @ -lane.rotation, still]),
        np.concatenate([free, driven]),
    )
    return slots, float(lane.contact @ rest)


def _with_an_idle_slot(slots: _Slots) -> _Slots:
    return _Slots(*(np.concatenate([each, np.zeros((*each.shape[:-1], 1))], axis=-1) for each in slots))


def _part_of_gap(gap: Complex) -> Complex:
    # The kernel sums real parts to the gap, so what is not seen there needs some part of it all the same.
    least = _LEAST_PART * np.abs(gap).max()
    return np.where(np.abs(gap) > least, gap, least)


def _held(rate: Complex, span: float) -> Complex:
    """Integral of exp(rate t) over `span`."""
    x = rate * span
    small = np.abs(x) < 1e-6
    return np.asarray(np.where(small, 1 + x / 2, np.expm1(x) / np.where(small, 1, x)) * span)


def _pairs(values: Complex) -> Array:
    return np.stack([values.real, values.imag], axis=-1)


def _numbers(lane: Lane, slots: _Slots, rest: float, step: float) -> Array:
    stops, number = lane.stops, np.zeros(kernel.NUMBERS)
    middle, whole = _held(slots.rate, step / 2), _held(slots.rate, step)
    give = -float(np.sum(slots.gap * slots.by_force * middle).real)
    give_rate = -float(np.sum(slots.gap * slots.rate * slots.by_force * middle).real)
    hertzian = stops.hertz is not None
    number[kernel.CENTRE], number[kernel.CLEARANCE] = rest + stops.offset, stops.clearance
    number[kernel.STIFFNESS] = stops.stiffness if stops.hertz is None else stops.hertz
    number[kernel.DAMPING], number[kernel.HALF_STEP] = stops.damping, step / 2
    number[kernel.SHARE] = 1 / (1 + stops.damping * give_rate + (0 if hertzian else stops.stiffness * give))
    number[kernel.GIVE], number[kernel.GIVE_RATE] = give, give_rate
    after = slots.gap * slots.by_force * np.exp(slots.rate * step / 2) * whole
    number[kernel.GAP_AFTER_FORCE] = np.sum(after).real
    number[kernel.RATE_AFTER_FORCE] = np.sum(after * slots.rate).real
    if lane.friction > 0:
        number[kernel.TORQUE] = lane.friction
        number[kernel.SPIN_STIFFNESS] = -1 / float(np.sum(slots.spin * slots.by_torque * whole).real)
        number[kernel.SPIN_BY_FORCE] = -float(np.sum(slots.spin * slots.by_force * whole).real)
        number[kernel.GAP_BY_TORQUE] = -float(np.sum(slots.gap * slots.by_torque * middle).real)
        number[kernel.RATE_BY_TORQUE] = -float(np.sum(slots.gap * slots.rate * slots.by_torque * middle).real)
    return number


def _row_gains(lane: Lane, slots: _Slots, step: float) -> Array:
    if lane.accelerations is None:
        return np.zeros((0, 2))
    by = np.stack([slots.by_force, slots.by_torque]) * _held(slots.rate, step / 2)
    direct = np.stack([lane.contact, lane.rotation]) @ lane.accelerations.T
    return np.asarray((slots.acceleration @ by.T).real - direct.T)
