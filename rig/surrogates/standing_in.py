"""A surrogate in place of simulations, where it may."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daq.errors import RattleError
from rig.files.scenario import Scenario
from rig.files.surrogate_file import load_surrogate
from rig.twin.recorded_samples import asked
from sim_twin.ensembles.surrogate_figures import SurrogateFigures
from sim_twin.surrogates.samples import COLUMNS


def standing_in(file: Path, scenario: Scenario) -> SurrogateFigures:
    """What stands in for simulating healthy rigs of `scenario`.

    Raises RattleError where its own test forbids it, or where the scenario lies outside of what it learnt.
    """
    surrogate = load_surrogate(file, scenario.rig)
    if not surrogate.stands_in:
        worst = max((score.distance_over_floor for score in surrogate.tested.values()), default=np.inf)
        raise RattleError(
            f"{file}: not good enough to stand in: on revolutions that it had not seen, what it says is "
            f"distributed {worst:.1f} times as far off as two halves of a run; without --surrogate they are "
            f"simulated"
        )
    if surrogate.over == "time":
        raise RattleError(
            f"{file}: it learnt over time, which says nothing of another run; train it --over angle"
        )
    inputs = asked(scenario, np.zeros(1), np.zeros(1))
    if outside := surrogate.outside(inputs):
        told = ", ".join(f"{name} {low:g} {COLUMNS[name]}" for name, (low, _) in outside.items())
        raise RattleError(f"{file}: {scenario.name} lies outside of what it learnt: {told}")
    return SurrogateFigures(surrogate, float(inputs[0, list(COLUMNS).index("density")]))
