"""`rattle gap`: how far runs lie from the twin, without and with effects, so that anyone can repeat it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from daq.errors import RattleError
from rig.diagnosis.diagnose import recorded_of
from rig.diagnosis.workers import Simulated
from rig.ensembles.executors import cores, worker_processes
from rig.files.effects_file import load_effects
from rig.session.progress import Screen
from rig.twin.scenario_twin import catalogue_of
from sim_twin.diagnosis.draw import Draw
from sim_twin.diagnosis.findings import Gap
from sim_twin.diagnosis.fingerprint.layout import Layout
from sim_twin.diagnosis.gap import gap_measure
from sim_twin.diagnosis.judging import gap_between
from sim_twin.rigs.catalogue import model_of

_HEALTHY, _REPAIRED = 64, 32
_FEWEST = 8
_LONGEST_S = 600.0


def measured_gap(
    runs: Sequence[Path], model: Path | None, effects: Path | None, seed: int, screen: Screen
) -> tuple[Layout, Gap]:
    """The gap over all cycles of the runs; with `effects` in the twin too."""
    data = recorded_of(runs, model, screen)
    for remark in data.remarks:
        screen.warn(remark)
    catalogue = catalogue_of(model_of(data.campaign.runs[0].twin))
    given = () if effects is None else tuple(load_effects(effects, catalogue))
    rng = np.random.default_rng(seed)
    draws = [Draw((), int(rng.integers(2**62)), blocks=2) for _ in range(_HEALTHY)]
    draws += [Draw(given, int(rng.integers(2**62))) for _ in range(_REPAIRED if given else 0)]
    with worker_processes(cores()) as workers, screen.bar("simulating", len(draws), "rigs") as bar:
        simulated = Simulated(data.campaign, workers.executor, time.monotonic() + _LONGEST_S, bar.at)
        shown = simulated(draws)
    healthy = [each[0] for each in shown[:_HEALTHY] if each and each[0] is not None]
    repaired = np.array([each[0][0] for each in shown[_HEALTHY:] if each and each[0] is not None], np.float64)
    if len(healthy) < _FEWEST or (given and len(repaired) < _FEWEST):
        raise RattleError("too few rigs could be simulated for a gap")
    measure = gap_measure(healthy, data.campaign.layout)
    return data.campaign.layout, gap_between(
        measure, data.measured, data.measured, repaired if given else None, rng
    )
