"""`rattle diagnose` and `rattle gap`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from rig.commands.arguments import EffectsFile, Json, Model, RunFiles, print_json
from rig.session.progress import Screen

if TYPE_CHECKING:
    from sim_twin.diagnosis.findings import Findings

Seed = Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same answer.")]
_LISTED = 4
_WORTH_LISTING = 0.005


def diagnose(
    runs: RunFiles,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the answer goes.")],
    model: Model = None,
    seed: Seed = 0,
    budget: Annotated[
        float, typer.Option("--budget", min=10.0, metavar="SECONDS", help="Time to spend, about.")
    ] = 120.0,
    machine: Json = False,
) -> None:
    from rig.diagnosis.diagnose_runs import diagnose_runs

    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is a file; name a folder", param_hint="--out")
    screen = Screen(Console(stderr=machine))
    written = diagnose_runs(runs, model, out, seed, budget, screen)
    if machine:
        typer.echo(written.diagnosis.read_text(encoding="utf-8"), nl=False)
        return
    _show(written.findings, screen)
    screen.say(f"diagnosis  {written.diagnosis}")
    screen.say(f"effects    {written.effects}")
    screen.say(f"report     {written.report}")
    if written.next_experiment is not None:
        screen.say(f"next run   {written.next_experiment}")


def gap(
    runs: RunFiles,
    effects: EffectsFile = None,
    model: Model = None,
    seed: Seed = 0,
    machine: Json = False,
) -> None:
    from rig.diagnosis.measured_gap import measured_gap

    screen = Screen(Console(stderr=machine))
    found = measured_gap(runs, model, effects, seed, screen)
    if machine:
        print_json(found)
        return
    screen.say(f"gap     {found['before']:.2f}   (1 = as far as a healthy rig)")
    if effects is not None:
        shrink = "" if found["shrink"] is None else f"   shrink {found['shrink']:.0%}"
        screen.say(f"with {effects.name}   {found['after']:.2f}{shrink}")


def _show(findings: Findings, screen: Screen) -> None:
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
