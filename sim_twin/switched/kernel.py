"""The inner loop: exact steps in the modes of the regime, switches located by secants over tabulated steps.

Method: exact propagation of piecewise linear systems from event to event (Shaw and Holmes 1983,
10.1016/0022-460X(83)90407-8). Steps of every needed length are tabulated, so that neither stepping nor
locating a switch takes anything but multiplications. Where nothing is recorded, a step is as long as the
fastest possible motion towards a switch allows. A Hertzian part of the contact law enters as an exponential
midpoint rule (second order; Hochbruck and Ostermann 2010, 10.1017/S0962492910000048).

The slots live in one array s of shape (2 buffers, re/im, slot), and arrays are indexed in full. Loops have
one store, few other streams and no sums in the index, or the compiler would give up vectorising.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import allocation_free, allocation_free_inlined
from sim_twin.switched.tables import Tables
from sim_twin.vector import (
    LANES,
    first_positive,
    fused,
    load,
    pick,
    repeated,
    spread,
    store,
    where_positive,
)

Real = NDArray[np.float64]
_MOST_SWITCHES_AT_ONCE = 8  # lest two regimes hand on to each other for ever at one tick
_SECANTS = 4  # then halving, which ends surely where a bend leads secants astray
_FADED = 1e-200  # normal numbers end at 2e-308: room for what decays until the next look
_LEAST = -1e300
Index = NDArray[np.int64]


@allocation_free_inlined
def look_ahead(
    ahead: Real, opposite: Real, r: int, constant: float, s: Real, b: int, out: Real, line: int, column: int
) -> tuple[int, float]:
    """Look for events at the next eight fine steps; record minus the first condition up to there.

    Returns which step of 1, 2, 4 or 8 fine ones can be taken at once (its power of two; -1: none), and the
    first condition after it.
    """
    # the first condition of regime r one to eight fine steps from now, if the regime lasts
    size = ahead.shape[1]
    at, y = r * size * LANES, b * size
    one, two, three, four = spread(constant), spread(0.0), spread(0.0), spread(0.0)
    for _ in range(0, size, 4):  # slots are padded to 16
        one = fused(load(ahead, at), repeated(s, y), one)
        two = fused(load(ahead, at + LANES), repeated(s, y + 1), two)
        three = fused(load(ahead, at + 2 * LANES), repeated(s, y + 2), three)
        four = fused(load(ahead, at + 3 * LANES), repeated(s, y + 3), four)
        at, y = at + 4 * LANES, y + 4
    coming = (one + two) + (three + four)
    other = fused(spread(opposite[r, 2]), coming, spread(opposite[r, 1]))  # the second's, by the first's
    passed = first_positive(where_positive(coming - other, coming, other))
    if passed == 0:  # an event comes within the very next fine step
        return -1, 0.0
    if passed == LANES:
        if line >= 0:
            store(out, line * out.shape[1] + column + 1, spread(0.0) - coming)
        return 3, pick(coming, LANES - 1)
    power = (passed > 1) + (passed > 3)  # only steps of 2^power are tabulated
    if line >= 0:
        for k in range((1 << power) - 1):
            out[line, column + 1 + k] = -pick(coming, k)
    return power, pick(coming, (1 << power) - 1)


@allocation_free_inlined
def _turn(step: Real, row: int, s: Real, old: int, new: int) -> None:
    half = step.shape[1]
    for i in range(half):  # real and imaginary parts apart: one store a loop
        s[new, 0, i] = step[row, i] * s[old, 0, i] - step[row + 1, i] * s[old, 1, i]
    for i in range(half):
        s[new, 1, i] = step[row, i] * s[old, 1, i] + step[row + 1, i] * s[old, 0, i]


@allocation_free_inlined
def _turn_and_watch(step: Real, row: int, rows: Real, constant: float, event: int, s: Real, b: int) -> float:
    """Step from buffer b to the other one; return the condition of row `event` there."""
    half = step.shape[1]
    first = constant
    for i in range(half):
        re = step[row, i] * s[b, 0, i] - step[row + 1, i] * s[b, 1, i]
        s[1 - b, 0, i] = re
        first += rows[event, 0, i] * re
    for i in range(half):
        im = step[row, i] * s[b, 1, i] + step[row + 1, i] * s[b, 0, i]
        s[1 - b, 1, i] = im
        first += rows[event, 1, i] * im
    return first


@allocation_free_inlined
def _product(rows: Real, row: int, s: Real, b: int) -> float:
    total = 0.0
    for i in range(s.shape[2]):
        total += rows[row, 0, i] * s[b, 0, i] + rows[row, 1, i] * s[b, 1, i]
    return total


@allocation_free_inlined
def _flush(s: Real, b: int) -> None:
    # Modes that have died out would reach the denormal numbers, which cost a hundred times a normal one.
    for part in range(2):
        for i in range(s.shape[2]):
            if abs(s[b, part, i]) < _FADED:
                s[b, part, i] = 0.0


@allocation_free_inlined
def _fastest(event_speed: Real, r: int, s: Real, b: int) -> float:
    """Bound on the change of the first event's condition in a fine step from now on (modes only decay)."""
    fast = 0.0
    for i in range(event_speed.shape[1]):
        fast += event_speed[r, i] * np.sqrt(s[b, 0, i] * s[b, 0, i] + s[b, 1, i] * s[b, 1, i])
    return fast


@allocation_free_inlined
def _residual_force(residual: Real, rows: Real, numbers: Real, r: int, s: Real, b: int) -> float:
    if residual[r, 0] == 0.0:
        return 0.0
    last = (r + 1) * (rows.shape[0] // residual.shape[0]) - 1  # its row of penetration
    d = numbers[last, 0] + _product(rows, last, s, b)
    if d <= 0.0:
        return 0.0
    # N: what the law has beyond the spring that is in the modes already
    return float(residual[r, 0] * d * np.sqrt(d) - residual[r, 1] * d)


@allocation_free_inlined
def _turn_with_residual(
    step: Real, row: int, rows: Real, numbers: Real, residual: Real, r: int, s: Real, old: int, new: int
) -> None:
    half = step.shape[1]
    force = _residual_force(residual, rows, numbers, r, s, old)
    _turn(step, row + 2, s, old, new)  # half a step with the force held, for the motion in the middle
    for i in range(half):
        s[new, 0, i] += step[row + 6, i] * force
    for i in range(half):
        s[new, 1, i] += step[row + 7, i] * force
    force = _residual_force(residual, rows, numbers, r, s, new)  # there; held over the whole step
    _turn(step, row, s, old, new)
    for i in range(half):
        s[new, 0, i] += step[row + 4, i] * force
    for i in range(half):
        s[new, 1, i] += step[row + 5, i] * force


@allocation_free_inlined
def _fired(
    rows: Real, numbers: Real, target: Index, residual: Real, r: int, s: Real, b: int
) -> tuple[int, float]:
    """First event of regime r with both conditions positive, or -1; and its (else the largest) first one."""
    force = _residual_force(residual, rows, numbers, r, s, b)
    largest, row = _LEAST, r * (rows.shape[0] // target.shape[0])
    for e in range(target.shape[1]):
        if target[r, e] < 0:  # rows are as many for every regime, the rest unused
            break
        first = numbers[row, 0] + numbers[row, 1] * force + _product(rows, row, s, b)
        largest = max(largest, first)
        row += 1
        if first > 0.0 and numbers[row, 0] + numbers[row, 1] * force + _product(rows, row, s, b) > 0.0:
            return e, first
        row += 1
    return -1, largest


@allocation_free_inlined
def _attempt(
    step: Real, row: int, rows: Real, numbers: Real, target: Index, residual: Real, r: int, s: Real, b: int
) -> tuple[int, float]:
    """Take a step into the other buffer; return what fired there."""
    if residual[r, 0] != 0.0:
        _turn_with_residual(step, row, rows, numbers, residual, r, s, b, 1 - b)
    else:
        _turn(step, row, s, b, 1 - b)
    return _fired(rows, numbers, target, residual, r, s, 1 - b)


@allocation_free_inlined
def _locate(
    step: Real, planes: int, begin: int, k: int, digits: int, rows: Real, numbers: Real, target: Index,
    residual: Real, r: int, s: Real, b: int,
) -> tuple[int, int]:  # fmt: skip
    """Go from buffer b to the first tick in step k at which something has fired; return buffer and ticks."""
    passed, digit, tries = 0, digits - 1, 0  # digit: coarse ticks of a fine step, ticks of a coarse one
    _, below = _fired(rows, numbers, target, residual, r, s, b)
    _, above = _fired(rows, numbers, target, residual, r, s, 1 - b)
    level = k - digits - digit  # above 0: a step of 2^level fine ones, halved first
    base, low, high = (digits, 0, min(k - digits, digit)) if k > digits else (0, 0, k)
    while True:
        narrowing = level > 0 or high - low > 1
        if level > 0:
            middle = digit + level - 1
        elif not narrowing:
            middle = low if base > 0 else high  # coarsely to before the event, finely to after it
        elif below < 0.0 < above and tries < _SECANTS:
            middle = low + int((high - low) * below / (below - above))
            middle = min(max(middle, low + 1), high - 1)  # a secant may not stand still
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


@allocation_free
def _to_slots(t: Tables, r: int, x: Real, s: Real) -> None:
    """Express state x, which is lost, in regime r's modes; s[0] has the excitations and is zero elsewhere."""
    half = t.step.shape[1]
    for k in range(x.size):
        x[k] -= t.rest[r, k] + _product(t.to_state, r * x.size + k, s, 0)  # the steady answer to the drive
    for part in range(2):
        for i in range(t.first_drive):
            total, row = 0.0, (2 * r + part) * half + i
            for k in range(x.size):
                total += t.to_slot[row, k] * x[k]
            s[0, part, i] = total


@allocation_free_inlined
def _change_modes(change: Real, offset: Real, which: int, s: Real, old: int, new: int) -> None:
    slots = s.shape[2]
    row = 2 * slots * which
    for part in range(2):
        for i in range(slots):
            s[new, part, i] = offset[which, part, i]
        for old_part in range(2):
            for j in range(0, slots, 4):
                k = row + old_part * slots + j
                one, two = s[old, old_part, j], s[old, old_part, j + 1]
                three, four = s[old, old_part, j + 2], s[old, old_part, j + 3]
                for i in range(slots):
                    pair = change[k, part, i] * one + change[k + 1, part, i] * two
                    s[new, part, i] += pair + change[k + 2, part, i] * three + change[k + 3, part, i] * four


@allocation_free_inlined
def _switch(
    rows: Real, numbers: Real, target: Index, residual: Real, change: Real, offset: Real, r: int, s: Real,
    b: int,
) -> tuple[int, int]:  # fmt: skip
    """Follow the events that have fired, one after another; return the buffer and the regime at the end."""
    for _ in range(_MOST_SWITCHES_AT_ONCE):
        fired, _value = _fired(rows, numbers, target, residual, r, s, b)
        if fired < 0:
            break
        _change_modes(change, offset, r * target.shape[1] + fired, s, b, 1 - b)
        r, b = target[r, fired], 1 - b
    return b, r


@allocation_free_inlined
def _record(
    output: Real, numbers: Real, used: Index, force: float, r: int, s: Real, b: int, out: Real, column: int
) -> None:
    for o in range(used.shape[1]):
        if used[r, o] < 0:  # outputs in use come first
            return
        row = r * used.shape[1] + o
        out[used[r, o], column] = numbers[row, 0] + numbers[row, 1] * force + _product(output, row, s, b)


@allocation_free_inlined
def _try(
    step: Real, at: int, rows: Real, numbers: Real, target: Index, residual: Real, opposite: Real, r: int,
    s: Real, b: int,
) -> tuple[int, float, float]:  # fmt: skip
    """Take a step into the other buffer; return what fired there, and the first two events' conditions."""
    first, second = 0.0, 0.0
    if opposite[r, 0] > 0.0:  # both conditions come of one product
        row = r * (rows.shape[0] // target.shape[0])
        first = _turn_and_watch(step, at, rows, numbers[row, 0], row, s, b)
        second = opposite[r, 1] + opposite[r, 2] * first
        if first <= 0.0 and second <= 0.0:
            return -1, first, second
        fired, _value = _fired(rows, numbers, target, residual, r, s, 1 - b)
    else:
        fired, _value = _attempt(step, at, rows, numbers, target, residual, r, s, b)
    return fired, first, second


@allocation_free_inlined
def _longest_step(bits: int, digits: int, left: int, longest: int, nearest: float, fast: float) -> int:
    """Index of a step of at most `left` ticks that ends before any event can come, or is two fine steps.

    `nearest` is the greatest condition of an event and `fast` a bound on its rise in a fine step.
    """
    fine = 1 << (2 * bits)  # ticks; all positions are in ticks, which are exact as integers
    if left < 2 * fine:
        if left >= 1 << bits:
            return digits + (min(left, fine) >> bits)  # coarse ticks, at most a fine step
        return left
    k = digits + digits
    rise, reach = 4.0 * fast, 4 * fine
    while k < longest and nearest + rise < 0.0 and reach <= left:
        k, rise, reach = k + 1, 2.0 * rise, 2 * reach
    return k


def run(
    t: Tables, x: Real, regime: int, drive_re: Real, drive_im: Real, out: Real, switch_time: Real,
    switch_regime: Index,
) -> tuple[int, int]:  # fmt: skip
    """Advance state x (2 n,) in place by out.shape[1] fine steps and fill `out` (outputs, fine steps).

    `drive_re`, `drive_im`: excitations at the start. Switches go to `switch_time` (in fine steps from the
    start) and `switch_regime`. Returns the last regime and the number of switches (counted past the arrays).
    """
    s = np.zeros((2, 2, t.step.shape[1]))
    s[:, 0, t.first_drive : t.first_drive + drive_re.size] = drive_re
    s[:, 1, t.first_drive : t.first_drive + drive_im.size] = drive_im
    last, switches = _run(t, x, s, regime, out, switch_time, switch_regime)
    return int(last), int(switches)


@allocation_free
def _run(  # noqa: C901 - what is split off is inlined again, and every further argument slows the compiler
    t: Tables, x: Real, s: Real, regime: int, out: Real, switch_time: Real, switch_regime: Index
) -> tuple[int, int]:
    step, rows, numbers, target, residual = t.step, t.event, t.event_numbers, t.event_target, t.residual
    change, offset, event_speed, ticks, ahead = t.change, t.offset, t.event_speed, t.ticks, t.ahead
    output, output_numbers, used, line = t.output, t.output_numbers, t.outputs_used, t.mirrored
    recorded, opposite = t.recorded, t.opposite
    regimes, width = target.shape[0], rows.shape[0] // target.shape[0]
    planes, bits, digits = step.shape[0] // (regimes * ticks.size), t.bits, t.digits
    r, b, switches, steps, position, total = regime, 0, 0, 0, 0, out.shape[1] << (2 * bits)
    first, second, fast, changed, fine = 0.0, 0.0, 0.0, True, 1 << (2 * bits)
    _to_slots(t, r, x, s)
    while position < total:
        row, begin, left = r * width, r * ticks.size * planes, total - position
        if changed:
            first = numbers[row, 0] + _product(rows, row, s, b)
            second = opposite[r, 1] + opposite[r, 2] * first
        if changed or steps & 31 == 0:  # modes decay: in between the bound still holds, only wider
            _flush(s, b)
            fast = _fastest(event_speed, r, s, b)
        changed, steps = False, steps + 1
        looking = opposite[r, 0] > 0.0 and used[r, 0] < 0 and left > LANES * fine  # out has room
        column = position >> (2 * bits)
        if recorded[r] > 0:
            within = position & (fine - 1)
            if within == 0 and line[r] >= 0:
                out[line[r], column] = -first
            if within == 0 and used[r, 0] >= 0:
                force = _residual_force(residual, rows, numbers, r, s, b)
                _record(output, output_numbers, used, force, r, s, b, out, column)
            left, looking = fine - within, looking and within == 0  # stop at each sample
        longest = ticks.size - 1 if opposite[r, 0] > 0.0 else 2 * digits  # `fast` bounds two events
        k = _longest_step(bits, digits, left, longest, max(first, second), fast)
        if looking and k < 2 * digits + 2:  # else the bound grants eight fine steps anyway
            power, condition = look_ahead(ahead, opposite, r, numbers[row, 0], s, b, out, line[r], column)
            if power >= 0:
                _turn(step, begin + (2 * digits - 1 + power) * planes, s, b, 1 - b)
                first, b, position = condition, 1 - b, position + (fine << power)
                second = opposite[r, 1] + opposite[r, 2] * first
                continue
        at = begin + k * planes
        fired, first, second = _try(step, at, rows, numbers, target, residual, opposite, r, s, b)
        if fired < 0:
            b, position = 1 - b, position + ticks[k]
            continue
        b, passed = _locate(step, planes, begin, k, digits, rows, numbers, target, residual, r, s, b)
        position, changed = position + passed, True
        b, new = _switch(rows, numbers, target, residual, change, offset, r, s, b)
        if new != r:
            if switches < switch_time.size:  # counted on, so that the caller sees that they did not fit
                switch_time[switches], switch_regime[switches] = position / fine, new
            r, switches = new, switches + 1
    for k in range(x.size):
        x[k] = t.rest[r, k] + _product(t.to_state, r * x.size + k, s, b)
    return r, switches
