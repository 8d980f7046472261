"""The model file: where calibration found the tolerances of a rig to lie, so that its twin is matched."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from annotated_types import Ge, Le
from pydantic import Strict

from daq.quantity import Quantity, Text
from rig.files.faults import Faults, dotted, read_toml
from rig.files.file_kind import read_file
from rig.files.table import read_table, unknown_keys
from rig.rigs import RIGS
from sim_twin.healthy import Matched

_KEYS = ("rig", "runs", "scenarios", "tolerances")
_MOST = 400

_CORRELATIONS: Final = "a list of numbers from -1 to 1, one for each tolerance before this one"
Correlation = Annotated[float, Strict(), Ge(-1), Le(1)]


@dataclass(frozen=True, slots=True)
class _ToleranceSection:
    name: Annotated[str, Text("a text of one line, up to 200 characters")]
    nominal: Annotated[float, Quantity("", -1e18, 1e18)]
    mean: Annotated[float, Quantity("", -4, 4)]
    deviation: Annotated[float, Quantity("", 0, 1)]
    correlations: Annotated[tuple[Correlation, ...], Text(_CORRELATIONS)]


@dataclasses.dataclass(frozen=True, slots=True)
class ModelFile:
    """What a calibration found on a `rig`, from which `runs`; `text` is the file as written.

    `nominals` are the values, by tolerance, of the twin that was matched; SI.
    """

    rig: str
    runs: tuple[str, ...]
    scenarios: tuple[str, ...]
    nominals: Mapping[str, float]
    matched: Matched
    text: str


def load_model(path: str | Path, rig: str) -> ModelFile:
    """Read a model of `rig`; raises ConfigurationError with every fault in the file, or of another rig."""
    return parse_model(read_file(path, "model"), str(path), rig)


def parse_model(text: str, source: str, rig: str) -> ModelFile:
    """Read a model's text; `source` names it in the ConfigurationError, which lists every fault."""
    table = read_toml(text, source)
    faults = Faults(source)
    unknown_keys(table, _KEYS, "", faults)
    if table.get("rig") != rig:
        faults.add_from(table, "rig", "", f'"{rig}", the rig of the scenario' if rig in RIGS else "a rig")
    texts: dict[str, tuple[str, ...]] = {}
    for key in ("runs", "scenarios"):
        given = table.get(key, [])
        if not isinstance(given, list) or not all(isinstance(each, str) for each in given):
            faults.add(key, given, "a list of texts")
        else:
            texts[key] = tuple(given)
    sections = _sections(table.get("tolerances", []), faults)
    faults.raise_if_any()
    count = len(sections)
    correlation = np.eye(count)
    for row, each in enumerate(sections):
        correlation[row, :row] = correlation[:row, row] = each.correlations
    # Three digits of each number leave eigenvalues right to about their sum.
    if np.linalg.eigvalsh(correlation)[0] < -1e-3 * count:
        faults.add("tolerances", [], "correlations that can be at the same time")
    deviation = np.array([each.deviation for each in sections])
    mean = np.array([each.mean for each in sections])
    matched = Matched(
        tuple(each.name for each in sections), mean, correlation * np.outer(deviation, deviation)
    )
    faults.raise_if_any()
    nominals = {each.name: each.nominal for each in sections}
    return ModelFile(rig, texts["runs"], texts["scenarios"], nominals, matched, text)


def _sections(tables: object, faults: Faults) -> list[_ToleranceSection]:
    if not isinstance(tables, list) or not 0 < len(tables) <= _MOST:
        faults.add("tolerances", tables, f"tables [[tolerances]], 1 to {_MOST}")
        return []
    read: list[_ToleranceSection] = []
    for index, table in enumerate(tables):
        key = f"tolerances[{index + 1}]"
        section = read_table(_ToleranceSection, table, key, faults)
        if section is None:
            continue
        if len(section.correlations) != index:
            wanted = f"{index} numbers, one for each tolerance before it"
            faults.add(dotted(key, "correlations"), list(section.correlations), wanted)
        if any(section.name == other.name for other in read):
            faults.add(dotted(key, "name"), section.name, "each tolerance once")
        read.append(section)
    return read


def model_text(
    rig: str,
    runs: Sequence[str],
    scenarios: Sequence[str],
    nominals: Mapping[str, float],
    matched: Matched,
    remarks: Mapping[str, str],
) -> str:
    """The text of a model file; `remarks` say of each tolerance in physical terms what was found."""
    head: dict[str, Any] = {"rig": rig, "runs": list(runs), "scenarios": list(scenarios)}
    deviation = np.maximum(matched.deviation, 1e-12)
    correlation = np.asarray(matched.covariance / np.outer(deviation, deviation))
    lines = [
        "# What a healthy rig may differ by, as rattle calibrate found it; for --model.",
        "# mean and deviation in standard deviations of healthy rigs (0 and 1: the runs do not tell).",
        *(f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in head.items()),
    ]
    for row, name in enumerate(matched.names):
        lines += [
            "",
            "[[tolerances]]",
            f'name = "{name}"' + (f"  # {remarks[name]}" if name in remarks else ""),
            f"nominal = {nominals[name]!r}",
            f"mean = {matched.mean[row]:.4f}",
            f"deviation = {min(matched.deviation[row], 1.0):.4f}",
            f"correlations = [{', '.join(f'{each:.3f}' for each in correlation[row, :row])}]",
        ]
    return "\n".join([*lines, ""])
