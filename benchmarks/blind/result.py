"""The score as a file: every figure, the baselines, and each campaign with its answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from benchmarks.blind.cases import Case
from benchmarks.blind.figure import Measured

Confusion: TypeAlias = dict[str, dict[str, int]]


def as_json(
    judged: Sequence[Measured],
    beside: Sequence[Measured],
    baselines: Mapping[str, Sequence[float]],
    table: Confusion,
    notes: Sequence[str],
    cases: Sequence[Case],
) -> dict[str, Any]:
    """What score.json holds; numbers without a meaning are null."""
    return {
        "schema": "rattle.blind_check/2",
        "notes": list(notes),
        "figures": [_figure_json(each) for each in (*judged, *beside)],
        "baselines": {
            name: {figure.what: _finite(value) for figure, value in zip(judged, values, strict=True)}
            for name, values in baselines.items()
        },
        "confusion": table,
        "campaigns": [_case_json(case) for case in cases],
    }


def _figure_json(figure: Measured) -> dict[str, Any]:
    return {
        "what": figure.what,
        "value": _finite(figure.value),
        "ci95": None if figure.interval is None else [_finite(end) for end in figure.interval],
        "count": figure.count,
        "bar": None if figure.bar is None else str(figure.bar),
        "met": figure.met,
    }


def _case_json(case: Case) -> dict[str, Any]:
    gaps, answer = case.gaps, case.answer
    return {
        "name": case.campaign.name,
        "rig": case.campaign.rig,
        "kind": case.campaign.kind,
        "set": case.campaign.of_set,
        "calibrated": case.calibrated,
        "hidden": list(case.campaign.effects),
        "gap": None if gaps is None else {"before": gaps.before, "oracle": gaps.oracle, "after": gaps.after},
        "visible": case.visible,
        "first_answers": None if answer is None else [list(pair) for pair in answer.ranking()[:3]],
        "selected": None if answer is None else list(answer.selected),
        "place": None if answer is None else answer.place,
        "wall_s": case.wall_s,
        "cpu_s": case.cpu_s,
        "memory_mb": case.memory_mb,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
