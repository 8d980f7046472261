"""The twin of a scenario alone, from Python."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from rig.files.out_folder import require_new
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
    if out is not None:
        require_new(Path(out), "predicted")
    scenario = load_scenario(Path(scenario_file), settings)
    folder = Folder()
    twin, file = twin_of(scenario), None
    if isinstance(effects, str | PathLike):
        file = Path(effects)
        twin = with_effects(twin, file)
    elif effects is not None:
        file, text = folder.path / "effects.json", json.dumps(effects, default=_plain)
        twin = with_effects(twin, "effects", text)
        file.write_text(text, encoding="utf-8")
    path = folder.path / "prediction.mcap" if out is None else Path(out)
    write_prediction(scenario, twin, seed, path, file)
    return Log(path, folder)


def _plain(value: object) -> object:
    """A mapping or a number as JSON knows it; of anything else how it calls itself, to be refused."""
    if isinstance(value, Mapping):
        return dict(value)
    return value.item() if isinstance(value, np.generic) else repr(value)
