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
    """Figures against their bars and the baselines, what else was measured, and what was taken for what."""
    others = [[values[row] for values in baselines.values()] for row in range(len(judged))]
    parts = (_figures(judged, others, tuple(baselines)), _figures(beside), _confusion(confusion), notes)
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def _figures(
    figures: Sequence[Measured], others: Sequence[Sequence[float]] = (), names: Sequence[str] = ()
) -> Iterator[str]:
    """`others`: each figure as the baselines `names` have it."""
    heads = "".join(f"{name:>15}" for name in names)
    yield f"{'':{_WIDTH}} {'value':>7}  {'95 % interval':17} {'cases':>5}  {'bar':20}{heads}".rstrip()
    for row, each in enumerate(figures):
        interval = "" if each.interval is None else " to ".join(map(_number, each.interval))
        bar = "" if each.bar is None else f"{each.bar!s:12} {_verdict(each.met)}"
        beside = "".join(f"{_number(value):>15}" for value in others[row]) if others else ""
        line = (
            f"{each.what:{_WIDTH}} {_number(each.value):>7}  {interval:17} {each.count:5d}  {bar:20}{beside}"
        )
        yield line.rstrip()


def _verdict(met: bool | None) -> str:
    return {True: "met", False: "MISSED", None: ""}[met]


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf"
    return f"{value:.0f}" if abs(value) >= 10 else f"{value:.3f}"


def _confusion(table: Mapping[str, Mapping[str, int]]) -> Iterator[str]:
    yield "what was hidden: what was answered first"
    for truth, answers in table.items():
        said = ", ".join(f"{label} {number}" for label, number in answers.items())
        yield f"  {truth:36} {said}"
