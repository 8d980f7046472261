"""Many lanes in motion together: what each simulates, in the words of mechanics, and the kernel's numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_twin.lanes import kernel
from sim_twin.status import Status
from sim_twin.switched.tables import complex_modes, held
from sim_twin.vector import LANES, aligned

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
_LEAST_PART = 1e-12
_AT_ONCE = 16 * 1024
"""Bytes of coefficients and motion that are stepped together; they have to stay in the first cache."""
_FAR = 1.0
"""m; no gap opens so far."""


@dataclass(frozen=True, slots=True)
class Stops:
    """Two stops that w meets at +-`clearance` - `offset` (m); their force only pushes.

    F = `stiffness` d + `damping` d' at depth d > 0 (N/m, N s/m); with `hertz` (N/m^1.5) `hertz` d^1.5 instead
    of `stiffness` d.
    """

    stiffness: float
    damping: float
    clearance: float
    offset: float = 0.0
    hertz: float | None = None


@dataclass(frozen=True, slots=True)
class Harmonics:
    """A force sum of Re(U_k exp(i k p)), p = `omega` t + `phase`; `amplitudes` U_0, U_1, ... in N."""

    amplitudes: NDArray[np.complex128]
    omega: float
    phase: float = 0.0


@dataclass(frozen=True, slots=True)
class Lane:
    """q'' + C q' + K q = drive u - contact F - rotation T, with K, C of shape (n, n).

    Rows of shape (n,): `drive`; `contact`, which gives w = contact . q; `rotation` of the pivot, where the
    Coulomb torque T of at most `friction` N m acts. `accelerations` (rows, n) are recorded: row . q''.
    `start` is [q, q'] at t = 0, out of contact; default: rest.
    """

    K: Array
    C: Array
    drive: Array
    contact: Array
    rotation: Array
    stops: Stops
    harmonics: Harmonics
    friction: float = 0.0
    accelerations: Array | None = None
    start: Array | None = None


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
        idle = (np.concatenate([each, np.zeros((*each.shape[:-1], 1))], axis=-1) for each in slots)
        slots = _Slots(*idle)
    # The kernel sums real parts to the gap, so what is not seen there needs some part of it all the same.
    least = _LEAST_PART * np.abs(slots.gap).max()
    seen = np.where(np.abs(slots.gap) > least, slots.gap, least)
    half, whole = np.exp(slots.rate * step / 2), held(slots.rate, step)
    start = _pairs(seen * slots.start)
    columns = [np.exp(slots.rate * step), seen * half * whole * slots.by_force, slots.rate.conj()]
    if lane.friction > 0:
        columns += [seen * half * whole * slots.by_torque, (slots.spin * half / seen).conj()]
    slot = np.hstack([_pairs(column) for column in columns])
    rate = slot[:, [kernel.RATE_RE, kernel.RATE_IM]]
    scalar = np.zeros(kernel.SCALARS)
    scalar[kernel.GAP], scalar[kernel.RATE] = start[:, 0].sum(), np.sum(rate * start)
    if lane.friction > 0:
        scalar[kernel.SPIN] = np.sum(slot[:, [kernel.SPIN_RE, kernel.SPIN_IM]] * start)
    row = _pairs((slots.acceleration / seen).conj())
    row_gain = np.zeros((0, 2))
    if lane.accelerations is not None:
        by = np.stack([slots.by_force, slots.by_torque]) * held(slots.rate, step / 2)
        direct = np.stack([lane.contact, lane.rotation]) @ lane.accelerations.T
        row_gain = np.asarray((slots.acceleration @ by.T).real - direct.T)
    return Coefficients(slot, row, row_gain, _numbers(lane, slots, rest, step), start, scalar)


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


def _pairs(values: Complex) -> Array:
    return np.stack([values.real, values.imag], axis=-1)


def _numbers(lane: Lane, slots: _Slots, rest: float, step: float) -> Array:
    stops, number = lane.stops, np.zeros(kernel.NUMBERS)
    middle, whole = held(slots.rate, step / 2), held(slots.rate, step)
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


class Lanes:
    """Runs of `lanes` side by side, each from its own start at t = 0, sampled every `step` s.

    A lane's numbers are the same bits in whatever company it runs.
    """

    def __init__(self, lanes: Sequence[Lane], step: float) -> None:
        self.step = step
        self._blocks = _blocks(lanes, step)
        self._rows = max((0 if lane.accelerations is None else len(lane.accelerations)) for lane in lanes)
        self._statuses = [Status.COMPLETED] * len(lanes)

    @property
    def statuses(self) -> tuple[Status, ...]:
        """How each lane is doing: COMPLETED, or DIVERGED from then on."""
        return tuple(self._statuses)

    def advance(self, steps: int) -> Array:
        """Return the next `steps` samples, shape (lanes, 1 + rows, steps), the first ones at t = 0.

        Row 0 is the upper minus the lower contact force in N (never both touch), then come the accelerations.
        A lane that has diverged gives NaN from the call on in which it did.
        """
        out = np.zeros((len(self._statuses), 1 + self._rows, steps))
        for block in self._blocks:
            block.advance(out)
            for lane in block.diverged():
                self._statuses[lane] = Status.DIVERGED
        for index in np.flatnonzero(~np.isfinite(out).all(axis=(1, 2))):
            self._statuses[index] = Status.DIVERGED
        out[[status is Status.DIVERGED for status in self._statuses]] = np.nan
        return out


class _Block:
    """Lanes of one kind, in groups of eight; the last group is filled up with copies of its first lane."""

    def __init__(self, lanes: Sequence[int], parts: Sequence[Coefficients], hertzian: bool) -> None:
        groups = -(-len(parts) // LANES)
        padding = groups * LANES - len(parts)
        self._place = np.array([*lanes, *[-1] * padding], dtype=np.int64)
        self._slot, self._row, self._row_gain, self._number, self._state, self._scalar = (
            _in_groups(each) for each in zip(*parts, *[parts[0]] * padding, strict=True)
        )
        self._hertzian = hertzian
        at_once = max(1, _AT_ONCE // (self._slot[0].nbytes + self._row[0].nbytes + self._state[0].nbytes))
        rows = self._row.shape[1]
        self._buffer = aligned((min(at_once, groups), 1 + rows, kernel.CHUNK, LANES))

    def advance(self, out: Array) -> None:
        # None, not an empty array: the kernel compiled without the recording is 10 % faster.
        row, row_gain = (self._row, self._row_gain) if self._row.shape[1] else (None, None)
        kernel.advance(
            self._slot, row, row_gain, self._number, self._state, self._scalar, self._buffer, self._place,
            self._hertzian, out,
        )  # fmt: skip

    def diverged(self) -> list[int]:
        far = ~(np.abs(self._scalar[:, kernel.GAP]) < _FAR).ravel()
        return [int(lane) for lane in self._place[far] if lane >= 0]


def _blocks(lanes: Sequence[Lane], step: float) -> list[_Block]:
    kinds: dict[tuple[object, ...], list[int]] = {}
    parts = [coefficients(lane, step) for lane in lanes]
    for index, (lane, part) in enumerate(zip(lanes, parts, strict=True)):
        kind = (part.slot.shape, len(part.row), lane.stops.hertz is not None)
        kinds.setdefault(kind, []).append(index)
    return [
        _Block(members, [parts[index] for index in members], bool(kind[-1]))
        for kind, members in kinds.items()
    ]


def _in_groups(each: Sequence[Array]) -> Array:
    """Lanes last, in groups of eight: shape (groups, ..., 8)."""
    shape = each[0].shape
    made = aligned((len(each) // LANES, *shape, LANES))
    made[:] = np.moveaxis(np.reshape(each, (len(each) // LANES, LANES, *shape)), 1, -1)
    return made
