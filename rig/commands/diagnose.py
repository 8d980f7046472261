"""`rattle diagnose`, `gap` and `calibrate`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from daq.disk import write_whole
from daq.errors import RattleError
from rig.commands.arguments import EffectsFile, Json, Model, RunFiles, is_log, out_folder, print_json
from rig.session.pace import reading
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rig.diagnosis.recordings import RecordedCampaign
    from rig.files.model_file import ModelFile


Seed = Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same answer.")]
_SEEDS = 3
_LISTED = 4
_WORTH_LISTING = 0.005
_LEAST_TOLD = 0.2


def diagnose(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN.mcap...", help="Logs of runs of one rig; of one of your own, its files."),
    ],
    out: Annotated[Path, out_folder("Where the answer goes.")],
    model: Model = None,
    seed: Seed = 0,
    budget: Annotated[
        float | None,
        typer.Option(
            "--budget",
            min=10.0,
            metavar="SECONDS",
            help="What it takes two free cores, about; without 120. Of a rig of your own, when it stops.",
        ),
    ] = None,
    effort: Annotated[
        float | None,
        typer.Option(
            "--effort", min=0.1, max=20.0, help="So many times as many rigs are simulated; without 1."
        ),
    ] = None,
    subject: Annotated[
        str | None,
        typer.Option(
            "--subject", metavar="RIG.py", help="A rig of your own, or the name of an installed one."
        ),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option("--seeds", min=1, help="Of one's own rig: how often it is asked; without 3.")
    ] = None,
    rigs: Annotated[
        int | None, typer.Option("--rigs", min=1, help="Of one's own rig: simulated for each seed.")
    ] = None,
    machine: Json = False,
) -> None:
    from rig.diagnosis.argument import argument_lines

    screen = Screen(Terminal(stderr=machine))
    if subject is None:
        from rig.diagnosis.diagnose_runs import BUDGET_S, diagnose_runs

        _only_with("--subject", {"--seeds": seeds, "--rigs": rigs})
        runs = [is_log(run) for run in runs]
        findings, files = diagnose_runs(runs, model, out, seed, budget or BUDGET_S, screen, effort or 1.0)
    else:
        from rig.diagnosis.own_rig import OwnRequest, diagnose_own

        _only_with("rattle's own rigs", {"--model": model})
        request = OwnRequest(subject, runs, seed, seeds or _SEEDS, rigs, effort or 1.0, budget)
        findings, files = diagnose_own(request, out, screen)
    if machine:
        typer.echo(files["diagnosis"].read_text(encoding="utf-8"), nl=False)
        return
    content = json.loads(files["diagnosis"].read_text(encoding="utf-8"))
    for sentence in content["sentences"]:
        screen.say(sentence)
    lines = {"nothing is missing": findings.none, "something unknown": findings.unknown}
    for each in findings.judged[:_LISTED]:
        where = f" on {each.cause.channel}" if each.cause.channel else ""
        lines[f"{each.cause.name}{where}"] = each.probability
    for text, share in sorted(lines.items(), key=lambda item: -item[1]):
        if share >= _WORTH_LISTING:
            screen.say(f"{share:6.1%}  {text}")
    for line in argument_lines(content):
        screen.say(line)
    for what, file in files.items():
        screen.say(f"{what:<10} {file}")


def _only_with(what: str, options: Mapping[str, object]) -> None:
    for name, given in options.items():
        if given is not None:
            raise typer.BadParameter(f"{name} goes with {what} only")


def gap(
    runs: RunFiles, effects: EffectsFile = None, model: Model = None, seed: Seed = 0, machine: Json = False
) -> None:
    from rig.diagnosis.diagnose_runs import measured_gap

    screen = Screen(Terminal(stderr=machine))
    found = measured_gap(runs, model, effects, seed, screen)
    if machine:
        print_json(found)
        return
    up_to = f"; healthy up to {found['healthy_up_to']:.2f}" if "healthy_up_to" in found else ""
    screen.say(f"gap     {found['before']:.2f}   (1 = as far as a healthy rig{up_to})")
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
    model: Model = None,
    spread: Annotated[
        bool,
        typer.Option(
            "--spread",
            help="Each run is of another healthy rig, or of another day: learn how far they differ.",
        ),
    ] = False,
    known_healthy: Annotated[
        bool,
        typer.Option(
            "--known-healthy",
            help="You know it by other means: what the twin cannot follow is allowed for, not refused.",
        ),
    ] = False,
) -> None:
    from daq.log.reader import LogReader
    from rig.diagnosis.calibration import calibrated
    from rig.diagnosis.diagnose_runs import recorded_of
    from rig.files.out_folder import require_new
    from rig.twin.logged import as_model_text, followed_scenario, found

    require_new(out, "calibrated")
    screen = Screen(Terminal())
    if spread:
        if known_healthy:
            raise typer.BadParameter("--spread and --known-healthy do not go together: leave out what is not")
        _learn_spread(runs, model, out, rigs, seed, budget, screen)
        return
    with screen.busy("reading", reading("read for a diagnosis", *runs)):
        read = recorded_of(runs, model, screen)
        before = None if model is None else _before(model, read)
    for remark in read.remarks:
        screen.warn(remark)
    found_of = calibrated(read, rigs, seed, budget, screen, known_healthy)
    outcome = found_of.match
    if not outcome.healthy:
        raise RattleError(found_of.refusal(known_healthy))
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
    of_runs = [run.name for run in read.paths]
    for told in found_of.told():
        screen.say(told)
    scenarios = list(dict.fromkeys(names))
    text = as_model_text(
        twin, outcome.matched, of_runs, scenarios, before, found_of.discrepancies, read.specimen
    )
    write_whole(out, text.encode())
    screen.say(f"model      {out}")


def _learn_spread(
    runs: list[Path], model: Path | None, out: Path, rigs: int, seed: int, budget: float, screen: Screen
) -> None:
    from rig.diagnosis.lab import lab_text, not_learnt, spread_of

    looked_at, found, known = spread_of(runs, rigs, seed, budget, screen, model)
    text = lab_text(looked_at, found, [run.name for run in runs], known)
    table = Table("tolerance", "times as wide as usual", "told", box=None, pad_edge=False)
    for name, width, told in zip(found.names, found.widths, found.told, strict=True):
        if told > _LEAST_TOLD:
            table.add_row(name, f"{width:.2f}", f"{told:.0%}")
    screen.console.print(table)
    screen.say(f"all together {found.common:.2f} times as wide as usual, which the rest is taken to be")
    anew = not_learnt(looked_at[0])
    screen.say(f"not learnt, for it is set anew for each run: {anew}; say it in [tolerances]")
    write_whole(out, text.encode())
    screen.say(f"model      {out}")


def _before(model: Path, read: RecordedCampaign) -> ModelFile:
    """What was known of the rig before, but of its tolerances, which are matched once."""
    from rig.files.model_file import load_model

    known = load_model(model, read.campaign.runs[0].twin.model.name)
    if known.matched.names:
        raise RattleError(f"{model} is of a calibration already; calibrate with all runs at once instead")
    return known
