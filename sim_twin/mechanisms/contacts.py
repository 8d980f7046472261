"""Contacts in a step: where one begins, the largest force in it, and which have ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim_twin.compiled import generic, mechanical
from sim_twin.mechanisms.dormand_prince import LATE, Rates, attempt, dense, set_dense
from sim_twin.mechanisms.run import APPROACH, CONTACT, END, EPISODES, ONSET, PEAK, Real, Run, StepLimits

Depths = Callable[..., None]
"""depths(p, t, y, d, rate)"""
NO_ONSET = 2.0
BISECTIONS, SECANTS, RETAKES = 12, 40, 12
_LOOKS = 3
_LOOSE, _EDGE, _NEAR = 0.2, 0.1, 0.02
"""Fractions of a step: how far outside it a stage may show a summit that is looked for; where, then, at the
least from its ends; and the advance that ends the search."""


@generic
def first_onset(depths: Depths, p: Any, run: Run, reach: float, t: float, h: float) -> float:
    """Fraction of the step at which the first open contact begins to overlap, NO_ONSET if none does."""
    first = NO_ONSET
    for j in range(run.latched.size):
        if run.latched[j] > 0.0:
            continue
        if run.new_penetration[j] > 0.0:
            first = min(first, _crossing(depths, p, run, reach, t, h, j, 1.0, run.new_penetration[j]))
        elif _may_overlap(run, j, h):
            # bisection for the deepest point, up to the first overlap found on the way
            low, high, x, d = 0.0, 1.0, 0.5, -1.0
            for _ in range(BISECTIONS):
                x = 0.5 * (low + high)
                d = _depth_at(depths, p, run, t, h, j, x)
                if d > 0.0:
                    break
                if run.sought_rate[j] > 0.0:
                    low = x
                else:
                    high = x
            if d > 0.0:
                first = min(first, _crossing(depths, p, run, reach, t, h, j, x, d))
    return first


@mechanical
def may_touch(run: Run, h: float) -> bool:
    """Whether any open contact overlaps at the end of the step of `h` s, or may do so within it."""
    for j in range(run.latched.size):
        if run.latched[j] == 0.0 and (run.new_penetration[j] > 0.0 or _may_overlap(run, j, h)):
            return True
    return False


@mechanical
def may_overlap(d: float, rate: float, new_d: float, new_rate: float, h: float) -> bool:
    """Whether a depth with these ends and rates may be above zero within a step of `h` s."""
    # Near its summit the depth is concave, so it stays under both its tangents.
    if rate <= 0.0 or new_rate >= 0.0:
        return False
    return bool(d + rate * (new_d - d - new_rate * h) / (rate - new_rate) > 0.0)


@mechanical
def _may_overlap(run: Run, j: int, h: float) -> bool:
    return may_overlap(run.penetration[j], run.rate[j], run.new_penetration[j], run.new_rate[j], h)


@generic
def _depth_at(depths: Depths, p: Any, run: Run, t: float, h: float, j: int, x: float) -> float:
    dense(run.dense, x, run.between)
    depths(p, t + x * h, run.between, run.sought_penetration, run.sought_rate)
    return float(run.sought_penetration[j])


@generic
def _crossing(
    depths: Depths, p: Any, run: Run, reach: float, t: float, h: float, j: int, x: float, d: float
) -> float:
    """Fraction up to `x`, where the depth is `d` > 0, at which it is above zero and below `reach`.

    Illinois' regula falsi for half the reach: aiming at zero, it would stop at once where a contact has only
    just ended, and the run with it.
    """
    aim = 0.5 * reach
    low, d_low, high, d_high = 0.0, min(run.penetration[j], 0.0) - aim, x, d - aim
    side = 0
    for _ in range(SECANTS):
        if d_high < aim:
            break
        x = low + (high - low) * d_low / (d_low - d_high)
        d = _depth_at(depths, p, run, t, h, j, x) - aim
        if d > -aim:
            high, d_high = x, d
            d_low = 0.5 * d_low if side == 1 else d_low
            side = 1
        else:
            low, d_low = x, d
            d_high = 0.5 * d_high if side == -1 else d_high
            side = -1
    return high


@generic
def refine_onset(
    rates: Rates, depths: Depths, p: Any, run: Run, reach: float, t: float, h: float, longest: float
) -> float:
    """Take the step again up to the onset, near `h` s, until the deepest new overlap is within `reach`."""
    for tried in range(RETAKES):
        attempt(rates, p, run, t, h)
        depths(p, t + h, run.trial, run.new_penetration, run.new_rate)
        deepest = -1
        for j in range(run.latched.size):
            if run.latched[j] == 0.0 and (
                deepest < 0 or run.new_penetration[j] > run.new_penetration[deepest]
            ):
                deepest = j
        d, rate = run.new_penetration[deepest], run.new_rate[deepest]
        if 0.0 < d < reach or rate <= 0.0 or tried + 1 == RETAKES:
            break
        h = min(longest, max(0.0, h - (d - 0.5 * reach) / rate))
    return h


@generic
def follow_peaks(rates: Rates, p: Any, run: Run, t: float, h: float) -> None:
    """Raise the peaks of the contacts to the largest force in the step of `h` s, which is not yet accepted.

    A force of one of its stages tells whether it has a summit; the dense output then tells where.
    """
    for j in range(run.latched.size):
        if run.latched[j] == 0.0:
            continue
        peak = max(run.open_episode[j, PEAK], run.force[j], run.new_force[j])
        x, top = summit(run.force[j], LATE, run.late_force[j], run.new_force[j])
        if -_LOOSE < x < 1.0 + _LOOSE and top > peak:
            set_dense(run, h)
            x = min(max(x, _EDGE), 1.0 - _EDGE)
            for _ in range(_LOOKS):  # each at the parabola's new summit
                dense(run.dense, x, run.between)
                # The second slope of a step is not needed any more.
                rates(p, t + x * h, run.between, run.latched, run.slopes[1], run.sought_force)
                peak = max(peak, run.sought_force[j])
                before = x
                x, _top = summit(run.force[j], x, run.sought_force[j], run.new_force[j])
                if not 0.0 < x < 1.0 or abs(x - before) < _NEAR:
                    break
        run.open_episode[j, PEAK] = peak


@mechanical
def summit(y0: float, x: float, y: float, y1: float) -> tuple[float, float]:
    """Where the parabola through (0, y0), (x, y), (1, y1) is highest, and how high; -1 if it is not."""
    rise, chord = (y - y0) / x, y1 - y0
    bend = (chord - rise) / (1.0 - x)
    slope = chord - bend
    if bend >= 0.0:
        return -1.0, 0.0
    return -0.5 * slope / bend, y0 - 0.25 * slope * slope / bend


@mechanical
def latch_overlaps(run: Run, floor: float, t: float) -> bool:
    """Latch the approach speed (at least `floor`) of open contacts that overlap; True if there are any."""
    begun = False
    for j in range(run.latched.size):
        if run.latched[j] == 0.0 and run.penetration[j] > 0.0:
            run.latched[j] = max(run.rate[j], floor)
            run.open_episode[j, ONSET] = t
            run.open_episode[j, CONTACT] = j
            run.open_episode[j, APPROACH] = run.rate[j]
            run.open_episode[j, PEAK] = 0.0
            begun = True
    return begun


@mechanical
def follow_contacts(run: Run, limits: StepLimits, t: float, episodes: Real) -> tuple[bool, bool]:
    """Open the contacts that have come apart, latch the new ones; whether any has begun and any ended."""
    ended = False
    for j in range(run.latched.size):
        d = run.penetration[j]
        if run.latched[j] > 0.0 and d <= 0.0 and (run.rate[j] <= 0.0 or d < -limits.reach):
            run.latched[j] = 0.0
            run.open_episode[j, END] = t
            row = run.counts[EPISODES]
            if row < episodes.shape[0]:
                for column in range(episodes.shape[1]):
                    episodes[row, column] = run.open_episode[j, column]
            run.counts[EPISODES] = row + 1
            ended = True
    return latch_overlaps(run, limits.floor, t), ended
