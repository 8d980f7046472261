"""The effects file: which effects a rehearsal hides in the rig, or a prediction puts into the twin."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from daq.errors import ConfigurationError, Problem
from rig.files.faults import Faults, read_text
from sim_twin.effects import Catalogue, Parameter

Named = tuple[str, dict[str, float | str]]
"""An effect and its parameters, numbers as floats in SI."""


def load_effects(path: str | Path, catalogue: Catalogue) -> tuple[Named, ...]:
    """Read an effects file; raises ConfigurationError with every fault in it."""
    return parse_effects(read_text(path), str(path), catalogue)


def parse_effects(text: str, source: str, catalogue: Catalogue) -> tuple[Named, ...]:
    """Read `[{"name": ..., "parameters": {...}}]` as (name, parameters), numbers as floats in SI.

    `catalogue` holds the effects of the rig; all that they ask for has to be given. An effect on a channel
    may be there once a channel, any other once. Raises ConfigurationError with every fault.
    """
    faults = Faults(source)
    try:
        entries = json.loads(text, object_pairs_hook=_once_each)
    except (ValueError, RecursionError) as error:
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        raise ConfigurationError(source, [Problem("JSON", "(syntax)", reason)]) from error
    if not isinstance(entries, list):
        faults.add("effects", entries, 'a list such as [{"name": "clearance", "parameters": {"scale": 1.5}}]')
        raise faults.error()
    seen: set[tuple[str, object]] = set()
    effects = []
    for number, entry in enumerate(entries, start=1):
        name = _name(entry, f"[{number}]", catalogue, seen, faults)
        if name is not None:
            given = entry.get("parameters", {})
            effects.append((name, _parameters(given, catalogue[name].asked, f"[{number}].{name}", faults)))
    faults.raise_if_any()
    return tuple(effects)


def _once_each(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"the key {key!r} stands there twice")
        table[key] = value
    return table


def _name(
    entry: object, key: str, catalogue: Catalogue, seen: set[tuple[str, object]], faults: Faults
) -> str | None:
    """Which effect an entry is, where its parameters can be looked at."""
    if not isinstance(entry, dict):
        faults.add(key, entry, 'an object with "name" and "parameters"')
        return None
    for unknown in entry.keys() - {"name", "parameters"}:
        faults.unknown(f"{key}.{unknown}", entry[unknown], unknown, ("name", "parameters"))
    name, given = entry.get("name"), entry.get("parameters", {})
    if not isinstance(name, str):
        faults.add(f"{key}.name", name, f"an effect of this rig: {', '.join(catalogue)}")
        return None
    if name not in catalogue:
        faults.unknown(f"{key}.name", name, name, catalogue, "effect")
        return None
    if not isinstance(given, dict):
        faults.add(f"{key}.parameters", given, "an object")
        return None
    channel = given.get("channel")
    identity = name, channel if isinstance(channel, str) else None
    if identity in seen:
        faults.add(f"{key}.name", name, "once a channel" if identity[1] else "once in a file")
    seen.add(identity)
    return name


def _parameters(
    given: dict[str, Any], asked: Mapping[str, Parameter], key: str, faults: Faults
) -> dict[str, float | str]:
    values: dict[str, float | str] = {}
    for name in given:
        if name not in asked:
            faults.unknown(f"{key}.{name}", given[name], name, asked)
    for name, allowed in asked.items():
        if name not in given:
            faults.missing(f"{key}.{name}", allowed.allowed)
            continue
        value = _plain(given[name])
        if allowed.holds(value) and value is not None:
            values[name] = value
        else:
            faults.add(f"{key}.{name}", given[name], allowed.allowed)
    return values


def _plain(value: object) -> float | str | None:
    """A finite number as float, a text as it is, None for all else."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
