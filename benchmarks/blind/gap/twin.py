"""The twin's side of the measure: the runs that `rattle predict --effects E --seed N` gives."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.blind.gap.beam import beam_features
from benchmarks.blind.gap.crank import crank_features
from benchmarks.blind.gap.cycles import Samples
from benchmarks.blind.gap.distance import Table
from benchmarks.blind.gap.spatial import spatial_features
from daq.log.reader import LogReader, Origin
from rig.files.scenario import Scenario, parse_scenario
from rig.twin.prediction_file import write_prediction
from rig.twin.scenario_twin import twin_of, with_effects

_FEATURES = {
    "impact_beam": beam_features,
    "planar_slider_crank": crank_features,
    "spatial_slider_crank": spatial_features,
}


def scenario_of(log: Path) -> Scenario:
    """The scenario that a log holds."""
    with LogReader(log) as reader:
        return parse_scenario(reader.scenario, str(log))


def recorded_channels(log: Path) -> list[str]:
    """Names of the channels that were recorded."""
    with LogReader(log) as reader:
        return list(reader.table("measured"))


def read_features(
    log: Path, scenario: Scenario, origin: Origin, names: Sequence[str]
) -> tuple[Table, list[int]]:
    """Features of every whole cycle of these channels of a log, and the group of each."""
    with LogReader(log) as reader:
        blocks = reader.table(origin, names)
    channels: dict[str, Samples] = {
        name: np.nan_to_num(blocks[name].values.astype(np.float64)) for name in names
    }
    rate = next(iter(blocks.values())).sample_rate
    cycles = _FEATURES[scenario.rig](channels, rate, getattr(scenario.drive, "frequency", 0.0))
    if not cycles:
        raise ValueError(f"{log} holds no whole cycle")
    table = [[value for group in cycle.values() for value in group.values()] for cycle in cycles]
    groups = [number for number, group in enumerate(cycles[0].values()) for _ in group]
    return np.array(table), groups


def ensemble(
    scenario: Scenario, effects: Sequence[dict[str, Any]], seeds: Sequence[int], names: Sequence[str]
) -> list[Table]:
    """Features of healthy twins with `effects` in, of the channels `names`.

    Raises ConfigurationError for what the rig cannot have.
    """
    with TemporaryDirectory() as folder:
        file = Path(folder) / "effects.json"
        file.write_text(json.dumps(list(effects)))
        twin = with_effects(twin_of(scenario), file)
        tables = []
        for seed in seeds:
            log = Path(folder) / f"{seed}.mcap"
            write_prediction(scenario, twin, seed, log)
            tables.append(read_features(log, scenario, "predicted", names)[0])
            log.unlink()
        return tables
