"""Arguments that several commands share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from daq.errors import ConfigurationError, Problem
from rig.files.bench import Bench, embedded_bench, load_bench
from rig.files.file_kind import refuse_other_than_log
from rig.files.scenario import Scenario, load_scenario

ScenarioFile = Annotated[Path, typer.Argument(metavar="SCENARIO.toml", help="What to run.")]


def _is_log(path: Path) -> Path:
    refuse_other_than_log(path)
    return path


def _are_logs(paths: list[Path]) -> list[Path]:
    return [_is_log(path) for path in paths]


RunFile = Annotated[Path, typer.Argument(metavar="RUN.mcap", help="The log of a run.", callback=_is_log)]
RunFiles = Annotated[
    list[Path],
    typer.Argument(metavar="RUN.mcap...", help="Logs of runs of one rig.", callback=_are_logs),
]
BenchFile = Annotated[
    Path | None,
    typer.Option("--bench", metavar="BENCH.toml", help="Which instrument hangs where. Without: emulated."),
]
EffectsFile = Annotated[
    Path | None, typer.Option("--effects", metavar="EFFECTS.json", help="Effects that the twin gets.")
]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="MODEL.toml", help="What rattle calibrate found of the rig."),
]
Json = Annotated[bool, typer.Option("--json", help="Print machine-readable output.")]
Live = Annotated[bool, typer.Option("--live", help="Show it in a browser while it goes on.")]


RUNS = Path("runs")
"""Where logs go unless another folder is named."""


def load_pair(scenario_file: Path, bench_file: Path | None) -> tuple[Scenario, Bench]:
    """Scenario and bench (the emulated one without a file); raises one error with the faults of both."""
    errors: list[ConfigurationError] = []
    scenario = bench = None
    try:
        scenario = load_scenario(scenario_file)
    except ConfigurationError as error:
        errors.append(error)
    rig = None if scenario is None else scenario.rig
    try:
        if bench_file is not None:
            bench = load_bench(bench_file, rig)
        elif rig is not None:
            bench = embedded_bench(rig)
    except ConfigurationError as error:
        errors.append(error)
    if errors or scenario is None or bench is None:
        raise _joined(errors)
    return scenario, bench


def bench_of(rig: str, bench_file: Path | None) -> Bench:
    """The bench of a file, or the emulated one of a rig."""
    return embedded_bench(rig) if bench_file is None else load_bench(bench_file, rig)


def _joined(errors: list[ConfigurationError]) -> ConfigurationError:
    if len(errors) == 1:
        return errors[0]
    problems = [
        Problem(f"{error.source}: {problem.key}", problem.value, problem.allowed)
        for error in errors
        for problem in error.problems
    ]
    return ConfigurationError(" and ".join(error.source for error in errors), problems)


def print_json(result: object) -> None:
    """Print a result for another program."""
    typer.echo(json.dumps(result, indent=2, allow_nan=False))
