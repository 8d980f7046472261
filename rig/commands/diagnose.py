"""`rattle diagnose`, `gap` and `calibrate`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from daq.errors import RattleError
from rig.commands.arguments import EffectsFile, Json, Model, RunFiles, print_json
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rig.diagnosis.recordings import RecordedCampaign
    from sim_twin.diagnosis.matching import Match


Seed = Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same answer.")]
_LISTED = 4
_WORTH_LISTING = 0.005


def diagnose(
    runs: RunFiles,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the answer goes.")],
    model: Model = None,
    seed: Seed = 0,
    budget: Annotated[
        float,
        typer.Option("--budget", min=10.0, metavar="SECONDS", help="What it takes two free cores, about."),
    ] = 120.0,
    effort: Annotated[
        float,
        typer.Option("--effort", min=0.1, max=20.0, help="So many times what fits into the budget."),
    ] = 1.0,
    machine: Json = False,
) -> None:
    from rig.diagnosis.diagnose_runs import diagnose_runs

    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is a file; name a folder", param_hint="--out")
    screen = Screen(Terminal(stderr=machine))
    findings, files = diagnose_runs(runs, model, out, seed, budget, screen, effort)
    if machine:
        typer.echo(files["diagnosis"].read_text(encoding="utf-8"), nl=False)
        return
    lines = {"nothing is missing": findings.none, "something unknown": findings.unknown}
    for each in findings.judged[:_LISTED]:
        where = f" on {each.cause.channel}" if each.cause.channel else ""
        lines[f"{each.cause.name}{where}"] = each.probability
    for text, share in sorted(lines.items(), key=lambda item: -item[1]):
        if share >= _WORTH_LISTING:
            screen.say(f"{share:6.1%}  {text}")
    known = findings.selected and findings.gap.after is not None
    names = " and ".join(cause.name for cause in findings.selected)
    after = f" -> {findings.gap.after:.2f} with {names} in the twin" if known else ""
    if findings.selected and not known:
        after = f" (no time to simulate the twin with {names} in it: more --budget)"
    screen.say(f"gap        {findings.gap.before:.2f}{after}   (1 = as far as a healthy rig)")
    for what, file in files.items():
        screen.say(f"{what:<10} {file}")


def gap(
    runs: RunFiles, effects: EffectsFile = None, model: Model = None, seed: Seed = 0, machine: Json = False
) -> None:
    from rig.diagnosis.diagnose_runs import measured_gap

    screen = Screen(Terminal(stderr=machine))
    found = measured_gap(runs, model, effects, seed, screen)
    if machine:
        print_json(found)
        return
    screen.say(f"gap     {found['before']:.2f}   (1 = as far as a healthy rig)")
    if effects is not None:
        shrink = "" if found["shrink"] is None else f"   shrink {found['shrink']:.0%}"
        screen.say(f"with {effects.name}   {found['after']:.2f}{shrink}")


_TOLD = 0.9
"""Of its deviation before: a tolerance that is still as open was not told by the runs."""


def calibrate(
    runs: RunFiles,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="MODEL.toml", help="The model to write.")],
    rigs: Annotated[int, typer.Option("--rigs", min=100, help="How many healthy rigs to simulate.")] = 400,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same model.")] = 0,
    budget: Annotated[float, typer.Option("--budget", min=1, help="Seconds to simulate, at most.")] = 600,
) -> None:
    from daq.log.reader import LogReader
    from rig.diagnosis.recordings import recorded
    from rig.twin.logged import as_model_text, followed_scenario, found

    if out.exists():
        raise RattleError(f"{out} is there already; remove it or name another, nothing was calibrated")
    if not out.resolve().parent.is_dir():
        raise RattleError(f"{out.parent}: no such folder; nothing was calibrated")
    screen = Screen(Terminal())
    with screen.busy("reading"):
        read = recorded(runs)
    for remark in read.remarks:
        screen.warn(remark)
    outcome = _match(read, rigs, seed, budget, screen)
    if not outcome.healthy:
        text = f"their misfit is {outcome.misfit:.2g}, where one healthy rig in a hundred passes 1"
        if outcome.suspicious:
            text += f", and they ask for too much of {', '.join(outcome.suspicious)}"
        raise RattleError(
            f"these runs are not of a healthy rig: {text}. A model of them would hide what is wrong, so none "
            f"was written; rattle diagnose tells what it is"
        )
    twin = read.campaign.runs[0].twin
    known = outcome.matched
    table = Table("tolerance", "found", "of its deviation", box=None, pad_edge=False)
    deviation = dict(zip(known.names, known.deviation, strict=True))
    for each in twin.model.lasting_tolerances(twin):
        if deviation[each.name] < _TOLD:
            place = f"{known.mean_of(each.name):+.2f} +- {deviation[each.name]:.2f}"
            table.add_row(each.name, found(each, twin, known), place)
    screen.console.print(table)
    if outcome.suspicious:
        suspects = ", ".join(outcome.suspicious)
        screen.warn(f"more than three standard deviations off: {suspects}. Is the rig healthy?")
    names = []
    for run in read.paths:
        with LogReader(run) as log:
            names.append(followed_scenario(log).name)
    model = as_model_text(twin, outcome.matched, [run.name for run in read.paths], list(dict.fromkeys(names)))
    out.write_text(model, encoding="utf-8")
    screen.say(f"model      {out}")


def _match(read: RecordedCampaign, rigs: int, seed: int, budget: float, screen: Screen) -> Match:
    import numpy as np

    from rig.diagnosis.recordings import work_of
    from rig.ensembles import Simulated, cores, worker_processes
    from sim_twin.diagnosis.matching import match

    work = work_of("calibrate", read.campaign, rigs)
    with screen.bar("simulating", rigs, "healthy rigs", work) as bar, worker_processes(cores()) as workers:
        simulate = Simulated(read.campaign, workers.executor, time.monotonic() + budget, bar)
        outcome = match(read.campaign, read.measured, simulate, rigs, np.random.default_rng(seed), read.told)
    if simulate.cut_short:
        screen.warn(
            "time ran out: fewer healthy rigs were simulated than planned; another machine may fit otherwise"
        )
    return outcome
