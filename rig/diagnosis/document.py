"""diagnosis.json and effects.json, as the interface has them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from itertools import zip_longest
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from daq.disk import write_whole
from rig.diagnosis.argument import argument
from rig.diagnosis.experiments import Experiment
from rig.files.table import NOTHING
from sim_twin.diagnosis.findings import Findings, Gap, Judged
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.latent_force import Curve, LatentForce
from sim_twin.diagnosis.typical_cycle import TypicalCycle
from sim_twin.effects import Catalogue

SCHEMA = "rattle.diagnosis/1"


def provenance(seed: int) -> dict[str, Any]:
    """What makes the same answer again: the program's version and the seed."""
    return {"software": f"rattle {version('rattle')}", "seed": seed}


def document(
    findings: Findings,
    catalogue: Catalogue,
    runs: Sequence[Path],
    said: Mapping[str, Any],
    horizon_s: float | None,
    experiment: Experiment | None,
    seconds: float,
    remarks: Sequence[str],
    forces: Sequence[LatentForce] = (),
    units: Mapping[str, str] = NOTHING,
    cycles: Sequence[TypicalCycle] = (),
) -> dict[str, Any]:
    """The diagnosis as JSON holds it; `catalogue` has all effects of the rig, `forces` what joints lack.

    `said` is what was asked for, with the program's version. `units` of the channels; `cycles` are those that
    are drawn.
    """
    probabilities = {"none": findings.none, "effect": findings.effect, "unknown": findings.unknown}
    judged = {each.cause.name for each in findings.judged}
    nothing = {"probability": 0.0, "present": 0.0, "parameters": {}, "gap_after": None, "shrink": None}
    impossible = [  # for these runs, or no recorded channel can show it
        {"name": effect.name, "location": effect.location, **nothing, "indistinguishable_from": []}
        for effect in catalogue.values()
        if effect.name not in judged
    ]
    content: dict[str, Any] = _finite(
        {
            "schema": SCHEMA,
            "runs": [str(run) for run in runs],
            "verdict": findings.verdict,
            "verdict_probability": probabilities,
            "gap": gap_block(findings.layout, findings.gap, findings.by_location),
            "effects": [*(_effect(each) for each in findings.judged), *impossible],
            "selected": list(findings.names),
            "separability": [
                {"effect": one, "from": other, "told_apart": share}
                for (one, other), share in findings.separability.items()
            ],
            "horizon_s": horizon_s,
            "latent_force": [
                {
                    "run": each.run,
                    "joint": each.joint,
                    "location": each.location,
                    "against": [_curve(curve) for curve in each.curves],
                }
                for each in forces
            ],
            **argument(findings, units, cycles),
            "next_experiment": None if experiment is None else asdict(experiment),
            "cost": {
                "simulations": findings.simulations,
                "seconds": seconds,
                "searched": findings.searched,
                "judging": findings.judging,
            },
            "remarks": list(remarks),
            "provenance": dict(said),
        }
    )
    return content


def effects_file(findings: Findings) -> list[dict[str, Any]]:
    """What was selected, at its best values."""
    return [{"name": name, "parameters": dict(values)} for name, values in findings.effects]


def write_json(path: Path, content: object) -> None:
    """Write JSON without NaN; the file is whole, or not there. Raises RecorderFailed."""
    write_whole(path, f"{json.dumps(content, indent=2, allow_nan=False)}\n".encode())


def gap_block(layout: Layout, gap: Gap, by_location: Mapping[str, float]) -> dict[str, Any]:
    """The `gap` block: the whole, and by channel, run, band, phase and location."""
    runs = sorted({cell.run for cell in layout.cells})
    channels = list(dict.fromkeys(cell.channel for cell in layout.cells))
    return {
        "before": gap.before,
        "after": gap.after,
        "shrink": gap.shrink,
        "shrink_ci95": gap.shrink_ci95,
        "recording": gap.recording,
        "course": [
            {"run": run, "before": before, "after": after}
            for run, before, after in zip_longest(runs, gap.course_before, gap.course_after)
        ],
        "by_channel": {name: _part(layout, gap, "channel", name) for name in channels},
        "by_run": [_part(layout, gap, "run", run) for run in runs],
        "by_band": _by(layout, gap, lambda cell: None if cell.partner else cell.band, "low_hz", "high_hz"),
        "by_phase": _by(layout, gap, lambda cell: cell.phase, "from", "to"),
        "by_location": dict(by_location),
    }


def _by(
    layout: Layout, gap: Gap, place: Callable[[Cell], tuple[float, float] | None], low: str, high: str
) -> list[dict[str, Any]]:
    """Cells of one channel and place together, over the runs and what is told of the place."""
    squares: dict[tuple[str, float, float], list[float]] = {}
    for cell, g in zip(layout.cells, gap.cells_before, strict=True):
        ends = place(cell)
        if ends is not None:
            key = cell.channel, round(ends[0], 6), round(ends[1], 6)
            squares.setdefault(key, []).append(float(g) ** 2)
    return [
        {"channel": channel, low: first, high: last, "gap": float(np.sqrt(np.mean(each))) / gap.unit_before}
        for (channel, first, last), each in sorted(squares.items())
    ]


def _part(layout: Layout, gap: Gap, which: str, value: object) -> float:
    cells = zip(layout.cells, gap.cells_before, strict=True)
    kept = [float(g) ** 2 for cell, g in cells if getattr(cell, which) == value]
    return float(np.sqrt(np.mean(kept))) / gap.unit_before


def _effect(judged: Judged) -> dict[str, Any]:
    parameters: dict[str, Any] = {}
    if judged.cause.channel is not None:
        parameters["channel"] = {"value": judged.cause.channel}
    for name, estimate in judged.parameters.items():
        parameters[name] = {"value": estimate.value, "ci95": [estimate.low, estimate.high]}
    return {
        "name": judged.cause.name,
        "location": judged.cause.location,
        "probability": judged.probability,
        "present": judged.present,
        "parameters": parameters,
        "gap_after": judged.after,
        "shrink": judged.shrink,
        "indistinguishable_from": list(judged.indistinguishable_from),
    }


def _curve(curve: Curve) -> dict[str, Any]:
    lines = {"measured_n": curve.measured, "twin_n": curve.twin, "scatter_n": curve.scatter}
    numbers = {name: line.tolist() for name, line in lines.items()}
    return {"axis": curve.axis.name, "unit": curve.axis.unit, "edges": curve.edges.tolist(), **numbers}


def _finite(value: Any) -> Any:
    """The same with null for what is no number."""
    if isinstance(value, Mapping):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    if isinstance(value, float | np.floating):
        return float(value) if isfinite(value) else None
    return value
