"""Equal steps over lanes: the linear motion exact, the contact force implicit at the middle of the step.

Step k spans t_k - h/2 ... t_k + h/2. The slots hold the motion at t_k as it would be without this step's
force F_k, scaled so that the gap is the sum of their real parts. F_k comes from the contact law at t_k, what
it does itself in half a step included, and is held over the step (exponential midpoint rule, second order:
Hochbruck and Ostermann 2010, 10.1017/S0962492910000048). The drive's steady response is one more slot for
each harmonic.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_twin.compiled import strict, strict_inlined
from sim_twin.vector import (
    LANES,
    Vector,
    fused,
    fused_less,
    load,
    magnitude,
    root,
    signed,
    spread,
    store,
    transpose,
    where_positive,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TURN_RE, TURN_IM, PUSH_RE, PUSH_IM, RATE_RE, RATE_IM, TWIST_RE, TWIST_IM, SPIN_RE, SPIN_IM = range(10)
"""Of a slot: factor of a step; F held over it; row of the gap's rate. With friction also the pivot's torque
held over it, and row of the pivot's rotation rate at its end."""
PLAIN, WITH_FRICTION = 6, 10
CENTRE, CLEARANCE, STIFFNESS, DAMPING, SHARE, HALF_STEP, GIVE, GIVE_RATE = range(8)
TORQUE, SPIN_STIFFNESS, SPIN_BY_FORCE, GAP_BY_TORQUE, RATE_BY_TORQUE = range(8, 13)
GAP_AFTER_FORCE, RATE_AFTER_FORCE = 13, 14
NUMBERS = 15
"""In m, m, N/m (Hertzian: N/m^1.5), N s/m, 1, s, m/N, m/(N s); N m, N m s, 1/(N s), 1/N, 1/(N s); m/N,
m/(N s). The second five are for friction alone.

By the middle of a step a force has moved its own contact by GIVE a newton: SHARE of a linear one is left."""
GAP, RATE, SPIN = range(3)  # m and m/s at t_k, rad/s at the end of the step; all without F_k
SCALARS = 3
CHUNK = 32  # a multiple of LANES, for tiles of 8 steps by 8 lanes are turned
"""Steps between copies to the output."""
_FADED = 1e-200  # normal numbers end at 2e-308: room for what decays until the next look
_SETTLE_EVERY = 8 * CHUNK  # steps; a look goes through the whole motion, as a step does
_NEWTON_STEPS = 3  # as many in every lane: no lane's bits may hang on its neighbours
_SWEEPS = 2  # contact and friction in turn, each by the other's latest; as many in every lane too

# All strict, so that the bits of a lane are the same in every place of every block.


@strict_inlined
def _number(number: Array, n: int, which: int) -> Vector:
    return load(number, n + LANES * which)


@strict_inlined
def _linear(number: Array, n: int, depth: Vector, rate: Vector) -> tuple[Vector, Vector]:
    """Force at the middle of the step, and its mean over the step."""
    zero, share = spread(0.0), _number(number, n, SHARE)
    k, viscous = _number(number, n, STIFFNESS), _number(number, n, DAMPING) * rate
    force = fused(k, depth, viscous) * share
    force = where_positive(depth, where_positive(force, force, zero), zero)  # the stop never pulls
    # Where the stop is met within the step, the mean is over what is behind that: the damper's force jumps.
    reach = rate * _number(number, n, HALF_STEP)  # m in half a step
    behind = depth + reach  # depth at the end of the step
    part = fused(k, spread(0.5) * behind, viscous) * share * (behind / (reach + reach))  # 0.5: mean depth
    part = where_positive(behind, part, zero)
    # Only on the way in: on the way out the force has come to zero by itself, without a jump.
    return force, where_positive(reach - magnitude(depth), part, force)


@strict_inlined
def _hertzian(number: Array, n: int, depth: Vector, rate: Vector) -> tuple[Vector, Vector]:
    """The same for F = K d^1.5 + c d', by Newton's method; the force enters d and d' at the middle itself."""
    zero, share = spread(0.0), _number(number, n, SHARE)
    k, viscous = _number(number, n, STIFFNESS), _number(number, n, DAMPING) * rate
    give, force = _number(number, n, GIVE), zero
    for _ in range(_NEWTON_STEPS):
        inner = fused_less(give, force, depth)
        inner = where_positive(inner, inner, zero)  # no root of a depth below zero
        stiffness = k * share * root(inner)
        excess = fused(stiffness, inner, viscous * share) - force
        force = force + excess / fused(spread(1.5) * stiffness, give, spread(1.0))  # by its slope
    force = where_positive(depth, where_positive(force, force, zero), zero)
    reach = rate * _number(number, n, HALF_STEP)
    behind = depth + reach
    behind = where_positive(behind, behind, zero)
    # 0.4 is the mean of x^1.5 over 0 to 1: the depth grows evenly.
    part = fused(k * root(behind), spread(0.4) * behind, viscous) * share * (behind / (reach + reach))
    return force, where_positive(reach - magnitude(depth), part, force)


@strict_inlined
def _contact(number: Array, n: int, gap: Vector, rate: Vector, hertzian: bool) -> tuple[Vector, Vector]:
    """Upper minus lower force in the middle of the step, and its mean over the step."""
    from_centre = gap + _number(number, n, CENTRE)
    depth = magnitude(from_centre) - _number(number, n, CLEARANCE)  # of the nearer stop
    rate = where_positive(from_centre, rate, spread(0.0) - rate)  # into that stop
    if hertzian:
        force, mean = _hertzian(number, n, depth, rate)
    else:
        force, mean = _linear(number, n, depth, rate)
    return signed(force, from_centre), signed(mean, from_centre)


@strict_inlined
def _friction(number: Array, n: int, spin: Vector, force: Vector) -> Vector:
    """The torque that stops the pivot by the end of the step, or all that there is."""
    most = _number(number, n, TORQUE)
    left = fused_less(_number(number, n, SPIN_BY_FORCE), force, spin)  # rad/s, were there no friction
    torque = left * _number(number, n, SPIN_STIFFNESS)
    return where_positive(magnitude(torque) - most, signed(most, torque), torque)


@strict_inlined
def _contact_with_friction(
    number: Array, n: int, gap: Vector, rate: Vector, spin: Vector, hertzian: bool
) -> tuple[Vector, Vector, Vector]:
    mean = spread(0.0)
    force = mean
    torque = _friction(number, n, spin, mean)
    for _ in range(_SWEEPS):
        moved = fused_less(_number(number, n, GAP_BY_TORQUE), torque, gap)
        moved_rate = fused_less(_number(number, n, RATE_BY_TORQUE), torque, rate)
        force, mean = _contact(number, n, moved, moved_rate, hertzian)
        torque = _friction(number, n, spin, mean)
    return force, mean, torque


@strict_inlined
def _turn(slot: Array, at: int, state: Array, y: int, slots: int, force: Vector) -> tuple[Vector, Vector]:
    """Take the slots over a step; return the gap and its rate at the end without what the force adds to them.

    So the next force need not wait for the sums to which this one contributes.
    """
    gap, rate = spread(0.0), spread(0.0)
    gap2, rate2 = gap, rate  # two chains of sums, so that neither waits for its own last addition
    for _ in range(0, slots, 2):  # `coefficients` makes their number even
        re, im = load(state, y), load(state, y + LANES)
        cos, sin = load(slot, at), load(slot, at + LANES)
        new_re, new_im = fused_less(sin, im, cos * re), fused(cos, im, sin * re)
        gap = gap + new_re
        rate = fused(load(slot, at + 4 * LANES), new_re, fused(load(slot, at + 5 * LANES), new_im, rate))
        store(state, y, fused(load(slot, at + 2 * LANES), force, new_re))
        store(state, y + LANES, fused(load(slot, at + 3 * LANES), force, new_im))
        at, y = at + PLAIN * LANES, y + 2 * LANES
        re, im = load(state, y), load(state, y + LANES)
        cos, sin = load(slot, at), load(slot, at + LANES)
        new_re, new_im = fused_less(sin, im, cos * re), fused(cos, im, sin * re)
        gap2 = gap2 + new_re
        rate2 = fused(load(slot, at + 4 * LANES), new_re, fused(load(slot, at + 5 * LANES), new_im, rate2))
        store(state, y, fused(load(slot, at + 2 * LANES), force, new_re))
        store(state, y + LANES, fused(load(slot, at + 3 * LANES), force, new_im))
        at, y = at + PLAIN * LANES, y + 2 * LANES
    return gap + gap2, rate + rate2


@strict_inlined
def _turn_with_friction(
    slot: Array, at: int, state: Array, y: int, slots: int, force: Vector, torque: Vector
) -> tuple[Vector, Vector, Vector]:
    """The same with a torque at the pivot; also return its rotation rate half a step later."""
    gap, rate, spin = spread(0.0), spread(0.0), spread(0.0)
    for _ in range(slots):
        re, im = load(state, y), load(state, y + LANES)
        cos, sin = load(slot, at), load(slot, at + LANES)
        push = fused(load(slot, at + TWIST_RE * LANES), torque, load(slot, at + PUSH_RE * LANES) * force)
        new_re = fused(cos, re, fused_less(sin, im, push))
        push = fused(load(slot, at + TWIST_IM * LANES), torque, load(slot, at + PUSH_IM * LANES) * force)
        new_im = fused(cos, im, fused(sin, re, push))
        store(state, y, new_re)
        store(state, y + LANES, new_im)
        gap = gap + new_re
        rate = fused(
            load(slot, at + RATE_RE * LANES), new_re, fused(load(slot, at + RATE_IM * LANES), new_im, rate)
        )
        spin = fused(
            load(slot, at + SPIN_RE * LANES), new_re, fused(load(slot, at + SPIN_IM * LANES), new_im, spin)
        )
        at, y = at + WITH_FRICTION * LANES, y + 2 * LANES
    return gap, rate, spin


@strict_inlined
def _accelerations(
    row: Array,
    row_gain: Array,
    g: int,
    state: Array,
    force: Vector,
    torque: Vector,
    buffer: Array,
    column: int,
) -> None:
    rows, slots = row.shape[1], row.shape[2]
    for r in range(rows):
        gain, at = 2 * (g * rows + r) * LANES, 2 * (g * rows + r) * slots * LANES
        y = 2 * g * slots * LANES
        # What the force does at once and in its half step; then what the motion without it does (m/s2).
        total = fused(load(row_gain, gain), force, load(row_gain, gain + LANES) * torque)
        for _ in range(slots):
            total = fused(load(row, at), load(state, y), total)
            total = fused(load(row, at + LANES), load(state, y + LANES), total)
            at, y = at + 2 * LANES, y + 2 * LANES
        store(buffer, column + (r + 1) * CHUNK * LANES, total)


@strict_inlined
def _deliver(buffer: Array, place: Index, first: int, last: int, start: int, count: int, out: Array) -> None:
    """Turn the samples of a chunk, which lie lane beside lane, into one run of samples for each lane."""
    rows, steps = out.shape[1], out.shape[2]
    for line in range((last - first) * buffer.shape[1]):
        g, r = first + line // buffer.shape[1], line % buffer.shape[1]
        for k in range(0, count, LANES):
            tile = (line * CHUNK + k) * LANES
            transpose(buffer, tile)
            for lane in range(LANES):
                to = place[g * LANES + lane]
                if to >= 0 and count - k >= LANES:  # -1 is a lane that only fills its group
                    store(out, (to * rows + r) * steps + start + k, load(buffer, tile + lane * LANES))
                elif to >= 0:  # a whole vector would run over into the next row of `out`
                    for j in range(count - k):
                        out[to, r, start + k + j] = buffer[g - first, r, k + lane, j]


@strict
def advance(
    slot: Array, row: Array | None, row_gain: Array | None, number: Array, state: Array, scalar: Array,
    buffer: Array, place: Index, hertzian: bool, out: Array,
) -> None:  # fmt: skip
    """Advance all groups by out.shape[2] steps, as many at once as `buffer` has room for.

    Shapes, the last axis being the lane: slot (groups, slots, 6 or 10, 8), row (groups, rows, slots, 2, 8),
    row_gain (groups, rows, 2, 8), number (groups, NUMBERS, 8), state (groups, slots, 2, 8), scalar (groups,
    SCALARS, 8), buffer (groups at once, 1 + rows, CHUNK, 8). row and row_gain are None where only the force
    is recorded. `place` (groups 8,) is where each lane stands in `out` (lanes, 1 + rows, steps), -1: padding.
    """
    groups, slots, friction = slot.shape[0], slot.shape[1], slot.shape[2] == WITH_FRICTION
    width, lines, steps = slot.shape[2] * LANES, buffer.shape[1], out.shape[2]
    for first in range(0, groups, buffer.shape[0]):  # these fit the first cache: all their steps first
        last = min(first + buffer.shape[0], groups)
        for start in range(0, steps, CHUNK):
            count = min(CHUNK, steps - start)
            for k in range(count):
                for g in range(first, last):  # independent chains, which the processor overlaps
                    n, sc, y = g * NUMBERS * LANES, g * SCALARS * LANES, g * slots * 2 * LANES
                    column = ((g - first) * lines * CHUNK + k) * LANES
                    gap, rate, torque = load(scalar, sc), load(scalar, sc + RATE * LANES), spread(0.0)
                    if friction:
                        spin = load(scalar, sc + SPIN * LANES)
                        force, mean, torque = _contact_with_friction(number, n, gap, rate, spin, hertzian)
                        if row is not None and row_gain is not None:
                            # before the slots go on: rows and force are both of the middle of this step
                            _accelerations(row, row_gain, g, state, force, torque, buffer, column)
                        gap, rate, spin = _turn_with_friction(
                            slot, g * slots * width, state, y, slots, mean, torque
                        )
                        store(scalar, sc + SPIN * LANES, spin)
                    else:
                        force, mean = _contact(number, n, gap, rate, hertzian)
                        if row is not None and row_gain is not None:
                            _accelerations(row, row_gain, g, state, force, torque, buffer, column)
                        gap, rate = _turn(slot, g * slots * width, state, y, slots, mean)
                        gap = fused(_number(number, n, GAP_AFTER_FORCE), mean, gap)
                        rate = fused(_number(number, n, RATE_AFTER_FORCE), mean, rate)
                    store(buffer, column, force)
                    store(scalar, sc, gap)
                    store(scalar, sc + RATE * LANES, rate)
            if start % _SETTLE_EVERY == 0:
                # Modes that have died out would reach the denormal numbers, which cost far more than others.
                for at in range(first * slots * 2 * LANES, last * slots * 2 * LANES, LANES):
                    value = load(state, at)
                    store(state, at, where_positive(spread(_FADED) - magnitude(value), spread(0.0), value))
            _deliver(buffer, place, first, last, start, count, out)
