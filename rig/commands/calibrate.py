"""`rattle calibrate`: fits what a healthy rig may differ by to reference runs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from daq.errors import RattleError
from rig.commands.arguments import RunFiles
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.diagnosis.recordings import RecordedCampaign
    from sim_twin.diagnosis.matching import Match
    from sim_twin.matched import Matched
    from sim_twin.twin import AnyTwin

_TOLD = 0.9
"""Of its deviation before: a tolerance that is still as open was not told by the runs."""


def calibrate(
    runs: RunFiles,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="MODEL.toml", help="The model to write.")],
    rigs: Annotated[int, typer.Option("--rigs", min=100, help="How many healthy rigs to simulate.")] = 400,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same model.")] = 0,
    budget: Annotated[float, typer.Option("--budget", min=1, help="Seconds to simulate, at most.")] = 600,
) -> None:
    from rig.diagnosis.recordings import recorded
    from rig.twin.matched_twin import as_model_text

    if out.exists():
        raise RattleError(f"{out} is there already; remove it or name another, nothing was calibrated")
    if not out.resolve().parent.is_dir():
        raise RattleError(f"{out.parent}: no such folder; nothing was calibrated")
    screen = Screen(Console())
    with screen.busy("reading"):
        read = recorded(runs)
    for remark in read.remarks:
        screen.warn(remark)
    outcome = _match(read, rigs, seed, budget, screen)
    _refuse_unhealthy(outcome)
    twin = read.campaign.runs[0].twin
    _show(twin, outcome, screen)
    text = as_model_text(twin, outcome.matched, [run.name for run in runs], _scenarios(runs))
    out.write_text(text, encoding="utf-8")
    screen.say(f"model      {out}")


def _match(read: RecordedCampaign, rigs: int, seed: int, budget: float, screen: Screen) -> Match:
    import numpy as np

    from rig.diagnosis.workers import Simulated
    from rig.ensembles.executors import cores, worker_processes
    from sim_twin.diagnosis.matching import match

    with worker_processes(cores()) as workers, screen.bar("simulating", rigs, "healthy rigs") as bar:
        simulate = Simulated(read.campaign, workers.executor, time.monotonic() + budget, bar.at)
        outcome = match(read.campaign, read.measured, simulate, rigs, np.random.default_rng(seed))
    if simulate.cut_short:
        screen.warn(
            "time ran out: fewer healthy rigs were simulated than planned; another machine may fit otherwise"
        )
    return outcome


def _refuse_unhealthy(outcome: Match) -> None:
    if outcome.healthy:
        return
    text = f"their misfit is {outcome.misfit:.2g}, where one healthy rig in a hundred passes 1"
    if outcome.suspicious:
        text += f", and they ask for too much of {', '.join(outcome.suspicious)}"
    raise RattleError(
        f"these runs are not of a healthy rig: {text}. A model of them would hide what is wrong, so none was "
        f"written; rattle diagnose tells what it is"
    )


def _show(twin: AnyTwin, outcome: Match, screen: Screen) -> None:
    from rig.twin.matched_twin import found
    from sim_twin.rigs.catalogue import model_of

    known = outcome.matched
    table = Table("tolerance", "found", "of its deviation", box=None, pad_edge=False)
    for each in model_of(twin).lasting_tolerances(twin):
        if _deviation(known, each.name) < _TOLD:
            place = f"{known.mean_of(each.name):+.2f} +- {_deviation(known, each.name):.2f}"
            table.add_row(each.name, found(each, twin, known), place)
    screen.console.print(table)
    if outcome.suspicious:
        names = ", ".join(outcome.suspicious)
        screen.warn(f"more than three standard deviations off: {names}. Is the rig healthy?")


def _deviation(known: Matched, name: str) -> float:
    return float(known.deviation[known.names.index(name)])


def _scenarios(runs: Sequence[Path]) -> list[str]:
    from daq.log.reader import LogReader
    from rig.twin.logged import followed_scenario

    names = []
    for run in runs:
        with LogReader(run) as log:
            names.append(followed_scenario(log).name)
    return list(dict.fromkeys(names))
