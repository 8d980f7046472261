"""The few facts of a scenario's text that a report needs; a text that says nothing gives nothing."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass

from rig.files.quantity import QuantityError, si_value


@dataclass(frozen=True, slots=True)
class ScenarioFacts:
    """Name, rig and drive in the operator's words; `cycle_s` is one cycle of the drive, None if unknown."""

    name: str = ""
    rig: str = ""
    drive: str = ""
    cycle_s: float | None = None


def scenario_facts(toml: str) -> ScenarioFacts:
    """Read them from a scenario's TOML text, which another program may have written."""
    try:
        scenario = tomllib.loads(toml)
    except tomllib.TOMLDecodeError:
        return ScenarioFacts()
    drive = scenario.get("drive", {})
    drive = drive if isinstance(drive, dict) else {}
    return ScenarioFacts(
        name=str(scenario.get("name", "")),
        rig=str(scenario.get("rig", "")),
        drive=", ".join(f"{key} {value}" for key, value in drive.items()),
        cycle_s=_cycle_s(drive),
    )


def _cycle_s(drive: dict[str, object]) -> float | None:
    frequency = _quantity(drive.get("frequency"), "Hz") or _quantity(drive.get("speed"), "rad/s") / math.tau
    return 1.0 / frequency if frequency > 0 and math.isfinite(1.0 / frequency) else None


def _quantity(value: object, unit: str) -> float:
    if isinstance(value, (int, float)):
        return float(value)
    try:
        return si_value(str(value), unit)
    except QuantityError:
        return 0.0
