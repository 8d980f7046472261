"""Arguments that several commands share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from rig.files.bench import Bench, embedded_bench, load_bench

ScenarioFile = Annotated[Path, typer.Argument(metavar="SCENARIO.toml", help="What to run.")]
RunFile = Annotated[Path, typer.Argument(metavar="RUN.mcap", help="The log of a run.")]
BenchFile = Annotated[
    Path | None,
    typer.Option("--bench", metavar="BENCH.toml", help="Which instrument hangs where. Without: emulated."),
]
EffectsFile = Annotated[
    Path | None, typer.Option("--effects", metavar="EFFECTS.json", help="Effects that the twin gets.")
]
Json = Annotated[bool, typer.Option("--json", help="Print machine-readable output.")]
Live = Annotated[bool, typer.Option("--live", help="Show it in a browser while it goes on.")]


def bench_of(path: Path | None) -> Bench:
    """The bench of a file, or the emulated one."""
    return embedded_bench() if path is None else load_bench(path)


def print_json(result: object) -> None:
    """Print a result for another program."""
    typer.echo(json.dumps(result, indent=2, allow_nan=False))
