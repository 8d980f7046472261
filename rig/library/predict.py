"""The twin of a scenario alone, from Python."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from rig.files.scenario import load_scenario
from rig.library.log import Folder, Log
from rig.twin.prediction_file import write_prediction
from rig.twin.scenario_twin import twin_of, with_effects

_File = str | PathLike[str]


def predicted(
    scenario_file: _File,
    effects: _File | Sequence[Mapping[str, Any]] | None,
    settings: Mapping[str, object] | None,
    seed: int | None,
    out: _File | None,
) -> Log:
    """See `rattle.predict`."""
    scenario = load_scenario(Path(scenario_file), settings)
    folder = Folder()
    file = None if effects is None else _effects_file(effects, folder.path)
    twin = twin_of(scenario)
    if file is not None:
        twin = with_effects(twin, file)
    path = folder.path / "prediction.mcap" if out is None else Path(out)
    write_prediction(scenario, twin, seed, path, file)
    return Log(path, folder)


def _effects_file(effects: _File | Sequence[Mapping[str, Any]], folder: Path) -> Path:
    if isinstance(effects, str | PathLike):
        return Path(effects)
    file = folder / "effects.json"
    file.write_text(json.dumps([dict(each) for each in effects]), encoding="utf-8")
    return file
