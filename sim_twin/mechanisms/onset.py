"""Where in a step a contact begins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim_twin.mechanisms.dormand_prince import Rates, attempt, dense
from sim_twin.mechanisms.generic import generic, mechanical
from sim_twin.mechanisms.run import Run

Depths = Callable[..., None]
"""depths(p, t, y, d, rate)"""
NO_ONSET = 2.0
_BISECTIONS, _SECANTS, _RETAKES = 12, 40, 12


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
            x, d = _summit(depths, p, run, t, h, j)
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
def _may_overlap(run: Run, j: int, h: float) -> bool:
    # Near its summit the depth is concave, so it stays under both its tangents.
    d, rate, new_rate = run.penetration[j], run.rate[j], run.new_rate[j]
    if rate <= 0.0 or new_rate >= 0.0:
        return False
    bound = d + rate * (run.new_penetration[j] - d - new_rate * h) / (rate - new_rate)
    return bool(bound > 0.0)


@generic
def _depth_at(depths: Depths, p: Any, run: Run, t: float, h: float, j: int, x: float) -> float:
    dense(run.dense, x, run.between)
    depths(p, t + x * h, run.between, run.sought_penetration, run.sought_rate)
    return float(run.sought_penetration[j])


@generic
def _summit(depths: Depths, p: Any, run: Run, t: float, h: float, j: int) -> tuple[float, float]:
    """Fraction and depth of the first overlap found on the way to the deepest point, else of that point."""
    low, high, x, d = 0.0, 1.0, 0.5, -1.0
    for _ in range(_BISECTIONS):
        x = 0.5 * (low + high)
        d = _depth_at(depths, p, run, t, h, j, x)
        if d > 0.0:
            break
        if run.sought_rate[j] > 0.0:
            low = x
        else:
            high = x
    return x, d


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
    for _ in range(_SECANTS):
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
    for _ in range(_RETAKES):
        attempt(rates, p, run, t, h)
        depths(p, t + h, run.trial, run.new_penetration, run.new_rate)
        deepest = -1
        for j in range(run.latched.size):
            if run.latched[j] == 0.0 and (
                deepest < 0 or run.new_penetration[j] > run.new_penetration[deepest]
            ):
                deepest = j
        d, rate = run.new_penetration[deepest], run.new_rate[deepest]
        if 0.0 < d < reach or rate <= 0.0:
            break
        h = min(longest, max(0.0, h - (d - 0.5 * reach) / rate))
    return h
