"""`rattle run`: drive the rig, record, predict, overlay."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from rig.commands.arguments import RUNS, BenchFile, Live, Model, ScenarioFile, load_pair
from rig.session.progress import Screen


def run(
    scenario_file: ScenarioFile,
    bench_file: BenchFile = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where logs go.")] = RUNS,
    live: Live = False,
    model: Model = None,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.model_file import load_model
    from rig.files.pairing import check_pair
    from rig.session.run import RunRequest, run_scenario
    from rig.twin.scenario_twin import check_twin

    screen = Screen(Console(stderr=False))
    scenario, bench = load_pair(scenario_file, bench_file)
    fitted = None if model is None else load_model(model, scenario.rig)
    clock = SystemClock()
    check_pair(scenario, bench, datetime.datetime.now(datetime.UTC).date())
    check_twin(scenario)
    request = RunRequest(scenario, bench, connect, out, live, fitted)
    log = run_scenario(request, screen, clock)

    # The rig stands: what its report takes, most of scipy, is loaded only now.
    from rig.commands.logs import report_and_name, show
    from rig.report.record import read_run

    recorded = read_run(log)
    show(recorded, screen)
    report_and_name(recorded, screen)
