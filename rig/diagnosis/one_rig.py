"""Whether runs that values were found from are of one rig: by what each asks for, and by its gap."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from math import inf

import numpy as np
from numpy.typing import NDArray

from daq.errors import RattleError
from rig.diagnosis.recordings import RecordedCampaign
from rig.files.scenario import parse_scenario
from rig.pages.words import listed
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.gap import GapMeasure, gap_measure
from sim_twin.diagnosis.subject import Draw

Array = NDArray[np.floating]


class Refused(RattleError):
    """No such rig: the same command would say so again."""


NOT_THIS_RIG = 2.0
"""Gap from which on the values explain nothing."""
_LEAST = 0.5
"""Of a healthy block's distance: what scatters by less may differ by as much."""
_SELDOM = 2.0
"""Times what two runs of a rig usually differ by, which of so many figures one always does."""
_STANDS_OUT = 1.5
"""Times: a run that does not fit lies so much farther off than any other, two runs of different rigs so much
farther apart than those of any healthy one."""
LOOKED_AT_FIRST = 24
"""Healthy rigs by which runs of one setting are held against one another."""


def require_one_rig(names: Sequence[str], apart: Sequence[float], gap: float = 1.0) -> None:
    """Refuse runs of which one says other values than the others, see `Round.apart`.

    Where a `gap` is left, what the twin lacks may be all that they say otherwise.
    """
    worst = int(np.argmax(apart)) if apart else 0
    if not apart or apart[worst] <= _STANDS_OUT * max(1.0, gap):
        return
    others = [name for number, name in enumerate(names) if number != worst]
    who = f"{names[worst]} asks for other values than {listed(others)}"
    if len(names) == 2:
        who = f"{listed(names)} ask for different values"
    raise Refused(
        f"{who}: {apart[worst]:.1f} times as far apart as the runs of any rig that was simulated. They may "
        "be of two rigs, of one in two states, or show what the twin lacks: nothing was written. Identify "
        "each by itself (one named by --frf: leave it out)"
    )


def of_one_rig(data: RecordedCampaign, measure: GapMeasure, healthy: Sequence[Array]) -> list[float]:
    """Gap of each run; RattleError where one does not fit though the others do, or two are of two rigs.

    `healthy` are fingerprints of the rigs that the measure is made of. Values between those of two rigs may
    leave neither far off; but runs of one setting then lie on either side of them.
    """
    gaps, names = measure.of_runs(data.measured), [path.name for path in data.paths]
    worst = int(np.argmax(gaps))
    others = max((gap for number, gap in enumerate(gaps) if number != worst), default=inf)
    farthest = max(measure.of_runs(rig)[worst] for rig in healthy)
    if others <= NOT_THIS_RIG and gaps[worst] > max(NOT_THIS_RIG, farthest, _STANDS_OUT * others):
        raise Refused(
            f"{names[worst]} does not fit, though the other runs do: with the values found its gap is "
            f"{gaps[worst]:.2f}, theirs {others:.2f} at most (1 is a healthy rig's). It may be of another "
            "rig, of this one in another state, or show what the twin lacks: nothing was written. Leave it "
            "out"
        )
    _require_alike(data, measure, healthy)
    return gaps


def require_alike(
    data: RecordedCampaign, layout: Layout, shown_by: Callable[[Sequence[Draw]], Sequence[Array]], seed: int
) -> None:
    """Refuse runs of one setting that lie farther apart than those of a healthy rig; before any long work.

    `layout` is that of the data's fingerprints, of which `shown_by` has some of healthy rigs simulated.
    """
    if not at_one_setting(data):
        return
    healthy = shown_by([Draw((), seed + number, blocks=2) for number in range(LOOKED_AT_FIRST)])
    if len(healthy) < LOOKED_AT_FIRST / 2:
        return
    _require_alike(data, gap_measure(healthy, layout), healthy)


def at_one_setting(data: RecordedCampaign) -> list[tuple[int, int]]:
    """Pairs of runs of one setting, by their numbers."""
    settings = [(scenario.drive, scenario.model) for scenario in map(parse_scenario, data.scenarios)]
    pairs = combinations(range(len(settings)), 2)
    return [(one, other) for one, other in pairs if settings[one] == settings[other]]


def _require_alike(data: RecordedCampaign, measure: GapMeasure, healthy: Sequence[Array]) -> None:
    names = [path.name for path in data.paths]
    for one, other in at_one_setting(data):
        seen = measure.apart(data.measured, one, other)
        if not seen:
            continue
        of_healthy = [measure.apart(rig[:1], one, other) for rig in healthy]
        # this rig may scatter more from block to block than the one that its scenario describes
        middle = measure.twin - np.mean(data.measured, axis=0, dtype=np.float64)
        own = [measure.apart(block[None] + middle, one, other) for block in data.measured]
        usual = {what: max(_rms(of_healthy, what), _rms(own, what), _LEAST) for what in seen}
        times = {what: apart / usual[what] for what, apart in seen.items()}
        most = max(_SELDOM, *(apart / usual[what] for each in of_healthy for what, apart in each.items()))
        worst = max(times, key=lambda what: times[what])
        if times[worst] > _STANDS_OUT * most:
            raise Refused(
                f"{names[one]} and {names[other]} were recorded at one setting and differ in {worst} by "
                f"{times[worst]:.1f} times what two runs of a rig do, where of {len(healthy)} healthy rigs "
                f"none does so in anything by more than {most:.1f}. They may be of two rigs, or of one in "
                "two states: nothing was written. Take each by itself"
            )


def _rms(each: Sequence[Mapping[str, float]], what: str) -> float:
    return float(np.sqrt(np.mean([one[what] ** 2 for one in each])))
