"""`rattle ensemble`: what many healthy rigs of one scenario do."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from daq.errors import RattleError
from rig.commands.arguments import EffectsFile, Json, ScenarioFile, print_json
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.ensembles.executors import Workers
    from rig.ensembles.table import Outcomes
    from rig.files.scenario import Scenario
    from sim_twin.ensembles.population import Population

_QUEUED = 4
"""Pieces of work with each worker, so that none waits for the next."""


def ensemble(
    scenario_file: ScenarioFile,
    runs: Annotated[int, typer.Option("--runs", min=1, help="How many rigs to draw.")] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed draws the same rigs.")] = 0,
    effects: EffectsFile = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Worker processes; without: one a core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://HOST:PORT", help="A Dask cluster does the work."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.csv", help="Write one row a run.")
    ] = None,
    machine: Json = False,
) -> None:
    from rig.ensembles.executors import cluster, cores, worker_processes
    from rig.ensembles.table import write_runs
    from rig.files.scenario import load_scenario

    if scheduler is not None and workers is not None:
        raise typer.BadParameter("the cluster has its own workers", param_hint="--workers")
    scenario = load_scenario(scenario_file)
    if out is not None and not out.absolute().parent.is_dir():
        raise RattleError(f"{out}: its folder does not exist; make it first, nothing was simulated")
    population = _population(scenario, effects)
    screen = Screen(Console(stderr=machine))
    source = worker_processes(workers or cores()) if scheduler is None else cluster(scheduler)
    outcomes = _simulated(scenario, population, runs, seed, source, screen)
    _show(outcomes, seed, screen, machine)
    if out is not None:
        write_runs(outcomes, out)


def _population(scenario: Scenario, effects: Path | None) -> Population:
    from rig.twin.scenario_twin import twin_of, with_effects
    from sim_twin.ensembles.population import Population

    twin = twin_of(scenario)
    return Population(twin if effects is None else with_effects(twin, effects), any_phase=False)


def _simulated(
    scenario: Scenario,
    population: Population,
    runs: int,
    seed: int,
    source: AbstractContextManager[Workers],
    screen: Screen,
) -> Outcomes:
    from sim_twin.ensembles.figures import Figures
    from sim_twin.ensembles.simulate import simulate

    wanted, a_glance = scenario.acquisition, Figures(0.0, 1e-3)
    variants, figures = population.variants(runs, seed), Figures(wanted.settle, wanted.duration)
    with source as workers:
        with screen.busy("compiling"):  # by one worker; the others find the machine code on the disk
            simulate(variants[:1], a_glance, workers.executor)
        with screen.bar("simulating", runs, "runs") as bar:
            queued = _QUEUED * workers.count
            return simulate(variants, figures, workers.executor, lambda done, _: bar.at(done), queued)


def _show(outcomes: Outcomes, seed: int, screen: Screen, machine: bool) -> None:
    from rig.ensembles.table import as_json, failure_lines, spread_table
    from sim_twin.ensembles.summary import spread_of

    spreads, failed = spread_of(outcomes), failure_lines(outcomes)
    if not any(outcome.value is not None for outcome in outcomes):
        raise RattleError("; ".join(failed))
    if machine:
        print_json(as_json(outcomes, seed))
    else:
        screen.console.print(spread_table(spreads))
    for line in failed:
        screen.warn(line)
