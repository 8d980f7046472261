"""A surrogate in place of simulations, where it may."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from daq.errors import RattleError
from rig.ensembles import Outcomes
from rig.files.scenario import Scenario
from rig.files.surrogate_file import load_surrogate
from rig.twin.recorded_samples import asked, beyond
from rig.twin.scenario_twin import twin_of
from sim_twin.ensembles.simulate import Variant, simulate
from sim_twin.ensembles.surrogate_figures import HONOURED, SurrogateFigures
from sim_twin.surrogates.samples import COLUMNS


def stood_in(
    file: Path, scenario: Scenario, variants: Sequence[Variant], settings_only: bool
) -> tuple[Outcomes, str]:
    """Figures of `variants`, healthy rigs of `scenario`, by a surrogate, and who it is in words.

    Raises RattleError where its own test forbids it, where it cannot know what they differ by (unless
    `settings_only` leaves that out), or where one of them lies outside of what it learnt.
    """
    surrogate = load_surrogate(file, scenario.rig)
    if not surrogate.stands_in:
        tested = surrogate.tested.values()
        if tested and all(score.distance_floor for score in tested):
            worst = max(score.distance_over_floor for score in tested)
            told = f"distributed {worst:.1f} times as far off as they are from each other"
        else:
            told = "distributed otherwise, and not two whole revolutions were there to say how far is far"
        raise RattleError(
            f"{file}: not good enough to stand in: on revolutions that it had not seen, what it says is "
            f"{told}; without --surrogate they are simulated"
        )
    if surrogate.over == "time":
        raise RattleError(
            f"{file}: it learnt over time, which says nothing of another run; train it --over angle"
        )
    twin = twin_of(scenario)
    unknown = [
        each.name
        for each in twin.model.healthy_spread(twin)
        if each.name not in HONOURED and each.place[0] != "sensors"  # figures are before any sensor
    ]
    if unknown and not settings_only:
        raise RattleError(
            f"{file}: healthy rigs also differ by {', '.join(unknown)}, of which it learnt nothing; without "
            f"--surrogate they are simulated, with --settings-only just clearances and speed differ"
        )
    inputs = asked(scenario, np.zeros(1), np.zeros(1))
    figures = SurrogateFigures(surrogate, float(inputs[0, list(COLUMNS).index("density")]))
    count, outside = figures.outside(variants)
    if outside:
        told = ", ".join(beyond(surrogate, outside).values())
        which = f"{count} of {len(variants)} rigs of {scenario.name}"
        raise RattleError(f"{file}: {which} lie outside of what it learnt: {told}")
    learnt = f"{surrogate.kind} of {len(surrogate.learnt_from)} runs of one rig"
    return simulate(variants, figures), f"by surrogate {file.name} ({learnt}), not simulated"
