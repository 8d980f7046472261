"""`rattle predict`, `effects` and `ensemble`: the twin alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from daq.errors import RattleError
from rig.commands.arguments import EffectsFile, Json, Model, ScenarioFile, print_json
from rig.session.pace import Work
from rig.session.progress import MOTION_S, Screen, Terminal

if TYPE_CHECKING:
    from rig.ensembles import Outcomes


def predict(
    scenario_file: ScenarioFile,
    out: Annotated[Path, typer.Option("--out", metavar="FILE.mcap", help="The log to write.")],
    effects: EffectsFile = None,
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="A healthy rig with noise instead of the nominal.")
    ] = None,
    model: Model = None,
    as_json: Json = False,
) -> None:
    from rig.files.model_file import load_model
    from rig.files.out_folder import require_new
    from rig.files.scenario import load_scenario
    from rig.twin.logged import with_model
    from rig.twin.prediction_file import write_prediction
    from rig.twin.scenario_twin import twin_of, with_effects

    require_new(out, "predicted")
    scenario = load_scenario(scenario_file)
    screen, wanted = Screen(Terminal(stderr=as_json)), scenario.acquisition
    twin = twin_of(scenario)
    fitted = None if model is None else load_model(model, scenario.rig, scenario.specimen)
    if fitted is not None:
        twin = with_model(twin, fitted, scenario, screen.warn)
    if effects is not None:
        twin = with_effects(twin, effects)
    work = Work(
        f"predict {scenario.rig}{' with figures' if as_json else ''}", wanted.settle + wanted.duration
    )
    with screen.bar("simulating", wanted.duration, MOTION_S, work) as bar:
        drawn = write_prediction(scenario, twin, seed, out, effects, fitted, bar)
        values = drawn.model.solver_values(drawn, wanted.settle, wanted.duration) if as_json else None
    if values is not None:
        print_json(values)
    screen.say(f"log        {out}")


def effects(scenario_file: ScenarioFile, machine: Json = False) -> None:
    from rig.files.scenario import load_scenario
    from rig.twin.scenario_twin import twin_of

    twin = twin_of(load_scenario(scenario_file))
    if machine:
        print_json(
            [
                {
                    "name": effect.name,
                    "location": effect.location,
                    "parameters": {name: values.allowed for name, values in effect.asked.items()},
                    "refused": effect.refusal(twin) or None,
                }
                for effect in twin.model.effects.values()
            ]
        )
        return
    table = Table(box=None, pad_edge=False)
    for column in ("effect", "where", "parameter", "may be"):
        table.add_column(column, no_wrap=column != "may be", overflow="fold")
    for effect in twin.model.effects.values():
        reason = effect.refusal(twin)
        rows = (
            {"": f"not here: {reason}"}
            if reason
            else {name: "\n".join(each.words) or each.allowed for name, each in effect.asked.items()}
        )
        names = [(effect.name, effect.location)] + [("", "")] * len(rows)
        for (name, where), (parameter, values) in zip(names, rows.items(), strict=False):
            table.add_row(name, where, parameter, values)
    Screen(Terminal()).console.print(table)


_QUEUED = 4
"""Pieces of work with each worker, so that none waits for the next."""


def ensemble(
    scenario_file: ScenarioFile,
    runs: Annotated[int, typer.Option("--runs", min=1, help="How many rigs to draw.")] = 200,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed draws the same rigs.")] = 0,
    effects: EffectsFile = None,
    model: Model = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Worker processes; without: one a core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="tcp://HOST:PORT", help="A Dask cluster does the work."),
    ] = None,
    surrogate: Annotated[
        Path | None,
        typer.Option(
            "--surrogate", metavar="MODEL.npz", help="It stands in, where its own test allows of it."
        ),
    ] = None,
    settings_only: Annotated[
        bool,
        typer.Option(
            "--settings-only", help="With --surrogate, which knows no more: only clearances and speed differ."
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.csv", help="Write one row a run.")
    ] = None,
    machine: Json = False,
) -> None:
    from rig import ensembles
    from rig.files.model_file import load_model
    from rig.files.scenario import load_scenario
    from rig.twin.logged import with_model
    from rig.twin.scenario_twin import twin_of, with_effects
    from sim_twin.ensembles.figures import Figures
    from sim_twin.ensembles.population import Population
    from sim_twin.ensembles.simulate import simulate

    if scheduler is not None and workers is not None:
        raise typer.BadParameter("the cluster has its own workers", param_hint="--workers")
    if settings_only and surrogate is None:
        raise typer.BadParameter("only what a surrogate stands in for", param_hint="--settings-only")
    scenario = load_scenario(scenario_file)
    if out is not None and not out.absolute().parent.is_dir():
        raise RattleError(f"{out}: its folder does not exist; make it first, nothing was simulated")
    twin, screen = twin_of(scenario), Screen(Terminal(stderr=machine))
    if model is not None:
        twin = with_model(twin, load_model(model, scenario.rig, scenario.specimen), scenario, screen.warn)
    population = Population(twin if effects is None else with_effects(twin, effects), any_phase=False)
    if scheduler is None:
        source = ensembles.worker_processes(workers or ensembles.cores())
    else:
        source = ensembles.cluster(scheduler)
    wanted, a_glance = scenario.acquisition, Figures(0.0, 1e-3)
    variants, figures = population.variants(runs, seed), Figures(wanted.settle, wanted.duration)
    if surrogate is not None:
        from rig.surrogates.standing_in import stood_in

        if effects is not None or model is not None:
            raise typer.BadParameter("a surrogate knows no effects and no model", param_hint="--surrogate")
        outcomes, by = stood_in(surrogate, scenario, variants, settings_only)
        _told(outcomes, seed, machine, screen, out, by)
        return
    with source as found:
        with screen.busy("compiling"):  # by one worker; the others find the machine code on the disk
            simulate(variants[:1], a_glance, found.executor)
        each_s = wanted.settle + wanted.duration
        work = Work(f"ensemble {scenario.rig} on {scheduler or found.count}", runs * each_s)
        with screen.bar("simulating", runs, "runs", work) as bar:
            queued = _QUEUED * found.count
            outcomes = simulate(variants, figures, found.executor, lambda done, _: bar(done), queued)
    _told(outcomes, seed, machine, screen, out)


def _told(
    outcomes: Outcomes, seed: int, machine: bool, screen: Screen, out: Path | None, by: str = ""
) -> None:
    """Show what many rigs came to, and write it; `by` whom where they were not simulated."""
    from rig import ensembles
    from sim_twin.ensembles.figures import spread_of

    spreads, failed = spread_of(outcomes), ensembles.failure_lines(outcomes)
    if not any(outcome.value is not None for outcome in outcomes):
        raise RattleError("; ".join(failed))
    if machine:
        print_json(ensembles.as_json(outcomes, seed) | ({"by": by} if by else {}))
    else:
        if by:
            screen.say(by)
        screen.console.print(ensembles.spread_table(spreads))
    for line in failed:
        screen.warn(line)
    if out is not None:
        ensembles.write_runs(outcomes, out, by)
