"""Eight runs of a mechanism side by side, each with its own time, step and contacts, in one compiled loop.

A rig's functions are those that `integrator` takes, here of vectors; so are the steps and the rules by which
they are chosen, cut at an onset and taken again. A lane whose step is not accepted stands while the others go
on. No lane's bits hang on its neighbours. Only what is observed comes out, no list of contacts.
"""

from __future__ import annotations

from math import isfinite
from typing import Any

from sim_twin.compiled import generic, mechanical
from sim_twin.lane_array import all_in_lanes, in_lanes
from sim_twin.mechanisms.contacts import BISECTIONS, NO_ONSET, RETAKES, SECANTS, Depths, may_overlap
from sim_twin.mechanisms.dormand_prince import Rates, attempt, dense, set_dense, squared_error
from sim_twin.mechanisms.integrator import (
    DIVERGED,
    FRESH_ERROR,
    STEPS_EXHAUSTED,
    Observe,
    next_step,
    shorter_step,
)
from sim_twin.mechanisms.lane_run import (
    AT,
    BEFORE,
    ERROR,
    FIRST,
    GOING,
    HIGH,
    HIGH_DEPTH,
    LOW,
    LOW_DEPTH,
    NOW,
    PHASE,
    REACHED,
    RETAKEN,
    SAMPLES,
    SEEKS,
    SIDE,
    SPARE,
    SQUARED,
    STEP,
    STEP_BEFORE_ONSET,
    TRIED,
    TRIES,
    WHOLE,
    LaneRun,
    Lanes,
)
from sim_twin.mechanisms.run import Real, StepLimits
from sim_twin.vector import LANES, repeated, store, where_positive

_NOTHING, _SUMMIT, _CROSSING = range(3)


@generic
def begin_lanes(rates: Rates, depths: Depths, p: Any, run: LaneRun, limits: StepLimits) -> None:
    """Set up runs that are at their first state."""
    at = all_in_lanes(run)
    depths(p, at.clock[NOW], at.y, at.penetration, at.rate)
    for lane in range(LANES):
        _follow_contacts(run, limits, lane)
    for j in range(run.latched.shape[0]):
        at.during[j] = at.latched[j]
    rates(p, at.clock[NOW], at.y, at.latched, at.slopes[0], at.new_force)
    for i in range(run.y.shape[0]):
        at.kept[0, i] = at.y[i]


@generic
def advance_lanes(
    rates: Rates, depths: Depths, observe: Observe, like: Any, table: Lanes, each: Lanes, run: LaneRun,
    limits: StepLimits, dt: float, first: int, out: Real,
) -> None:  # fmt: skip
    """Fill `out` (8, outputs, count + SPARE) with the samples from `first` on, `dt` s apart; 0 is at t = 0.

    `table` (rows, 8) are parameters as `packed`; `each` (8, rows, 8) has those of one lane in all places,
    `like` are those of one run. A lane that fails has its status in `run.counts[GOING]`, negative, and leaves
    the columns alone that it did not reach.
    """
    p, at = in_lanes(table, like), all_in_lanes(run)
    count = out.shape[2] - SPARE
    for lane in range(LANES):
        if run.counts[GOING, lane] >= 0:
            run.counts[GOING, lane], run.counts[TRIES, lane] = 1, 0
    while True:
        going = False
        for lane in range(LANES):
            if run.counts[GOING, lane] == 1:
                _observe(observe, in_lanes(each[lane], like), run, at, lane, first, dt, out)
                if run.counts[SAMPLES, lane] == first + count:
                    run.counts[GOING, lane] = 0
                elif run.counts[TRIES, lane] >= limits.budget:
                    run.counts[GOING, lane] = -STEPS_EXHAUSTED
                run.counts[TRIES, lane] += run.counts[RETAKEN, lane] == 0
            going = going or run.counts[GOING, lane] == 1
        if not going:
            return
        _advance(rates, depths, p, run, at, limits)


@generic
def _observe(
    observe: Observe, p: Any, run: LaneRun, at: Any, lane: int, first: int, dt: float, out: Real
) -> None:
    """Take the states at the samples of a lane's last step, and give samples once there are eight.

    What lies beyond the step comes with the next.
    """
    before, now = run.clock[BEFORE, lane], run.clock[NOW, lane]
    steepness = 1.0 / (now - before) if now > before else 0.0
    states, row_length = run.y.shape[0], out.shape[2]
    number, end = run.counts[REACHED, lane], first + row_length - SPARE
    while number < end and number * dt <= now:
        due = number - (number - first) % LANES  # the first of these eight
        numbers = at.shown[0, 0]
        t, later = (due + numbers) * dt, numbers - (number - due) + 0.5  # positive from `number` on
        x = (t - before) * steepness
        rest = 1.0 - x
        for i in range(states):
            c, row = i * LANES + lane, states * LANES
            bend = repeated(run.kept, c + 3 * row) + rest * repeated(run.kept, c + 4 * row)
            curve = repeated(run.kept, c + row) + rest * (repeated(run.kept, c + 2 * row) + x * bend)
            state = repeated(run.kept, c) + x * curve
            at.sampled[lane, i] = where_positive(later, state, at.sampled[lane, i])
        for j in range(run.latched.shape[0]):
            latched = repeated(run.during, j * LANES + lane)
            at.sampled_latched[lane, j] = where_positive(later, latched, at.sampled_latched[lane, j])
        while number < min(due + LANES, end) and number * dt <= now:
            number += 1
        if number == due + LANES or number == end:
            observe(p, t, at.sampled[lane], at.sampled_latched[lane], at.shown, 1)
            for row in range(out.shape[1]):
                store(out, (lane * out.shape[1] + row) * row_length + due - first, at.shown[row, 1])
            run.counts[SAMPLES, lane] = number
    run.counts[REACHED, lane] = number


@generic
def _advance(rates: Rates, depths: Depths, p: Any, run: LaneRun, at: Any, limits: StepLimits) -> None:
    """Try one step in every lane, and go on where it is accepted."""
    t, h = at.clock[NOW], at.clock[TRIED]
    attempt(rates, p, at, t, h)
    at.clock[SQUARED] = squared_error(at.slopes, h, at.tolerance)
    depths(p, t + h, at.trial, at.new_penetration, at.new_rate)
    set_dense(at, h)
    sought = False
    for lane in range(LANES):
        run.accepted[0, lane], run.changed[0, lane], run.counts[SEEKS, lane] = 0.0, 0.0, 0
        if run.counts[GOING, lane] == 1:
            if run.counts[RETAKEN, lane] > 0:
                _judge_retaken(run, limits, lane)
            else:
                _judge(run, limits, lane)
            sought = sought or run.counts[SEEKS, lane] == 1
    if sought:
        _seek_onsets(depths, p, run, at, limits)
    _accept(run, at, t, h)
    if _touch_and_part(run, limits):
        rates(p, at.clock[NOW], at.y, at.latched, at.slopes[1], at.new_force)
        for i in range(run.y.shape[0]):
            at.slopes[0, i] = where_positive(at.changed[0], at.slopes[1, i], at.slopes[0, i])


@mechanical
def _touch_and_part(run: LaneRun, limits: StepLimits) -> bool:
    """After the accepted steps: whether any contact has begun or ended, in lanes that are `changed` then."""
    any_changed = False
    for lane in range(LANES):
        if run.accepted[0, lane] > 0.0:
            begun, ended = _follow_contacts(run, limits, lane)
            step = run.clock[STEP, lane]
            if ended:
                step = max(step, run.clock[STEP_BEFORE_ONSET, lane])
            if begun:
                step = min(step, limits.after_onset)
            if begun or ended:
                run.clock[ERROR, lane], run.changed[0, lane] = FRESH_ERROR, 1.0
                any_changed = True
            run.clock[STEP, lane] = step
            run.clock[TRIED, lane] = min(step, limits.longest)
    return any_changed


@mechanical
def _judge(run: LaneRun, limits: StepLimits, lane: int) -> None:
    """Accept the step of a lane, or have it taken again shorter; say whether an onset may lie in it."""
    clock, h, error = run.clock, run.clock[TRIED, lane], run.clock[SQUARED, lane]
    if not isfinite(error) or error > 1.0:
        clock[STEP, lane] = clock[TRIED, lane] = shorter_step(error, h)
        if h <= limits.shortest:
            run.counts[GOING, lane] = -DIVERGED
        return
    clock[ERROR, lane], clock[STEP, lane] = next_step(error, clock[ERROR, lane], h)
    run.accepted[0, lane] = 1.0
    for j in range(run.latched.shape[0]):
        if run.latched[j, lane] == 0.0 and (run.new_penetration[j, lane] > 0.0 or _may_overlap(run, j, lane)):
            run.counts[SEEKS, lane] = 1


@mechanical
def _may_overlap(run: LaneRun, j: int, lane: int) -> bool:
    d, rate, h = run.penetration[j, lane], run.rate[j, lane], run.clock[TRIED, lane]
    return may_overlap(d, rate, run.new_penetration[j, lane], run.new_rate[j, lane], h)


@mechanical
def _judge_retaken(run: LaneRun, limits: StepLimits, lane: int) -> None:
    """Accept a step that ends in a new overlap within `reach`, or move its end there."""
    deepest = -1
    for j in range(run.latched.shape[0]):
        if run.latched[j, lane] == 0.0 and (
            deepest < 0 or run.new_penetration[j, lane] > run.new_penetration[deepest, lane]
        ):
            deepest = j
    d, rate, h = run.new_penetration[deepest, lane], run.new_rate[deepest, lane], run.clock[TRIED, lane]
    if 0.0 < d < limits.reach or rate <= 0.0 or run.counts[RETAKEN, lane] == RETAKES:
        run.accepted[0, lane], run.counts[RETAKEN, lane] = 1.0, 0
        return
    run.clock[TRIED, lane] = min(run.clock[WHOLE, lane], max(0.0, h - (d - 0.5 * limits.reach) / rate))
    run.counts[RETAKEN, lane] += 1


@generic
def _seek_onsets(depths: Depths, p: Any, run: LaneRun, at: Any, limits: StepLimits) -> None:
    """Have steps in which a contact begins taken again up to there, as `contacts.first_onset` finds it."""
    for lane in range(LANES):
        run.sought[FIRST, lane] = NO_ONSET
    for j in range(run.latched.shape[0]):
        _begin_search(run, j)
        for _ in range(BISECTIONS):
            if not _halved(run):
                break
            _depths_at(depths, p, at)
            _look_for_overlap(run, j)
        _aim(run, limits, j)
        for _ in range(SECANTS):
            if not _between_ends(run, limits):
                break
            _depths_at(depths, p, at)
            _narrow(run, limits, j)
        for lane in range(LANES):
            if run.counts[PHASE, lane] == _CROSSING:
                run.sought[FIRST, lane] = min(run.sought[FIRST, lane], run.sought[HIGH, lane])
    _cut(run)


@mechanical
def _cut(run: LaneRun) -> None:
    """Have the steps with an onset tried again up to it."""
    clock = run.clock
    for lane in range(LANES):
        if run.sought[FIRST, lane] <= 1.0:
            clock[STEP_BEFORE_ONSET, lane], clock[WHOLE, lane] = clock[STEP, lane], clock[TRIED, lane]
            clock[TRIED, lane] *= run.sought[FIRST, lane]
            run.accepted[0, lane], run.counts[RETAKEN, lane] = 0.0, 1


@mechanical
def _begin_search(run: LaneRun, j: int) -> None:
    """What is looked for of a contact in each lane: where it crosses zero, or its deepest point first."""
    for lane in range(LANES):
        run.counts[PHASE, lane] = _NOTHING
        if run.counts[SEEKS, lane] == 1 and run.latched[j, lane] == 0.0:
            run.sought[LOW, lane], run.sought[HIGH, lane] = 0.0, 1.0
            run.sought[HIGH_DEPTH, lane] = run.new_penetration[j, lane]
            if run.new_penetration[j, lane] > 0.0:
                run.counts[PHASE, lane] = _CROSSING
            elif _may_overlap(run, j, lane):
                run.counts[PHASE, lane] = _SUMMIT


@generic
def _depths_at(depths: Depths, p: Any, at: Any) -> None:
    x = at.sought[AT]
    dense(at.dense, x, at.between)
    depths(p, at.clock[NOW] + x * at.clock[TRIED], at.between, at.sought_penetration, at.sought_rate)


@mechanical
def _halved(run: LaneRun) -> bool:
    """Whether there is a lane whose deepest point is still looked for, between two places."""
    any_left = False
    for lane in range(LANES):
        run.sought[AT, lane] = 0.5 * (run.sought[LOW, lane] + run.sought[HIGH, lane])
        any_left = any_left or run.counts[PHASE, lane] == _SUMMIT
    return any_left


@mechanical
def _look_for_overlap(run: LaneRun, j: int) -> None:
    sought = run.sought
    for lane in range(LANES):
        if run.counts[PHASE, lane] == _SUMMIT:
            if run.sought_penetration[j, lane] > 0.0:
                run.counts[PHASE, lane] = _CROSSING
                sought[LOW, lane], sought[HIGH, lane] = 0.0, sought[AT, lane]
                sought[HIGH_DEPTH, lane] = run.sought_penetration[j, lane]
            elif run.sought_rate[j, lane] > 0.0:
                sought[LOW, lane] = sought[AT, lane]
            else:
                sought[HIGH, lane] = sought[AT, lane]


@mechanical
def _aim(run: LaneRun, limits: StepLimits, j: int) -> None:
    aim = 0.5 * limits.reach
    for lane in range(LANES):
        run.sought[LOW_DEPTH, lane] = min(run.penetration[j, lane], 0.0) - aim
        run.sought[HIGH_DEPTH, lane] -= aim
        run.counts[SIDE, lane] = 0


@mechanical
def _between_ends(run: LaneRun, limits: StepLimits) -> bool:
    """Whether there is a lane whose crossing is not found; where the line between its ends crosses."""
    any_left = False
    sought = run.sought
    for lane in range(LANES):
        if run.counts[PHASE, lane] == _CROSSING and sought[HIGH_DEPTH, lane] >= 0.5 * limits.reach:
            low, low_depth, high_depth = sought[LOW, lane], sought[LOW_DEPTH, lane], sought[HIGH_DEPTH, lane]
            sought[AT, lane] = low + (sought[HIGH, lane] - low) * low_depth / (low_depth - high_depth)
            any_left = True
        else:
            sought[AT, lane] = sought[HIGH, lane]
    return any_left


@mechanical
def _narrow(run: LaneRun, limits: StepLimits, j: int) -> None:
    """Illinois' regula falsi: put the nearer end to where the depth was looked at."""
    sought, aim = run.sought, 0.5 * limits.reach
    for lane in range(LANES):
        if run.counts[PHASE, lane] == _CROSSING and sought[HIGH_DEPTH, lane] >= aim:
            d, side = run.sought_penetration[j, lane] - aim, run.counts[SIDE, lane]
            if d > -aim:
                sought[HIGH, lane], sought[HIGH_DEPTH, lane] = sought[AT, lane], d
                sought[LOW_DEPTH, lane] *= 0.5 if side == 1 else 1.0
                run.counts[SIDE, lane] = 1
            else:
                sought[LOW, lane], sought[LOW_DEPTH, lane] = sought[AT, lane], d
                sought[HIGH_DEPTH, lane] *= 0.5 if side == -1 else 1.0
                run.counts[SIDE, lane] = -1


@mechanical
def _accept(run: LaneRun, at: Any, t: Any, h: Any) -> None:
    """Take over what was computed in the lanes whose step is accepted."""
    yes = at.accepted[0]
    for i in range(run.y.shape[0]):
        at.y[i] = where_positive(yes, at.trial[i], at.y[i])
        at.slopes[0, i] = where_positive(yes, at.slopes[6, i], at.slopes[0, i])
        for row in range(run.kept.shape[0]):
            at.kept[row, i] = where_positive(yes, at.dense[row, i], at.kept[row, i])
    for j in range(run.latched.shape[0]):
        at.during[j] = where_positive(yes, at.latched[j], at.during[j])
        at.penetration[j] = where_positive(yes, at.new_penetration[j], at.penetration[j])
        at.rate[j] = where_positive(yes, at.new_rate[j], at.rate[j])
    at.clock[BEFORE] = where_positive(yes, t, at.clock[BEFORE])
    at.clock[NOW] = where_positive(yes, t + h, at.clock[NOW])


@mechanical
def _follow_contacts(run: LaneRun, limits: StepLimits, lane: int) -> tuple[bool, bool]:
    """Open the contacts of a lane that have come apart, latch the new ones; whether any begun, any ended."""
    begun = ended = False
    for j in range(run.latched.shape[0]):
        d, rate = run.penetration[j, lane], run.rate[j, lane]
        if run.latched[j, lane] > 0.0:
            if d <= 0.0 and (rate <= 0.0 or d < -limits.reach):
                run.latched[j, lane] = 0.0
                ended = True
        elif d > 0.0:
            run.latched[j, lane] = max(rate, run.floor[lane])
            begun = True
    return begun, ended
