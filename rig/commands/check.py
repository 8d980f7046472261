"""`rattle check`: every fault of a file at once."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Final

import typer

from daq.errors import ConfigurationError, Problem
from rig.files.bench import embedded_bench, load_bench
from rig.files.check import CheckedKind, validate
from rig.files.pairing import check_bench, check_pair, check_scenario
from rig.files.scenario import load_scenario
from rig.files.sweep import load_sweep
from rig.session.sweep.plan import check_points
from rig.twin.scenario_twin import check_twin


def add_to(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def check(
        file: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario, bench or sweep.")],
        bench_file: Annotated[
            Path | None,
            typer.Option("--bench", metavar="BENCH.toml", help="Check a scenario or sweep on this bench."),
        ] = None,
    ) -> None:
        """Validate a scenario, bench or sweep file; lists every error at once. Nothing moves."""
        kind = validate(file)
        _CHECKS[kind](file, bench_file, datetime.datetime.now(datetime.UTC).date())
        typer.echo(f"{file}: {kind}, no faults{'' if bench_file is None else f' on {bench_file}'}")


def _check_scenario(file: Path, bench_file: Path | None, today: datetime.date) -> None:
    scenario = load_scenario(file)
    check_twin(scenario)
    if bench_file is not None:
        check_pair(scenario, load_bench(bench_file, scenario.rig), today)
        return
    check_scenario(scenario, str(file))
    try:
        check_pair(scenario, embedded_bench(scenario.rig), today)
    except ConfigurationError as error:
        # Another bench may well allow it: no fault of the scenario.
        for problem in error.problems:
            typer.echo(f"! needs a bench of its own, the emulated one refuses {problem}")


def _check_bench(file: Path, bench_file: Path | None, today: datetime.date) -> None:
    if bench_file is not None:
        allowed = "a scenario or a sweep to check on it"
        raise ConfigurationError(str(bench_file), [Problem("--bench", f"beside {file}, a bench", allowed)])
    check_bench(load_bench(file), today)


def _check_sweep(file: Path, bench_file: Path | None, today: datetime.date) -> None:
    if bench_file is not None:
        swept = load_sweep(file)
        check_points(swept, load_bench(bench_file, swept.rig), today)


_CHECKS: Final[Mapping[CheckedKind, Callable[[Path, Path | None, datetime.date], None]]] = {
    "scenario": _check_scenario,
    "bench": _check_bench,
    "sweep": _check_sweep,
}
