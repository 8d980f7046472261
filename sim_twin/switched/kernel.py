"""The inner loop: exact steps in the modes of the regime, switches located by bisection over powers of two.

Method: exact propagation of piecewise linear systems from event to event (Shaw and Holmes 1983,
10.1016/0022-460X(83)90407-8), here with a dyadic ladder of precomputed steps, so that locating a switch takes
multiplications only. A Hertzian part of the contact law enters as an exponential midpoint rule (second order;
Hochbruck and Ostermann 2010, 10.1017/S0962492910000048).

The slots live in one array s of shape (2 buffers, re/im, slot), and arrays are indexed in full: taking views or
handing the whole table on costs several times the arithmetic.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_twin.switched.tables import Tables

_MOST_SWITCHES_AT_ONCE = 8

Real = NDArray[np.float64]
Index = NDArray[np.int64]


@njit(cache=True, fastmath=True)
def _turn(step_re: Real, step_im: Real, r: int, level: int, s: Real, old: int, new: int) -> None:
    for i in range(s.shape[2]):
        re = step_re[r, level, i] * s[old, 0, i] - step_im[r, level, i] * s[old, 1, i]
        im = step_re[r, level, i] * s[old, 1, i] + step_im[r, level, i] * s[old, 0, i]
        s[new, 0, i] = re
        s[new, 1, i] = im


@njit(cache=True, fastmath=True, inline="always")
def _turn_and_watch(
    step_re: Real, step_im: Real, row_re: Real, row_im: Real, constant: Real, r: int, level: int, s: Real, b: int
) -> tuple[float, float]:  # fmt: skip
    """Step from buffer b to the other one; return the conditions of the first two events there."""
    first, second = constant[r, 0], constant[r, 2]
    for i in range(s.shape[2]):
        re = step_re[r, level, i] * s[b, 0, i] - step_im[r, level, i] * s[b, 1, i]
        im = step_re[r, level, i] * s[b, 1, i] + step_im[r, level, i] * s[b, 0, i]
        s[1 - b, 0, i] = re
        s[1 - b, 1, i] = im
        first += row_re[r, 0, i] * re - row_im[r, 0, i] * im
        second += row_re[r, 2, i] * re - row_im[r, 2, i] * im
    return first, second


@njit(cache=True, fastmath=True)
def _flush(s: Real, b: int) -> None:
    # Modes that have died out would reach the denormal numbers, which cost a hundred times a normal one.
    for i in range(s.shape[2]):
        if s[b, 0, i] * s[b, 0, i] + s[b, 1, i] * s[b, 1, i] < 1e-200:
            s[b, 0, i] = 0.0
            s[b, 1, i] = 0.0


@njit(cache=True, fastmath=True, inline="always")
def _scalar(row_re: Real, row_im: Real, r: int, k: int, s: Real, b: int) -> float:
    total = 0.0
    for i in range(s.shape[2]):
        total += row_re[r, k, i] * s[b, 0, i] - row_im[r, k, i] * s[b, 1, i]
    return total


@njit(cache=True, fastmath=True)
def _residual_force(residual: Real, row_re: Real, row_im: Real, r: int, s: Real, b: int) -> float:
    if residual[r, 0] == 0.0:
        return 0.0
    d = residual[r, 2] + _scalar(row_re, row_im, r, 0, s, b)
    if d <= 0.0:
        return 0.0
    return float(residual[r, 0] * d * np.sqrt(d) - residual[r, 1] * d)


@njit(cache=True, fastmath=True)
def _push(push_re: Real, push_im: Real, r: int, level: int, force: float, s: Real, b: int) -> None:
    for i in range(s.shape[2]):
        s[b, 0, i] += push_re[r, level, i] * force
        s[b, 1, i] += push_im[r, level, i] * force


@njit(cache=True, fastmath=True)
def _turn_with_residual(t: Tables, r: int, level: int, s: Real, old: int, new: int) -> None:
    half = max(level - 1, 0)
    force = _residual_force(t.residual, t.penetration_re, t.penetration_im, r, s, old)
    _turn(t.step_re, t.step_im, r, half, s, old, new)
    _push(t.push_re, t.push_im, r, half, force, s, new)
    force = _residual_force(t.residual, t.penetration_re, t.penetration_im, r, s, new)
    _turn(t.step_re, t.step_im, r, level, s, old, new)
    _push(t.push_re, t.push_im, r, level, force, s, new)


@njit(cache=True, fastmath=True)
def _fired(
    row_re: Real, row_im: Real, constant: Real, gain: Real, target: Index, r: int, force: float, s: Real, b: int
) -> int:
    """Return the first event of regime r whose two conditions are positive, or -1 (rows 2 e and 2 e + 1)."""
    for e in range(target.shape[1]):
        if target[r, e] < 0:
            return -1
        first = constant[r, 2 * e] + gain[r, 2 * e] * force + _scalar(row_re, row_im, r, 2 * e, s, b)
        if first > 0.0:
            k = 2 * e + 1
            if constant[r, k] + gain[r, k] * force + _scalar(row_re, row_im, r, k, s, b) > 0.0:
                return e
    return -1


@njit(cache=True, fastmath=True)
def _to_state(t: Tables, r: int, s: Real, b: int, x: Real) -> None:
    for k in range(x.size):
        x[k] = t.rest[r, k] + _scalar(t.to_state_re, t.to_state_im, r, k, s, b)


@njit(cache=True, fastmath=True)
def _to_slots(t: Tables, r: int, x: Real, s: Real, b: int) -> None:
    """Express state x in the modes of regime r; the excitations' slots of buffer b are given."""
    first = t.first_drive
    moving = x - t.rest[r]
    for k in range(x.size):
        for i in range(first, s.shape[2]):
            moving[k] -= t.to_state_re[r, k, i] * s[b, 0, i] - t.to_state_im[r, k, i] * s[b, 1, i]
    for i in range(first):
        re, im = 0.0, 0.0
        for k in range(x.size):
            re += t.to_slot_re[r, i, k] * moving[k]
            im += t.to_slot_im[r, i, k] * moving[k]
        s[b, 0, i], s[b, 1, i] = re, im


@njit(cache=True, fastmath=True, inline="always")
def _record(
    row_re: Real, row_im: Real, constant: Real, gain: Real, used: Index, r: int, force: float, s: Real, b: int,
    out: Real, column: int,
) -> None:  # fmt: skip
    for o in range(used.shape[1]):
        if used[r, o] >= 0:
            value = constant[r, o] + gain[r, o] * force
            for i in range(s.shape[2]):
                value += row_re[r, o, i] * s[b, 0, i] - row_im[r, o, i] * s[b, 1, i]
            out[used[r, o], column] = value


@njit(cache=True, fastmath=True)
def run(
    t: Tables, x: Real, regime: int, drive_re: Real, drive_im: Real, out: Real, switch_time: Real,
    switch_regime: Index,
) -> tuple[int, int]:  # fmt: skip
    """Advance state x (2 n,) in place by out.shape[1] fine steps and fill `out` (outputs, fine steps).

    `drive_re`, `drive_im`: excitations at the start. Switches go to `switch_time` (in fine steps from the
    start) and `switch_regime`. Returns the last regime and the number of switches (counted past the arrays).
    """
    fine, coarse = t.fine_level, t.step_re.shape[1] - 1
    step_re, step_im, residual = t.step_re, t.step_im, t.residual
    rows_re, rows_im, constant, gain, target = (
        t.event_re, t.event_im, t.event_constant, t.event_residual, t.event_target,
    )  # fmt: skip
    s = np.zeros((2, 2, step_re.shape[2]))
    s[:, 0, t.first_drive : t.first_drive + drive_re.size] = drive_re
    s[:, 1, t.first_drive : t.first_drive + drive_re.size] = drive_im
    r, b, switches = regime, 0, 0
    _to_slots(t, r, x, s, b)
    many = target.shape[1] > 2
    force, position, total, steps = 0.0, 0, out.shape[1] << fine, 0
    while position < total:
        steps += 1
        if steps & 255 == 0:
            _flush(s, b)
        hertz = residual[r, 0] != 0.0
        if position & ((1 << fine) - 1) == 0 and t.outputs_used[r, 0] >= 0:
            if hertz:
                force = _residual_force(residual, t.penetration_re, t.penetration_im, r, s, b)
            _record(
                t.output_re, t.output_im, t.output_constant, t.output_residual, t.outputs_used, r, force, s, b,
                out, position >> fine,
            )  # fmt: skip
        top = coarse if t.outputs_used[r, 0] < 0 else fine
        while position & ((1 << top) - 1) != 0 or position + (1 << top) > total:
            top -= 1
        level, searching = top, False
        while level >= 0:
            first, second = 1.0, 1.0
            if hertz:
                _turn_with_residual(t, r, level, s, b, 1 - b)
                force = _residual_force(residual, t.penetration_re, t.penetration_im, r, s, 1 - b)
            else:
                first, second = _turn_and_watch(
                    step_re, step_im, rows_re, rows_im, constant, r, level, s, b
                )
            fired = -1
            if many or first > 0.0 or second > 0.0:
                fired = _fired(rows_re, rows_im, constant, gain, target, r, force, s, 1 - b)
            if fired < 0 or level == 0:
                b = 1 - b
                position += 1 << level
            if fired < 0 and not searching:
                break
            searching = True
            level -= 1
        if not searching:
            continue
        for _ in range(_MOST_SWITCHES_AT_ONCE):
            if residual[r, 0] != 0.0:
                force = _residual_force(residual, t.penetration_re, t.penetration_im, r, s, b)
            fired = _fired(rows_re, rows_im, constant, gain, target, r, force, s, b)
            if fired < 0:
                break
            _to_state(t, r, s, b, x)
            r, force = target[r, fired], 0.0
            _to_slots(t, r, x, s, b)
            if switches < switch_time.size:
                switch_time[switches] = position / (1 << fine)
                switch_regime[switches] = r
            switches += 1
    _to_state(t, r, s, b, x)
    return r, switches
