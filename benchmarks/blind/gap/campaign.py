"""The gaps of a campaign, with the ensembles of the nominal twin and of the truth kept in a file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.calibration import logs_of
from benchmarks.blind.campaigns import Campaign
from benchmarks.blind.cases import Gaps
from benchmarks.blind.gap.distance import Floor, Table
from benchmarks.blind.gap.twin import ensemble, read_features, recorded_channels, scenario_of
from benchmarks.blind.runner import effects_file
from benchmarks.blind.sets import OUTSIDE
from daq.errors import ConfigurationError
from rig.files.scenario import Scenario

_SEEDS, _STANDING_IN = range(1000, 1008), 2000
"""The same healthy rigs with every set of effects, so that differences are those of the effects."""


@dataclass(frozen=True, slots=True)
class _Known:
    """What is known of a run before any answer: its features, and those of the two ensembles."""

    scenario: Scenario
    channels: list[str]
    recording: Table
    nominal: list[Table]
    true: list[Table]
    floor: Floor


def known_gaps(folder: Path, campaign: Campaign) -> Gaps | None:
    """What `truth_gaps` has found already; None if it was not asked yet."""
    file = _gaps_file(folder, campaign)
    if not file.exists():
        return None
    found = json.loads(file.read_text())
    return Gaps(found["before"], found["oracle"])


def truth_gaps(folder: Path, campaign: Campaign) -> Gaps:
    """Gap of a campaign to the nominal twin and to the twin with the true effects, mean over its runs.

    No twin can have what is in no catalogue: both are the nominal one's then. Raises FileNotFoundError
    without its logs.

    Where the twin's page is not the truth's, a twin with the true effects stands for the recording: that
    tells whether the settings show them.
    """
    known = known_gaps(folder, campaign)
    if known is not None:
        return known
    runs = list(_known_runs(folder, campaign))
    if not runs:
        raise FileNotFoundError(
            f"the logs of {campaign.name} are not there any more, and its gap is not known"
        )
    before = np.mean([run.floor.gap(run.recording, run.nominal) for run in runs])
    oracle = np.mean([run.floor.gap(run.recording, run.true) for run in runs])
    gaps = Gaps(float(before), float(oracle))
    _write(_gaps_file(folder, campaign), asdict(gaps))
    return gaps


def answer_gap(folder: Path, campaign: Campaign) -> float | None:
    """Gap to the twin with the answer's effects in; None where there are none or no rig can have them."""
    file = _answer_file(folder, campaign)
    if file is None:
        return None
    if not file.exists():
        effects = json.loads(effects_file(folder, campaign.name).read_text())
        _write(file, _gap_with(folder, campaign, effects))
    gap: float | None = json.loads(file.read_text())
    return gap


def answer_is_measured(folder: Path, campaign: Campaign) -> bool:
    """Whether `answer_gap` needs no work any more."""
    file = _answer_file(folder, campaign)
    return file is None or file.exists()


def _gaps_file(folder: Path, campaign: Campaign) -> Path:
    return folder / "gaps" / f"{campaign.name}.json"


def _answer_file(folder: Path, campaign: Campaign) -> Path | None:
    """Where the gap with an answer lies; None where the answer has no effects."""
    answer = effects_file(folder, campaign.name)
    if not answer.exists() or not json.loads(answer.read_text()):
        return None
    digest = hashlib.sha256(answer.read_bytes()).hexdigest()[:16]
    return folder / "gaps" / f"{campaign.name}_{digest}.json"


def _write(file: Path, content: object) -> None:
    """Under another name until it is complete, so that one who is stopped here goes on."""
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(".part")
    unfinished.write_text(json.dumps(content))
    unfinished.rename(file)


def _gap_with(folder: Path, campaign: Campaign, effects: list[dict[str, Any]]) -> float | None:
    try:
        gaps = [
            run.floor.gap(run.recording, ensemble(run.scenario, effects, _SEEDS, run.channels))
            for run in _known_runs(folder, campaign)
        ]
    except ConfigurationError:
        return None
    return float(np.mean(gaps))


def _known_runs(folder: Path, campaign: Campaign) -> Iterator[_Known]:
    for log in logs_of(folder, campaign.name):
        scenario = scenario_of(log)
        names = recorded_channels(log)
        recording, groups = read_features(log, scenario, "measured", names)
        if not campaign.right_page:
            (recording,) = ensemble(scenario, campaign.effects, [_STANDING_IN], names)
        file = folder / "gaps" / f"{log.stem}.npz"
        if not file.exists():
            nominal = true = ensemble(scenario, (), _SEEDS, names)
            if campaign.kind not in OUTSIDE:
                true = ensemble(scenario, campaign.effects, _SEEDS, names)
            _keep(file, nominal, true)
        nominal, true = _kept(file)
        yield _Known(scenario, names, recording, nominal, true, Floor(true, groups))


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
