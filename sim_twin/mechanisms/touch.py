"""Which contacts touch at the end of a step, and the list of those that have ended."""

from __future__ import annotations

from sim_twin.mechanisms.generic import mechanical
from sim_twin.mechanisms.run import APPROACH, CONTACT, END, EPISODES, ONSET, PEAK, Real, Run, StepLimits

# Columns of Run.last: the forces at the ends of the last two steps and the times of these.
_FORCE, _FORCE_BEFORE, _TIME, _TIME_BEFORE = range(4)


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
            run.last[j, _FORCE], run.last[j, _FORCE_BEFORE] = 0.0, 0.0
            run.last[j, _TIME], run.last[j, _TIME_BEFORE] = t, t
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
            _list_episode(run, j, episodes)
            ended = True
    return latch_overlaps(run, limits.floor, t), ended


@mechanical
def _list_episode(run: Run, j: int, episodes: Real) -> None:
    row = run.counts[EPISODES]
    if row < episodes.shape[0]:
        for column in range(episodes.shape[1]):
            episodes[row, column] = run.open_episode[j, column]
    run.counts[EPISODES] = row + 1


@mechanical
def follow_peaks(run: Run, t: float) -> None:
    """Raise the peaks of the open episodes to the summit of the parabola through the last three forces."""
    for j in range(run.latched.size):
        # A step has no length where two contacts begin at once.
        if run.latched[j] == 0.0 or t <= run.last[j, _TIME]:
            continue
        last, f = run.last, run.force[j]
        peak = max(f, last[j, _FORCE])
        if last[j, _FORCE] >= max(f, last[j, _FORCE_BEFORE]) and last[j, _TIME] > last[j, _TIME_BEFORE]:
            peak += _rise(
                last[j, _TIME_BEFORE] - last[j, _TIME], last[j, _FORCE_BEFORE] - last[j, _FORCE],
                t - last[j, _TIME], f - last[j, _FORCE],
            )  # fmt: skip
        run.open_episode[j, PEAK] = max(run.open_episode[j, PEAK], peak)
        last[j, _FORCE_BEFORE], last[j, _TIME_BEFORE] = last[j, _FORCE], last[j, _TIME]
        last[j, _FORCE], last[j, _TIME] = f, t


@mechanical
def _rise(x1: float, y1: float, x2: float, y2: float) -> float:
    """How far the parabola through the origin and two points rises above the origin."""
    slope = (y1 * x2 * x2 - y2 * x1 * x1) / (x1 * x2 * (x2 - x1))
    bend = (y2 * x1 - y1 * x2) / (x1 * x2 * (x2 - x1))
    return -slope * slope / (4.0 * bend) if bend < 0.0 else 0.0
