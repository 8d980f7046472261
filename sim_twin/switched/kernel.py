"""The inner loop: exact steps in the modes of the regime, switches located by secants over tabulated steps.

Method: exact propagation of piecewise linear systems from event to event (Shaw and Holmes 1983,
10.1016/0022-460X(83)90407-8). Steps of every needed length are tabulated, so that neither stepping nor locating
a switch takes anything but multiplications. Where nothing is recorded, a step is as long as the fastest possible
motion towards a switch allows. A Hertzian part of the contact law enters as an exponential midpoint rule (second
order; Hochbruck and Ostermann 2010, 10.1017/S0962492910000048).

The slots live in one array s of shape (2 buffers, slot), and arrays are indexed in full: taking views or handing
the whole table on costs several times the arithmetic. Loops have one store and at most six other streams, because
beyond eight comparisons of addresses the compiler gives up vectorising.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_twin.switched.tables import Tables

_MOST_SWITCHES_AT_ONCE = 8
_SECANTS = 4
_FADED = 1e-200
_LEAST = -1e300

Real = NDArray[np.float64]
Index = NDArray[np.int64]

# Without reference counting: it would cost more than the arithmetic. So nothing here may allocate.
_compiled = njit(cache=True, fastmath=True, _nrt=False)
_inlined = njit(cache=True, fastmath=True, _nrt=False, inline="always")


@_inlined
def _turn(step: Real, row: int, s: Real, old: int, new: int) -> None:
    half = step.shape[1]
    for i in range(half):
        s[new, i] = step[row, i] * s[old, i] - step[row + 1, i] * s[old, half + i]
    for i in range(half):
        s[new, half + i] = step[row, i] * s[old, half + i] + step[row + 1, i] * s[old, i]


@_inlined
def _turn_and_watch(
    step: Real, row: int, rows: Real, numbers: Real, event: int, s: Real, b: int
) -> tuple[float, float]:
    """Step from buffer b to the other one; return the first conditions of the first two events there."""
    half = step.shape[1]
    first, second = numbers[event, 0], numbers[event + 2, 0]
    for i in range(half):
        re = step[row, i] * s[b, i] - step[row + 1, i] * s[b, half + i]
        s[1 - b, i] = re
        first += rows[event, i] * re
        second += rows[event + 2, i] * re
    for i in range(half):
        im = step[row, i] * s[b, half + i] + step[row + 1, i] * s[b, i]
        s[1 - b, half + i] = im
        first += rows[event, half + i] * im
        second += rows[event + 2, half + i] * im
    return first, second


@_inlined
def _product(rows: Real, row: int, s: Real, b: int) -> float:
    total = 0.0
    for i in range(s.shape[1]):
        total += rows[row, i] * s[b, i]
    return total


@_inlined
def _flush(s: Real, b: int) -> None:
    # Modes that have died out would reach the denormal numbers, which cost a hundred times a normal one.
    for i in range(s.shape[1]):
        if abs(s[b, i]) < _FADED:
            s[b, i] = 0.0


@_inlined
def _fastest(event_speed: Real, row: int, s: Real, b: int) -> tuple[float, float]:
    """Bounds on the rise of the first two events' conditions in a fine step from now on (modes only decay)."""
    half = event_speed.shape[1]
    first, second = 0.0, 0.0
    for i in range(half):
        size = np.sqrt(s[b, i] * s[b, i] + s[b, half + i] * s[b, half + i])
        first += event_speed[row, i] * size
        second += event_speed[row + 1, i] * size
    return first, second


@_inlined
def _residual_force(residual: Real, rows: Real, numbers: Real, r: int, s: Real, b: int) -> float:
    if residual[r, 0] == 0.0:
        return 0.0
    last = (r + 1) * (rows.shape[0] // residual.shape[0]) - 1
    d = numbers[last, 0] + _product(rows, last, s, b)
    if d <= 0.0:
        return 0.0
    return float(residual[r, 0] * d * np.sqrt(d) - residual[r, 1] * d)


@_inlined
def _turn_with_residual(
    step: Real, row: int, rows: Real, numbers: Real, residual: Real, r: int, s: Real, old: int, new: int
) -> None:
    half = step.shape[1]
    force = _residual_force(residual, rows, numbers, r, s, old)
    _turn(step, row + 2, s, old, new)
    for i in range(half):
        s[new, i] += step[row + 6, i] * force
    for i in range(half):
        s[new, half + i] += step[row + 7, i] * force
    force = _residual_force(residual, rows, numbers, r, s, new)
    _turn(step, row, s, old, new)
    for i in range(half):
        s[new, i] += step[row + 4, i] * force
    for i in range(half):
        s[new, half + i] += step[row + 5, i] * force


@_inlined
def _fired(
    rows: Real, numbers: Real, target: Index, residual: Real, r: int, s: Real, b: int
) -> tuple[int, float]:
    """First event of regime r whose two conditions are positive, or -1, and its (else the largest) first one."""
    force = _residual_force(residual, rows, numbers, r, s, b)
    largest, row = _LEAST, r * (rows.shape[0] // target.shape[0])
    for e in range(target.shape[1]):
        if target[r, e] < 0:
            break
        first = numbers[row, 0] + numbers[row, 1] * force + _product(rows, row, s, b)
        largest = max(largest, first)
        row += 1
        if first > 0.0 and numbers[row, 0] + numbers[row, 1] * force + _product(rows, row, s, b) > 0.0:
            return e, first
        row += 1
    return -1, largest


@_inlined
def _attempt(
    step: Real, row: int, rows: Real, numbers: Real, target: Index, residual: Real, r: int, s: Real, b: int
) -> tuple[int, float]:
    """Take a step into the other buffer; return what fired there."""
    if residual[r, 0] != 0.0:
        _turn_with_residual(step, row, rows, numbers, residual, r, s, b, 1 - b)
    else:
        _turn(step, row, s, b, 1 - b)
    return _fired(rows, numbers, target, residual, r, s, 1 - b)


@_inlined
def _locate(
    step: Real, planes: int, begin: int, k: int, digits: int, rows: Real, numbers: Real, target: Index,
    residual: Real, r: int, s: Real, b: int,
) -> tuple[int, int]:  # fmt: skip
    """Go from buffer b to the first tick at which something has fired within step k; return buffer and ticks."""
    passed, digit, tries = 0, digits - 1, 0
    _, below = _fired(rows, numbers, target, residual, r, s, b)
    _, above = _fired(rows, numbers, target, residual, r, s, 1 - b)
    level = k - digits - digit
    base, low, high = (digits, 0, min(k - digits, digit)) if k > digits else (0, 0, k)
    while True:
        narrowing = level > 0 or high - low > 1
        if level > 0:
            middle = digit + level - 1
        elif not narrowing:
            middle = low if base > 0 else high
        elif below < 0.0 < above and tries < _SECANTS:
            middle = low + int((high - low) * below / (below - above))
            middle = min(max(middle, low + 1), high - 1)
        else:
            middle = (low + high) >> 1
        row = begin + (base + middle) * planes
        fired, value = _attempt(step, row, rows, numbers, target, residual, r, s, b)
        if not narrowing:
            b, passed = 1 - b, passed + (middle * digit if base > 0 else middle)
            if base == 0:
                break
            base, low, high, tries = 0, 0, digit, 0
        elif level > 0:
            level -= 1
            if fired < 0:
                b, passed, below = 1 - b, passed + (digit * digit << level), value
            else:
                above = value
        elif fired < 0:
            low, below, tries = middle, value, tries + 1
        else:
            high, above, tries = middle, value, tries + 1
    return b, passed


@_compiled
def _to_state(to_state: Real, rest: Real, r: int, s: Real, b: int, x: Real) -> None:
    for k in range(x.size):
        x[k] = rest[r, k] + _product(to_state, r * x.size + k, s, b)


@_compiled
def _to_slots(t: Tables, r: int, x: Real, s: Real) -> None:
    """Express state x, which is lost, in regime r's modes; s[0] has the excitations and is zero elsewhere."""
    half = t.step.shape[1]
    for k in range(x.size):
        x[k] -= t.rest[r, k] + _product(t.to_state, r * x.size + k, s, 0)
    for part in range(2):
        for i in range(t.first_drive):
            total, row = 0.0, (2 * r + part) * half + i
            for k in range(x.size):
                total += t.to_slot[row, k] * x[k]
            s[0, part * half + i] = total


@_inlined
def _change_modes(change: Real, offset: Real, which: int, s: Real, old: int, new: int) -> None:
    slots, row = s.shape[1], which * s.shape[1]
    for i in range(slots):
        s[new, i] = offset[which, i]
    for j in range(0, slots, 4):
        one, two, three, four = s[old, j], s[old, j + 1], s[old, j + 2], s[old, j + 3]
        for i in range(slots):
            pair = change[row + j, i] * one + change[row + j + 1, i] * two
            s[new, i] += pair + change[row + j + 2, i] * three + change[row + j + 3, i] * four


@_inlined
def _record(
    output: Real, numbers: Real, used: Index, force: float, r: int, s: Real, b: int, out: Real, column: int
) -> None:
    for o in range(used.shape[1]):
        if used[r, o] < 0:
            return
        row = r * used.shape[1] + o
        out[used[r, o], column] = numbers[row, 0] + numbers[row, 1] * force + _product(output, row, s, b)


@_inlined
def _longest_step(
    bits: int, digits: int, left: int, longest: int, first: float, second: float, fast: float, faster: float
) -> int:
    """Index of a step that takes `left` ticks at most and ends before any event can come, or is two fine steps.

    `first`, `second` are the events' conditions and `fast`, `faster` bounds on their rise in a fine step.
    """
    fine = 1 << (2 * bits)
    if left < 2 * fine:
        if left >= 1 << bits:
            return digits + (min(left, fine) >> bits)
        return left
    k = digits + digits
    fast, faster, reach = 4.0 * fast, 4.0 * faster, 4 * fine
    while k < longest and first + fast < 0.0 and second + faster < 0.0 and reach <= left:
        k, fast, faster, reach = k + 1, 2.0 * fast, 2.0 * faster, 2 * reach
    return k


def run(
    t: Tables, x: Real, regime: int, drive_re: Real, drive_im: Real, out: Real, switch_time: Real,
    switch_regime: Index,
) -> tuple[int, int]:  # fmt: skip
    """Advance state x (2 n,) in place by out.shape[1] fine steps and fill `out` (outputs, fine steps).

    `drive_re`, `drive_im`: excitations at the start. Switches go to `switch_time` (in fine steps from the
    start) and `switch_regime`. Returns the last regime and the number of switches (counted past the arrays).
    """
    half = t.step.shape[1]
    s = np.zeros((2, 2 * half))
    s[:, t.first_drive : t.first_drive + drive_re.size] = drive_re
    s[:, half + t.first_drive : half + t.first_drive + drive_im.size] = drive_im
    last, switches = _run(t, x, s, regime, out, switch_time, switch_regime)
    return int(last), int(switches)


@_compiled
def _run(
    t: Tables, x: Real, s: Real, regime: int, out: Real, switch_time: Real, switch_regime: Index
) -> tuple[int, int]:
    step, rows, numbers, target, residual = t.step, t.event, t.event_numbers, t.event_target, t.residual
    change, offset, event_speed, ticks = t.change, t.offset, t.event_speed, t.ticks
    output, output_numbers, used, mirrored, recorded = (
        t.output, t.output_numbers, t.outputs_used, t.mirrored, t.recorded,
    )  # fmt: skip
    regimes, events = target.shape
    width, planes = 2 * events + 1, step.shape[0] // (regimes * ticks.size)
    bits, digits, many = t.bits, t.digits, events > 2
    shift, fine = 2 * bits, 1 << (2 * bits)
    longest = 2 * digits if many else ticks.size - 1
    r, b, switches, steps, position, total = regime, 0, 0, 0, 0, out.shape[1] << shift
    first, second, fast, faster = 0.0, 0.0, 0.0, 0.0
    _to_slots(t, r, x, s)
    changed = True
    while position < total:
        if changed:
            first = numbers[r * width, 0] + _product(rows, r * width, s, b)
            second = numbers[r * width + 2, 0] + _product(rows, r * width + 2, s, b)
        if changed or steps & 31 == 0:
            _flush(s, b)
            fast, faster = _fastest(event_speed, r * events, s, b)
        changed = False
        steps += 1
        left = total - position
        if recorded[r] > 0:
            within = position & (fine - 1)
            if within == 0:
                if mirrored[r] >= 0:
                    out[mirrored[r], position >> shift] = -first
                if used[r, 0] >= 0:
                    force = _residual_force(residual, rows, numbers, r, s, b)
                    _record(output, output_numbers, used, force, r, s, b, out, position >> shift)
            left = fine - within
        k = _longest_step(bits, digits, left, longest, first, second, fast, faster)
        begin = r * ticks.size * planes
        fired = 0
        if residual[r, 0] == 0.0:
            first, second = _turn_and_watch(step, begin + k * planes, rows, numbers, r * width, s, b)
            if first <= 0.0 and second <= 0.0 and not many:
                fired = -1
        else:
            _turn_with_residual(step, begin + k * planes, rows, numbers, residual, r, s, b, 1 - b)
        if fired == 0:
            fired, _ = _fired(rows, numbers, target, residual, r, s, 1 - b)
        if fired < 0:
            b, position = 1 - b, position + ticks[k]
            continue
        b, passed = _locate(step, planes, begin, k, digits, rows, numbers, target, residual, r, s, b)
        position, changed = position + passed, True
        for _ in range(_MOST_SWITCHES_AT_ONCE):
            fired, _ = _fired(rows, numbers, target, residual, r, s, b)
            if fired < 0:
                break
            _change_modes(change, offset, r * events + fired, s, b, 1 - b)
            r, b = target[r, fired], 1 - b
            if switches < switch_time.size:
                switch_time[switches] = position / fine
                switch_regime[switches] = r
            switches += 1
    _to_state(t.to_state, t.rest, r, s, b, x)
    return r, switches
