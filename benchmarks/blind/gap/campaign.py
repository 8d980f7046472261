"""The gaps of a campaign, with the ensembles of the nominal twin and of the truth kept in a file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Gaps
from benchmarks.blind.gap.distance import Floor, Table
from benchmarks.blind.gap.twin import ensemble, read_features, scenario_of
from benchmarks.blind.make import logs_of
from benchmarks.blind.runner import effects_file
from daq.errors import ConfigurationError
from rig.files.scenario import Scenario

_SEEDS = range(1000, 1008)
"""The same healthy rigs with every set of effects, so that differences are those of the effects."""


@dataclass(frozen=True, slots=True)
class _Known:
    """What is known of a run before any answer: its features, and those of the two ensembles."""

    scenario: Scenario
    recording: Table
    nominal: list[Table]
    true: list[Table]
    floor: Floor


def truth_gaps(folder: Path, campaign: Campaign) -> Gaps:
    """Gap of a campaign to the nominal twin and to the twin with the true effects, mean over its runs."""
    file = folder / "gaps" / f"{campaign.name}.json"
    if file.exists():
        found = json.loads(file.read_text())
        return Gaps(found["before"], found["oracle"])
    runs = list(_known_runs(folder, campaign))
    before = np.mean([run.floor.gap(run.recording, run.nominal) for run in runs])
    oracle = np.mean([run.floor.gap(run.recording, run.true) for run in runs])
    gaps = Gaps(float(before), float(oracle))
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(asdict(gaps)))
    return gaps


def answer_gap(folder: Path, campaign: Campaign) -> float | None:
    """Gap to the twin with the answer's effects in; None where there are none or no rig can have them."""
    answer = effects_file(folder, campaign.name)
    effects: list[dict[str, Any]] = json.loads(answer.read_text()) if answer.exists() else []
    if not effects:
        return None
    digest = hashlib.sha256(answer.read_bytes()).hexdigest()[:16]
    file = folder / "gaps" / f"{campaign.name}_{digest}.json"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(_gap_with(folder, campaign, effects)))
    gap: float | None = json.loads(file.read_text())
    return gap


def _gap_with(folder: Path, campaign: Campaign, effects: list[dict[str, Any]]) -> float | None:
    try:
        gaps = [
            run.floor.gap(run.recording, ensemble(run.scenario, effects, _SEEDS))
            for run in _known_runs(folder, campaign)
        ]
    except ConfigurationError:
        return None
    return float(np.mean(gaps))


def _known_runs(folder: Path, campaign: Campaign) -> Iterator[_Known]:
    for log in logs_of(folder, campaign.name):
        scenario = scenario_of(log)
        recording, groups = read_features(log, scenario, "measured")
        file = folder / "gaps" / f"{log.stem}.npz"
        if not file.exists():
            _keep(file, ensemble(scenario, [], _SEEDS), ensemble(scenario, campaign.effects, _SEEDS))
        nominal, true = _kept(file)
        yield _Known(scenario, recording, nominal, true, Floor(true, groups))


def _keep(file: Path, nominal: Sequence[Table], true: Sequence[Table]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    tables = {f"nominal{n}": table for n, table in enumerate(nominal)}
    tables |= {f"true{n}": table for n, table in enumerate(true)}
    unfinished = file.with_name(f"{file.stem}.part.npz")
    np.savez_compressed(unfinished, **{name: table.astype(np.float32) for name, table in tables.items()})  # type: ignore[arg-type]
    unfinished.rename(file)


def _kept(file: Path) -> tuple[list[Table], list[Table]]:
    with np.load(file) as tables:
        nominal, true = (
            [tables[f"{kind}{n}"].astype(np.float64) for n in range(len(_SEEDS))]
            for kind in ("nominal", "true")
        )
    return nominal, true
