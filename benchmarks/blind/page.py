"""The printed page of the check."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from benchmarks.blind.figure import Measured

_WIDTH = 58


def page(
    judged: Sequence[Measured],
    beside: Sequence[Measured],
    baselines: Mapping[str, Sequence[float]],
    confusion: Mapping[str, Mapping[str, int]],
    notes: Sequence[str],
) -> str:
    """Figures against their bars, baselines, what else was measured, and what was taken for what."""
    parts = (_figures(judged), _beside(judged, baselines), _figures(beside), _confusion(confusion), notes)
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def _figures(figures: Sequence[Measured]) -> Iterator[str]:
    yield f"{'':{_WIDTH}} {'value':>7}  {'95 % interval':15} {'cases':>5}  bar"
    for each in figures:
        interval = "" if each.interval is None else " to ".join(f"{end:.3f}" for end in each.interval)
        bar = "" if each.bar is None else f"{each.bar!s:13} {_verdict(each.met)}"
        yield f"{each.what:{_WIDTH}} {_number(each.value):>7}  {interval:15} {each.count:5d}  {bar}".rstrip()


def _verdict(met: bool | None) -> str:
    return {True: "met", False: "MISSED", None: ""}[met]


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf"
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.3f}"


def _beside(judged: Sequence[Measured], baselines: Mapping[str, Sequence[float]]) -> Iterator[str]:
    yield f"{'':{_WIDTH}} {'ours':>7}" + "".join(f"{name:>15}" for name in baselines)
    for row, each in enumerate(judged):
        others = "".join(f"{_number(values[row]):>15}" for values in baselines.values())
        yield f"{each.what:{_WIDTH}} {_number(each.value):>7}{others}"


def _confusion(table: Mapping[str, Mapping[str, int]]) -> Iterator[str]:
    yield "what was hidden: what was answered first"
    for truth, answers in table.items():
        said = ", ".join(f"{label} {number}" for label, number in answers.items())
        yield f"  {truth:36} {said}"
