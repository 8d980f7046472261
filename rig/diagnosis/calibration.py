"""A twin matched to a healthy rig's own runs, and what it does otherwise even so (`rattle calibrate`)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.diagnosis.one_rig import LOOKED_AT_FIRST, at_one_setting, require_alike
from rig.diagnosis.recordings import RecordedCampaign, work_of
from rig.ensembles import Simulated, cores, worker_processes
from rig.pages.words import listed
from rig.session.progress import Screen
from sim_twin.diagnosis.discrepancy import Discrepancy, learned
from sim_twin.diagnosis.gap import gap_measure
from sim_twin.diagnosis.matching import Match, fingerprints_of, healthy_draws, match, matched_campaign
from sim_twin.diagnosis.subject import Observed

_MATCHED_RIGS = 48
"""As many as the band of a verdict has."""
_NAMED = 3


@dataclass(frozen=True, slots=True)
class Calibration:
    """`gaps` of the runs from rigs as they were matched, and with the discrepancies besides.

    1 for such a rig; None where nothing was matched.
    """

    match: Match
    discrepancies: tuple[Discrepancy, ...] = ()
    gaps: tuple[float, float] | None = None

    def refusal(self, known_healthy: bool) -> str:
        """Why there is no model where the match is of no healthy rig."""
        text = f"their misfit is {self.match.misfit:.2g}, where one healthy rig in a hundred passes 1"
        if self.match.suspicious:
            text += f", and they ask for too much of {', '.join(self.match.suspicious)}"
        known = "identify its values first (rattle identify): too much is otherwise to be allowed for"
        other = "rattle diagnose tells what it is, or say --known-healthy where you know better"
        return (
            f"these runs are not of a healthy rig: {text}. A model of them would hide what is wrong, so none "
            f"was written; {known if known_healthy else other}"
        )

    def told(self) -> Iterator[str]:
        if self.gaps is not None:
            matched, allowed = self.gaps
            besides = f", {allowed:.2f} with what is allowed for" if self.discrepancies else ""
            yield f"gap        {matched:.2f} with the model{besides}   (1 = as far as a healthy rig)"
        if self.discrepancies:
            where = dict.fromkeys(f"{each.what} of {each.channel}" for each in self.discrepancies)
            more = [f"{len(where) - _NAMED} more"] if len(where) > _NAMED else []
            named = listed([*[*where][:_NAMED], *more])
            yield f"allowed    what the twin does otherwise: {named}; what shows there alone is hard to see"


def calibrated(
    read: RecordedCampaign, rigs: int, seed: int, budget_s: float, screen: Screen, known_healthy: bool = False
) -> Calibration:
    """Match the campaign's twin by simulated healthy `rigs`, and learn what it does otherwise then.

    Where the match is of no healthy rig there is nothing to learn. Raises SimulationFailed, and Refused for
    runs of two rigs.
    """
    rng, first = np.random.default_rng(seed), LOOKED_AT_FIRST if at_one_setting(read) else 0
    asked = first + rigs + _MATCHED_RIGS
    work = work_of("calibrate", read.campaign, [1] * asked)
    with screen.bar("simulating", asked, "healthy rigs", work) as bar, worker_processes(cores()) as workers:
        simulate = Simulated(read.campaign, workers.executor, time.monotonic() + budget_s, bar)
        require_alike(read, read.campaign.layout, lambda draws: [*fingerprints_of(simulate(draws))], seed)
        found = match(read.campaign, read.measured, simulate, rigs, rng, read.told, known_healthy)
        draws = healthy_draws(_MATCHED_RIGS, rng) if found.healthy else []  # else it may be no rig at all
        matched = matched_campaign(read.campaign, found.matched) if draws else read.campaign
        like = simulate.of(matched, draws)
    if simulate.cut_short:
        screen.warn(
            "time ran out: fewer healthy rigs were simulated than planned; another machine may fit otherwise"
        )
    shown = fingerprints_of(like)
    if len(shown) < _MATCHED_RIGS / 2:
        return Calibration(found)
    beyond = learned(matched.layout, read.measured, shown)
    allowing = replace(matched, discrepancies=beyond)
    gaps = (_gap(read, like), _gap(read, allowing.as_they_differ(draws, like)))
    return Calibration(found, beyond, gaps)


def _gap(read: RecordedCampaign, like: Sequence[Observed]) -> float:
    measure = gap_measure([*fingerprints_of(like)], read.campaign.layout)
    return measure.total(measure.cells(read.measured))
