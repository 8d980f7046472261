"""Whether runs that values were found from are of one rig: by what each asks for, and by its gap."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import inf

import numpy as np
from numpy.typing import NDArray

from daq.errors import RattleError
from rig.diagnosis.recordings import RecordedCampaign
from rig.files.scenario import parse_scenario
from rig.pages.words import listed
from sim_twin.diagnosis.gap import GapMeasure


class Refused(RattleError):
    """No such rig: the same command would say so again."""


NOT_THIS_RIG = 2.0
"""Gap from which on the values explain nothing."""
_STANDS_OUT = 1.5
"""Times: a run that does not fit lies so much farther off than any other, two runs of different rigs so much
farther apart than those of any healthy one."""


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


def of_one_rig(
    data: RecordedCampaign, measure: GapMeasure, healthy: Sequence[NDArray[np.floating]]
) -> list[float]:
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
    settings = [(scenario.drive, scenario.model) for scenario in map(parse_scenario, data.scenarios)]
    for one, other in combinations(range(len(gaps)), 2):
        apart = measure.between(data.measured, one, other) if settings[one] == settings[other] else None
        if apart is None:
            continue
        usual = max(measure.between(rig[:1], one, other) or 0.0 for rig in healthy)
        if apart > max(NOT_THIS_RIG, _STANDS_OUT * usual):
            raise Refused(
                f"{names[one]} and {names[other]} were recorded at one setting and lie a gap of {apart:.2f} "
                f"from one another, where two runs of a healthy rig lie {usual:.2f} at most. They may be of "
                "two rigs, or of one in two states: nothing was written. Identify each by itself"
            )
    return gaps
