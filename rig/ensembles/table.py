"""An ensemble's figures for a person, for a program and as a table of all runs."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from daq.errors import RattleError
from sim_twin.ensembles.summary import Spread, failures, spread_of
from sim_twin.ensembles.variant import Outcome
from sim_twin.rigs.side_by_side import RunFigures

Outcomes = Sequence[Outcome[RunFigures]]
_COLUMNS = ("runs", "mean", "sd", "5 %", "50 %", "95 %")


def spread_table(spreads: Mapping[str, Spread]) -> Table:
    """One row a figure; the end of its name is its unit."""
    table = Table(box=None, pad_edge=False)
    table.add_column("figure", no_wrap=True)
    for column in _COLUMNS:
        table.add_column(column, justify="right")
    for name, spread in spreads.items():
        numbers = (spread.mean, spread.deviation, spread.p5, spread.median, spread.p95)
        table.add_row(name, str(spread.runs), *(_figure(x) for x in numbers))
    return table


def _figure(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e9 else f"{value:.4g}"


def failure_lines(outcomes: Outcomes) -> list[str]:
    """One line for each way in which runs failed."""
    lines = (
        (count, status.name.lower().replace("_", " "), status.advice)
        for status, count in failures(outcomes).items()
    )
    return [f"{count} of {len(outcomes)} runs {name}: {advice}" for count, name, advice in lines]


def as_json(outcomes: Outcomes, seed: int) -> dict[str, Any]:
    """The same for a program."""
    return {
        "runs": len(outcomes),
        "seed": seed,
        "failed": {status.name.lower(): count for status, count in failures(outcomes).items()},
        "figures": {name: asdict(spread) for name, spread in spread_of(outcomes).items()},
    }


def write_runs(outcomes: Outcomes, path: Path) -> None:
    """One row a run, in order: its number, how it ended, its figures; what it does not have is empty."""
    names = list(dict.fromkeys(name for each in outcomes if each.value for name in each.value.values))
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["run", "status", *names])
            for run, each in enumerate(outcomes):
                values = {} if each.value is None else each.value.values
                rows.writerow([run, each.status.name.lower(), *(values.get(name) for name in names)])
    except OSError as error:
        raise RattleError(f"{path}: cannot be written ({error.strerror})") from error
