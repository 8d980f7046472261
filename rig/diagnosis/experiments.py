"""The one further run that would tell two causes apart best."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from daq.errors import ConfigurationError
from rig.diagnosis.recordings import setting_of
from rig.files.faults import toml_of
from rig.files.quantity import written
from rig.files.scenario import parse_scenario, with_values
from rig.files.table import NOTHING
from rig.rigs import RIGS
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign

_MOST = 5
_SLOWER = {"frequency", "speed"}
_LEAST_DURATION, _LONG_ENOUGH = 5.0, 20.0
"""s; a slower run is longer, up to what is enough for any."""


@dataclass(frozen=True, slots=True)
class Option:
    """A run that could be made, as a scenario and as a campaign of it alone."""

    scenario: str
    campaign: Campaign


@dataclass(frozen=True, slots=True)
class Experiment:
    """The run that separates two effects, and the probability of choosing right between them after it."""

    scenario: str
    separates: tuple[str, str]
    expected_probability: float


def options(
    scenario_text: str,
    channels: Sequence[str],
    rate: float,
    quiet: Mapping[str, float] = NOTHING,
    chains: Mapping[str, str] = NOTHING,
    recorded_s: float = math.inf,
) -> list[Option]:
    """Other settings of the rig within what its scenario files allow, most different first.

    They are looked at like the runs that were made, at `rate` Hz with the shares `quiet` of the noise,
    through the same `chains`. `recorded_s`: where the run ended before its scenario asked it to.
    """
    table = tomllib.loads(scenario_text)
    kind = RIGS[table["rig"]]
    found = []
    for variation in kind.variations:
        changed = _changed(table, variation, kind.name, recorded_s)
        if changed is None:
            continue
        text = toml_of(changed)
        try:
            scenario = parse_scenario(text, "next experiment")
            twin = twin_of(scenario, tuple(channels), chains)
        except ConfigurationError:
            continue
        whole = int(scenario.acquisition.duration * twin.drive.cycle_hz - 1.5)
        found.append(Option(text, Campaign((setting_of(twin, channels, rate, whole, quiet),))))
    return found[:_MOST]


def _changed(
    table: Mapping[str, Any], variation: Mapping[str, float], rig: str, recorded_s: float
) -> dict[str, Any] | None:
    """The scenario with some quantities multiplied; None where it does not give one of them."""
    changed = with_values(table, {})
    said = []
    for key, factor in variation.items():
        section = next((name for name in ("drive", "model") if key in changed.get(name, {})), None)
        if section is None:
            return None
        value, unit = written(changed[section][key])
        scaled = float(f"{value * factor:.3g}")
        changed[section][key] = f"{scaled:g} {unit}".strip() if unit else scaled
        said.append(f"{key} {changed[section][key]}")
    lasts, unit = written(changed["acquisition"]["duration"])
    if unit in ("", "s"):  # as many cycles as before, and not too few of them
        lasts = min(lasts, recorded_s)
        slower = min([1.0, *(variation[key] for key in _SLOWER & set(variation))])
        longer = float(f"{max(lasts, _LEAST_DURATION, min(lasts / slower, _LONG_ENOUGH)):.3g}")
        changed["acquisition"]["duration"] = f"{longer:g} {unit}".strip() if unit else longer
    changed["name"] = f"{table.get('name', rig)}: {', '.join(said)}"
    return changed
