"""`rattle surrogate train`, `predict` and `report`: networks that learn from logs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.table import Table

from daq.errors import RattleError
from rig.commands.arguments import RUNS, RunFile, RunFiles
from rig.session.pace import Work
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from sim_twin.surrogates.surrogate import Surrogate

surrogate = typer.Typer(no_args_is_help=True, add_completion=False, help="Networks that learn from logs.")


@surrogate.command(help="Learn what the frame shows from runs of a planar slider-crank.")
def train(
    runs: RunFiles,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="MODEL.npz", help="The file to write.")],
    network: Annotated[Literal["rbf", "grnn"], typer.Option("--network", help="Which network.")] = "rbf",
    over: Annotated[
        Literal["angle", "time"], typer.Option("--over", help="Crank angle, or time since the record began.")
    ] = "angle",
    units: Annotated[
        int | None,
        typer.Option(
            "--units",
            min=1,
            max=2000,
            help="At most; the paper has 10. Without: 100; of a grnn 1000 prototypes.",
        ),
    ] = None,
    error_goal: Annotated[
        float | None,
        typer.Option(
            "--error-goal",
            min=0,
            max=1,
            help="Of an rbf: no more units than bring the mean squared error to this share of the variance.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same network.")] = 0,
) -> None:
    from rig.files.out_folder import require_new
    from rig.files.surrogate_file import save_surrogate
    from rig.surrogates.training import trained

    require_new(out, "trained")
    if error_goal is not None and network != "rbf":
        raise typer.BadParameter("a grnn adds no units", param_hint="--error-goal")
    screen = Screen(Terminal())
    with screen.busy("learning", Work(f"train {network} over {over}", _size_of(runs))):
        found = trained(runs, network, over, units, seed, error_goal, screen.warn)
    save_surrogate(found, out)
    _tell(found, screen)
    screen.say(f"surrogate  {out}")


def _size_of(runs: list[Path]) -> float:
    """Of files, in MB."""
    return sum(run.stat().st_size for run in runs if run.is_file()) / 1e6


def _tell(found: Surrogate, screen: Screen) -> None:
    from rig.twin.recorded_samples import settings_words

    for name, words in settings_words(found).items():
        constant = (
            "; the same in all runs, so nothing was learnt of it" if name in found.features.constants else ""
        )
        screen.say(f"learnt     {name} {words}{constant}")
    table = Table(
        "last revolutions, not learnt", "rmse", "floor", "distance", "floor", box=None, pad_edge=False
    )
    for name, score in found.tested.items():
        known = [f"{each:.3f}" for each in (score.rmse, score.rmse_floor, score.distance)]
        table.add_row(name, *known, f"{score.distance_floor:.3f}" if score.distance_floor else "-")
    screen.console.print(table)
    words = "may" if found.stands_in else "may not"
    screen.say(f"           it {words} stand in for simulations (rattle ensemble --surrogate)")
    screen.say(
        "           in standard deviations of the channel; the floor is what the rig's own chatter leaves,"
        " - where a run ends with fewer than two whole revolutions to tell it by"
    )


@surrogate.command(help="Add what a surrogate predicts, and the twin, to a recorded run, in a new file.")
def predict(
    run: RunFile,
    model: Annotated[Path, typer.Argument(metavar="MODEL.npz", help="What rattle surrogate train wrote.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Default: RUN.surrogate.mcap")
    ] = None,
) -> None:
    from rig.commands.logs import read_and_judged, report_and_name
    from rig.session.overlay import overlay_run

    screen = Screen(Terminal())
    target = out or run.with_suffix(".surrogate.mcap")
    overlay_run(run, target, warn=screen.warn, surrogate=model, screen=screen)
    report_and_name(read_and_judged(target, screen), screen)


@surrogate.command(
    help="Judge both networks on recorded runs; without runs, record them on the emulated bench."
)
def report(
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="[RUN.mcap...]", help="Runs of several settings.")
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where logs, table and page go; what is there stays.")
    ] = RUNS / "surrogates",
    quick: Annotated[
        bool, typer.Option("--quick", help="Short runs: a minute or two, and wide scatter.")
    ] = False,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.ensembles import cores, worker_processes
    from rig.pages.content import page
    from rig.surrogates import judgement
    from rig.surrogates.recordings import ALL, QUICK_SECONDS, SECONDS, recorded
    from rig.twin.recorded_samples import each_once

    screen = Screen(Terminal())
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RattleError(f"cannot make {out}: {error.strerror}") from error
    if not runs:
        seconds = QUICK_SECONDS if quick else SECONDS
        runs = list(recorded(ALL, out / "logs", seconds, connect, screen, SystemClock()).values())
    logs = each_once(runs, screen.warn)
    with (
        worker_processes(min(cores(), 2)) as workers,
        screen.bar("judging", judgement.PIECES, "comparisons", Work("judge", _size_of(runs))) as bar,
    ):
        rows = judgement.judged(logs, out, workers.executor, bar)
    if not rows:
        raise RattleError("none of these runs turned twice; record longer")
    for caption, lines in judgement.tables(rows).items():
        table = Table(title=caption, title_justify="left", box=None, padding=(0, 1, 0, 0))
        for heading in judgement.HEADINGS:
            table.add_column(heading, min_width=max(map(len, heading.split())))
        for line in lines:
            table.add_row(*line)
        screen.console.print(table)
    for claim, holds, found in judgement.claims(rows):
        screen.say(f"{'holds' if holds else 'does not hold'}: {claim} ({found})")
    files = {
        "surrogates.json": judgement.document(rows, list(logs)),
        "surrogates.md": judgement.markdown(rows),
    }
    subtitle = [f"{len(logs)} run{'s' if len(logs) > 1 else ''}"]
    files["surrogates.html"] = page("Surrogates", subtitle, [("What holds", judgement.parts(rows))])
    for name, text in files.items():
        try:
            (out / name).write_text(text, encoding="utf-8")
        except OSError as error:
            raise RattleError(f"cannot write {out / name}: {error.strerror}") from error
    screen.say(f"numbers    {out / 'surrogates.json'}")
    screen.say(f"page       {out / 'surrogates.html'}")
