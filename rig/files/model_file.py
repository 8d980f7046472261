"""The model file: what was found of a rig, so that its twin is matched.

Its values, as identification found them, read like a scenario's: [model], and [not_told], which goes with
these and says nothing by itself. Where calibration found its tolerances to lie: [[tolerances]], and what it
shows otherwise even so: [[discrepancies]]. Or how wide the tolerances of its lab are: [tolerances], read like
a scenario's.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
from annotated_types import Ge, Le
from pydantic import Strict

from daq.quantity import Key, Quantity, Text, Whole
from rig.files.faults import Faults, as_written, dotted, read_toml, toml_key
from rig.files.file_kind import read_file
from rig.files.lab_tolerances import MOST_TIMES
from rig.files.quantity import si_factor
from rig.files.table import NOTHING, read_table, read_values, unknown_keys
from rig.rigs import RIGS
from sim_twin.healthy import Matched

if TYPE_CHECKING:
    from sim_twin.diagnosis.discrepancy import Discrepancy

_KEYS = (
    "rig",
    "runs",
    "scenarios",
    "specimen",
    "model",
    "not_told",
    "identified",
    "tolerances",
    "discrepancies",
)
_MOST, _MOST_DISCREPANCIES = 400, 4000

_CORRELATIONS: Final = "a list of numbers from -1 to 1, one for each tolerance before this one"
Correlation = Annotated[float, Strict(), Ge(-1), Le(1)]


@dataclass(frozen=True, slots=True)
class _ToleranceSection:
    name: Annotated[str, Text("a text of one line, up to 200 characters")]
    nominal: Annotated[float, Quantity("", -1e18, 1e18)]
    mean: Annotated[float, Quantity("", -4, 4)]
    deviation: Annotated[float, Quantity("", 0, 1)]
    correlations: Annotated[tuple[Correlation, ...], Text(_CORRELATIONS)]
    width: Annotated[float, Quantity("", 0, MOST_TIMES)] = 1.0
    besides: Annotated[str, Text("a standard deviation as [tolerances] has it")] = ""


@dataclass(frozen=True, slots=True)
class _DiscrepancySection:
    channel: Annotated[str, Text("a channel")]
    what: Annotated[str, Text("what of it is compared")]
    deviation: Annotated[float, Quantity("", 0, 1e6)]
    partner: Annotated[str, Text("the other channel of two that are compared")] = ""
    octave: Annotated[int | None, Whole(-40, 40)] = None


@dataclass(frozen=True, slots=True)
class Identified:
    """What [[identified]] says of the value of a `key`, in SI: 95 % interval, what the scenarios had before.

    `told`: whether the runs tell it by itself.
    """

    key: Annotated[str, Text("a key of [model]")]
    low: Annotated[float, Quantity("", -1e18, 1e18)]
    high: Annotated[float, Quantity("", -1e18, 1e18)]
    was: Annotated[float | None, Quantity("", -1e18, 1e18)] = None
    told: Annotated[bool, Key()] = True


@dataclasses.dataclass(frozen=True, slots=True)
class ModelFile:
    """What was found of a `rig`, from which `runs` of a `specimen`; `text` is the file as written.

    `nominals` are the values, by tolerance, of the twin that was matched; SI. `model` holds values of keys of
    [model], told or not, and `identified` says of them, by key, how they were found. `widths` are those that
    its tolerances had, `besides` those in which others do not differ, `lab` is a table [tolerances],
    `discrepancies` are what the matched twin does otherwise.
    """

    rig: str
    runs: tuple[str, ...]
    scenarios: tuple[str, ...]
    nominals: Mapping[str, float]
    matched: Matched
    text: str
    model: Mapping[str, Any] = field(default_factory=dict)
    identified: Mapping[str, Identified] = field(default_factory=dict)
    widths: Mapping[str, float] = field(default_factory=dict)
    besides: Mapping[str, str] = field(default_factory=dict)
    lab: Mapping[str, Any] = field(default_factory=dict)
    discrepancies: tuple[Discrepancy, ...] = ()
    specimen: str | None = None

    def of_another(self, specimen: str | None) -> bool:
        """Whether it is of another specimen, where both are known."""
        return None not in (self.specimen, specimen) and self.specimen != specimen


def load_model(path: str | Path, rig: str, specimen: str | None = None) -> ModelFile:
    """Read a model of `rig`; raises ConfigurationError with every fault in the file, or of another rig.

    `specimen` is what it is to stand for, where that is known: a model of another one is refused.
    """
    model, faults = parse_model(read_file(path, "model"), str(path), rig), Faults(str(path))
    if model.of_another(specimen):
        told = f"{as_written(specimen)}, which scenario or runs are of by their [notes]"
        faults.add("specimen", model.specimen, f"{told}; calibrate that one, or leave --model out")
    faults.raise_if_any()
    return model


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
    specimen = table.get("specimen")
    if not isinstance(specimen, str | None):
        faults.add("specimen", specimen, "a text")
    model, identified = _found(table, rig, faults) if rig in RIGS else ({}, {})
    tables = table.get("tolerances", [])
    lab = tables if isinstance(tables, dict) else {}
    sections = [] if lab or ("tolerances" not in table and model) else _sections(tables, faults)
    discrepancies = tuple(_discrepancies(table.get("discrepancies", []), faults))
    faults.raise_if_any()
    count = len(sections)
    correlation = np.eye(count)
    for row, each in enumerate(sections):
        correlation[row, :row] = correlation[:row, row] = each.correlations
    # Three digits of each number leave eigenvalues right to about their sum.
    if count and np.linalg.eigvalsh(correlation)[0] < -1e-3 * count:
        faults.add("tolerances", [], "correlations that can be at the same time")
    deviation = np.array([each.deviation for each in sections])
    mean = np.array([each.mean for each in sections])
    matched = Matched(
        tuple(each.name for each in sections), mean, correlation * np.outer(deviation, deviation)
    )
    faults.raise_if_any()
    nominals = {each.name: each.nominal for each in sections}
    widths = {each.name: each.width for each in sections if each.width != 1}
    found = ModelFile(rig, texts["runs"], texts["scenarios"], nominals, matched, text)
    return dataclasses.replace(
        found,
        model=model,
        identified=identified,
        widths=widths,
        besides={each.name: each.besides for each in sections if each.besides},
        lab=lab,
        discrepancies=discrepancies,
        specimen=specimen,
    )


def _found(
    table: Mapping[str, Any], rig: str, faults: Faults
) -> tuple[dict[str, Any], dict[str, Identified]]:
    """Values that were identified, told or not, and how each was."""
    values = {
        name: read_values(RIGS[rig].model, table.get(name, {}), name, faults) or {}
        for name in ("not_told", "model")
    }
    model = {key: value for held in values.values() for key, value in held.items()}
    identified = dict(_identified(table.get("identified", []), model, faults))
    for name, held in values.items():
        for key, value in held.items():
            if not isinstance(value, float):
                faults.add(f"{name}.{key}", value, "a key of one number that is no count")
            elif key not in identified:
                faults.missing(f"{name}.{key}", "a table [[identified]] that says how it was found")
    return model, identified


def _identified(tables: object, model: Mapping[str, Any], faults: Faults) -> Iterator[tuple[str, Identified]]:
    if not isinstance(tables, list) or len(tables) > _MOST:
        faults.add("identified", tables, f"tables [[identified]], up to {_MOST}")
        return
    for index, table in enumerate(tables):
        key = f"identified[{index + 1}]"
        section = read_table(Identified, table, key, faults)
        if section is not None and section.key not in model:
            faults.unknown(f"{key}.key", section.key, section.key, model, "key of its [model] or [not_told]")
        elif section is not None:
            yield section.key, section


def _discrepancies(tables: object, faults: Faults) -> Iterator[Discrepancy]:
    if not isinstance(tables, list) or len(tables) > _MOST_DISCREPANCIES:
        faults.add("discrepancies", tables, f"tables [[discrepancies]], up to {_MOST_DISCREPANCIES}")
        return
    from sim_twin.diagnosis.discrepancy import Discrepancy  # a run without a model needs no diagnosis

    for index, table in enumerate(tables):
        section = read_table(_DiscrepancySection, table, f"discrepancies[{index + 1}]", faults)
        if section is not None:
            yield Discrepancy(**dataclasses.asdict(section))


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


def head_text(
    rig: str, runs: Sequence[str], scenarios: Sequence[str], specimen: str | None = None
) -> list[str]:
    """The lines that a model file begins with, after its remarks."""
    head: dict[str, Any] = {"rig": rig, "runs": list(runs), "scenarios": list(scenarios)}
    head |= {} if specimen is None else {"specimen": specimen}
    return [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in head.items()]


def identified_text(
    rig: str, values: Mapping[str, float], identified: Mapping[str, Identified], remarks: Mapping[str, str]
) -> list[str]:
    """The lines of a model file that say which values (SI) were found; `remarks` of them are for people."""
    known = RIGS[rig].model
    lines: list[str] = []
    for table, told in (("model", True), ("not_told", False)):
        held = {key: value for key, value in values.items() if identified[key].told is told}
        lines += ["", f"[{table}]"] if held else []
        for key, value in held.items():
            unit = getattr(known[key].meaning, "unit", "")
            text = f"{value / si_factor(unit):.6g} {unit}".strip()
            lines.append(f"{toml_key(key)} = {json.dumps(text) if unit else text}  # {remarks[key]}")
    for each in identified.values():
        lines += ["", "[[identified]]", f'key = "{each.key}"', f"low = {each.low!r}", f"high = {each.high!r}"]
        lines += [] if each.was is None else [f"was = {each.was!r}"]
        lines += [] if each.told else ["told = false"]
    return lines


def as_identified(model: ModelFile) -> list[str]:
    """The lines of a model file of what identification found in another."""
    said = dict.fromkeys(model.model, "as rattle identify found it")
    return identified_text(model.rig, model.model, model.identified, said) if model.model else []


def model_text(
    rig: str,
    runs: Sequence[str],
    scenarios: Sequence[str],
    nominals: Mapping[str, float],
    matched: Matched,
    remarks: Mapping[str, str],
    widths: Mapping[str, float] = NOTHING,
    besides: Mapping[str, str] = NOTHING,
    before: Sequence[str] = (),
    discrepancies: Sequence[Discrepancy] = (),
    specimen: str | None = None,
) -> str:
    """The text of a model file; `remarks` say of each tolerance in physical terms what was found.

    `before` are lines of what was known of the rig before.
    """
    deviation = np.maximum(matched.deviation, 1e-12)
    correlation = np.asarray(matched.covariance / np.outer(deviation, deviation))
    lines = [
        "# What a healthy rig may differ by, as rattle calibrate found it; for --model.",
        "# mean and deviation in standard deviations of healthy rigs (0 and 1: the runs do not tell).",
        *head_text(rig, runs, scenarios, specimen),
        *before,
    ]
    for row, name in enumerate(matched.names):
        lines += [
            "",
            "[[tolerances]]",
            f'name = "{name}"' + (f"  # {remarks[name]}" if name in remarks else ""),
            f"nominal = {nominals[name]!r}",
            *([f"width = {widths[name]!r}"] if name in widths else []),
            *([f"besides = {json.dumps(besides[name])}"] if name in besides else []),
            f"mean = {matched.mean[row]:.4f}",
            f"deviation = {min(matched.deviation[row], 1.0):.4f}",
            f"correlations = [{', '.join(f'{each:.3f}' for each in correlation[row, :row])}]",
        ]
    for each in discrepancies:
        lines += ["", "[[discrepancies]]", f'channel = "{each.channel}"', f'what = "{each.what}"']
        lines += [f'partner = "{each.partner}"'] if each.partner else []
        lines += [] if each.octave is None else [f"octave = {each.octave}  # {2.0**each.octave:.3g} Hz"]
        lines += [f"deviation = {each.deviation:.4g}"]
    return "\n".join([*lines, ""])
