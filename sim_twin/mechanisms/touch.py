"""Which contacts touch at the end of a step, and the list of those that have ended."""

from __future__ import annotations

from sim_twin.mechanisms.generic import mechanical
from sim_twin.mechanisms.run import APPROACH, CONTACT, END, EPISODES, ONSET, PEAK, Real, Run, StepLimits


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
