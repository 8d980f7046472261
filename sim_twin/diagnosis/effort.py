"""How much a diagnosis simulates: fixed beforehand, so that the same seed gives the same answer anywhere."""

from __future__ import annotations

from dataclasses import dataclass

from sim_twin.diagnosis.campaign import Campaign

_SIMULATING = 0.58
"""Of the budget; the rest goes into what is made of it."""
_CORES = 2
_LEAST_MOTIONS, _MOST_MOTIONS = 120, 3000


@dataclass(frozen=True, slots=True)
class Effort:
    """How often all runs of a campaign may be simulated: for the search, and for the judging after it."""

    search: int
    judge: int

    @property
    def motions(self) -> int:
        """All of them."""
        return self.search + self.judge


def effort_for(campaign: Campaign, budget_s: float) -> Effort:
    """What fits into `budget_s` seconds of two cores by the rig's rated speed; the same on every machine."""
    seconds = sum(run.samples(1) / run.columns.rate + run.settle for run in campaign.runs)
    rated = campaign.runs[0].twin.model.speed
    motions = _SIMULATING * budget_s * _CORES * rated / seconds
    motions = int(min(max(motions, _LEAST_MOTIONS), _MOST_MOTIONS))
    judge = max(36, motions // 6)
    return Effort(motions - judge, judge)
