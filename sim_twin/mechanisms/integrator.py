"""Adaptive integration of any mechanism with intermittent contacts, inside one compiled loop.

A mechanism is three compiled functions of its parameters p (a NamedTuple or an array), generic over both:

    rates(p, t, y, v0, dy, force)      dy/dt, and the normal force of every contact (N)
    depths(p, t, y, d, rate)           penetration of every contact (m, positive: overlap) and its rate (m/s)
    observe(p, t, y, v0, out, column)  outputs at one instant, to out[:, column]

v0[j] > 0: contact j touches, and approached at v0[j]; 0: it does not, and exerts nothing. Each rig has a
compiled entry that calls `integrate` with its own three.

A step that ends in a new overlap, or passes through one, is cut where the overlap begins, to within
`limits.reach` (rule: 10.1007/s11044-010-9209-8). A contact ends where its penetration returns to zero; the
step then is again what it was before the contact. Steps do not end at samples, which come from the dense
output: so a run in blocks is, bit by bit, the run in one go.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Any

from sim_twin.compiled import generic, mechanical
from sim_twin.mechanisms.contacts import (
    Depths,
    first_onset,
    follow_contacts,
    follow_peaks,
    latch_overlaps,
    may_touch,
    refine_onset,
)
from sim_twin.mechanisms.dormand_prince import Rates, attempt, dense, set_dense, squared_error
from sim_twin.mechanisms.run import (
    BEFORE,
    EPISODES,
    ERROR,
    NOW,
    REJECTED,
    SAMPLES,
    STARTED,
    STEP,
    STEP_BEFORE_ONSET,
    STEPS,
    Real,
    Run,
    StepLimits,
)

Observe = Callable[..., None]
COMPLETED, DIVERGED, STEPS_EXHAUSTED = range(3)
"""Values of status.Status."""
_SAFETY, _MOST_SHRINK, _MOST_GROWTH = 0.9, 0.2, 6.0
_EXPONENT, _LEAST_ERROR, FRESH_ERROR = 0.04, 1e-8, 1e-4


@generic
def integrate(
    rates: Rates, depths: Depths, observe: Observe, p: Any, run: Run, limits: StepLimits, dt: float,
    out: Real, episodes: Real,
) -> int:  # fmt: skip
    """Fill `out` (outputs, count) with the next samples, `dt` s apart; sample 0 of the run is t = 0.

    Contacts that end go to the rows of `episodes` (room, 5), counted in `run.counts` past its end too.
    Returns COMPLETED, DIVERGED or STEPS_EXHAUSTED; columns that were not reached are left alone.
    """
    counts, clock = run.counts, run.clock
    if counts[STARTED] == 0:
        _start(rates, depths, p, run, limits)
    counts[EPISODES] = 0
    first, column, tries = counts[SAMPLES], 0, 0
    while True:
        while column < out.shape[1] and (first + column) * dt <= clock[NOW]:
            t, span = (first + column) * dt, clock[NOW] - clock[BEFORE]
            dense(run.dense, (t - clock[BEFORE]) / span if span > 0.0 else 0.0, run.trial)
            observe(p, t, run.trial, run.during, out, column)
            column += 1
        counts[SAMPLES] = first + column
        # The present, which is the next sample, has to lie in the last step too.
        present = (first + column) * dt
        if column == out.shape[1] and present <= clock[NOW]:
            return COMPLETED
        if tries >= limits.budget:
            return STEPS_EXHAUSTED
        tries += 1
        if not _advance(rates, depths, p, run, limits, present, episodes):
            return DIVERGED


@generic
def _start(rates: Rates, depths: Depths, p: Any, run: Run, limits: StepLimits) -> None:
    t = run.clock[NOW]
    depths(p, t, run.y, run.penetration, run.rate)
    latch_overlaps(run, limits.floor, t)
    for j in range(run.latched.size):
        run.during[j] = run.latched[j]
    rates(p, t, run.y, run.latched, run.slopes[0], run.force)
    run.clock[BEFORE] = t
    for i in range(run.y.size):
        run.dense[0, i] = run.y[i]
        for row in range(1, run.dense.shape[0]):
            run.dense[row, i] = 0.0
    run.counts[STARTED] = 1


@generic
def _advance(
    rates: Rates, depths: Depths, p: Any, run: Run, limits: StepLimits, present: float, episodes: Real
) -> bool:
    """Take one step, or shorten it; False if the motion has left all bounds."""
    clock, counts = run.clock, run.counts
    t, h = clock[NOW], min(clock[STEP], limits.longest)
    attempt(rates, p, run, t, h)
    error = squared_error(run.slopes, h, limits.tolerance)
    if not isfinite(error) or error > 1.0:
        clock[STEP] = shorter_step(error, h)
        counts[REJECTED] += 1
        return bool(h > limits.shortest)
    depths(p, t + h, run.trial, run.new_penetration, run.new_rate)
    clock[ERROR], clock[STEP] = next_step(error, clock[ERROR], h)
    if may_touch(run, h):
        set_dense(run, h)
        x = first_onset(depths, p, run, limits.reach, t, h)
        if x <= 1.0:
            clock[STEP_BEFORE_ONSET] = clock[STEP]
            h = refine_onset(rates, depths, p, run, limits.reach, t, x * h, h)
    if present <= t + h:
        set_dense(run, h)
    follow_peaks(rates, p, run, t, h)
    _accept(rates, p, run, limits, t, h, episodes)
    return True


@mechanical
def shorter_step(error: float, h: float) -> float:
    """The step in s after one of `h` s whose squared error is above 1, or none."""
    return h * max(_MOST_SHRINK, _SAFETY * error**-0.1) if isfinite(error) else _MOST_SHRINK * h


@mechanical
def next_step(error: float, before: float, h: float) -> tuple[float, float]:
    """The squared error to go on with, and the step in s after one of `h` s that had it, and one `before`.

    PI control (Hairer, Norsett and Wanner II, IV.2) on the squared error: error^-0.08 before^0.02.
    """
    error = max(error, _LEAST_ERROR)
    power = (before / (error * error * error * error)) ** (0.5 * _EXPONENT)
    return error, h * min(_MOST_GROWTH, max(_MOST_SHRINK, _SAFETY * power))


@generic
def _accept(
    rates: Rates, p: Any, run: Run, limits: StepLimits, t: float, h: float, episodes: Real
) -> None:  # fmt: skip
    clock = run.clock
    clock[BEFORE], clock[NOW] = t, t + h
    for i in range(run.y.size):
        run.y[i] = run.trial[i]
        run.slopes[0, i] = run.slopes[6, i]
    for j in range(run.latched.size):
        run.during[j] = run.latched[j]
        run.penetration[j], run.rate[j] = run.new_penetration[j], run.new_rate[j]
        run.force[j] = run.new_force[j]
    run.counts[STEPS] += 1
    begun, ended = follow_contacts(run, limits, t + h, episodes)
    if ended:
        clock[STEP] = max(clock[STEP], clock[STEP_BEFORE_ONSET])
    if begun:
        clock[STEP] = min(clock[STEP], limits.after_onset)
    if begun or ended:
        clock[ERROR] = FRESH_ERROR
        rates(p, t + h, run.y, run.latched, run.slopes[0], run.force)
