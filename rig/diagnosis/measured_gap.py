"""`rattle gap`: how far runs lie from the twin, without and with effects, so that anyone can repeat it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.errors import RattleError
from rig.diagnosis.diagnose_runs import recorded_of
from rig.diagnosis.document import gap_block
from rig.diagnosis.recordings import RecordedCampaign
from rig.diagnosis.workers import Simulated
from rig.ensembles.executors import cores, worker_processes
from rig.files.effects_file import load_effects
from rig.session.progress import Screen
from sim_twin.diagnosis.draw import Draw, Named
from sim_twin.diagnosis.gap import GapMeasure, gap_measure
from sim_twin.diagnosis.judging import gap_between
from sim_twin.rigs.catalogue import model_of

_HEALTHY, _REPAIRED, _ALONE = 64, 32, 12
_FEWEST = 8
_LONGEST_S = 600.0
Fingerprints: TypeAlias = NDArray[np.float64]


def measured_gap(
    runs: Sequence[Path], model: Path | None, effects: Path | None, seed: int, screen: Screen
) -> dict[str, Any]:
    """The gap block of a diagnosis over all cycles of the runs; with `effects` in the twin too."""
    data = recorded_of(runs, model, screen)
    for remark in data.remarks:
        screen.warn(remark)
    rig = model_of(data.campaign.runs[0].twin)
    given = () if effects is None else tuple(load_effects(effects, rig.effects))
    alone = given if len(given) > 1 else ()
    wanted = [((), _HEALTHY), *([(given, _REPAIRED)] if given else []), *(((one,), _ALONE) for one in alone)]
    healthy, *others = _simulated(data, wanted, seed, screen)
    measure = gap_measure(healthy, data.campaign.layout)
    repaired = [np.array([blocks[0] for blocks in each], dtype=np.float64) for each in others]
    rng = np.random.default_rng([seed, 1])
    found = gap_between(measure, data.measured, data.measured, repaired[0] if given else None, rng)
    places = [rig.effects[name].location for name, _ in given]
    return gap_block(data.campaign.layout, found, _by_location(measure, places, repaired[1:]))


def _simulated(
    data: RecordedCampaign, wanted: Sequence[tuple[tuple[Named, ...], int]], seed: int, screen: Screen
) -> list[list[NDArray[np.float32]]]:
    """Fingerprints (blocks, numbers) of so many rigs with each set of effects."""
    rng = np.random.default_rng(seed)
    draws = [
        Draw(effects, int(rng.integers(2**62)), blocks=1 if effects else 2)
        for effects, count in wanted
        for _ in range(count)
    ]
    with worker_processes(cores()) as workers, screen.bar("simulating", len(draws), "rigs") as bar:
        simulated = Simulated(data.campaign, workers.executor, time.monotonic() + _LONGEST_S, bar.at)
        shown = iter(simulated(draws))
    sets = [[each[0] for each in islice(shown, count) if each and each[0] is not None] for _, count in wanted]
    if any(len(each) < _FEWEST for each in sets):
        raise RattleError("too few rigs could be simulated for a gap")
    return sets


def _by_location(
    measure: GapMeasure, places: Sequence[str], alone: Sequence[Fingerprints]
) -> dict[str, float]:
    """Shares of the places of effects in how far each moves a twin, by squares; one effect has all of it."""
    if len(places) < 2:
        return dict.fromkeys(places, 1.0)
    moved = [float(np.mean(measure.cells(rigs.mean(axis=0)[None]) ** 2)) for rigs in alone]
    shares: dict[str, float] = {}
    for place, size in zip(places, moved, strict=True):
        shares[place] = shares.get(place, 0.0) + size / sum(moved)
    return shares
