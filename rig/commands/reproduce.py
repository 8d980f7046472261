"""`rattle reproduce`: the papers' figures again."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from daq.errors import RattleError
from rig.reproduce.catalogue import FIGURES  # the help of --only names them
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.reproduce.figure import Effort, Outcome
    from rig.reproduce.page import Reproduced


def reproduce(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the page goes.")] = Path("runs"),
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="FIGURE",
            help=f"May come again, or a list with commas: {', '.join(FIGURES)}.",
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Short runs: seconds, and wide scatter.")] = False,
) -> None:
    from rig.reproduce import page
    from rig.reproduce.figure import Effort
    from rig.reproduce.page import Reproduced

    screen, names, target = Screen(Console()), _chosen(only), _made(out)
    outcomes = _computed(names, Effort(quick), screen)
    done = [Reproduced(FIGURES[name], outcome) for name, outcome in outcomes.items()]
    _write(target / "reproduce.json", page.document(done, quick))
    _write(target / "reproduce.html", page.html(done, quick))
    screen.say(f"verdicts   {_verdicts(done)}")
    screen.say(f"numbers    {target / 'reproduce.json'}")
    screen.say(f"page       {target / 'reproduce.html'}")
    failed = [f"{name}: {outcome.failure}" for name, outcome in outcomes.items() if outcome.failure]
    if failed:
        raise RattleError("\n".join(failed))


def _chosen(wanted: Sequence[str] | None) -> list[str]:
    names = [name.strip() for each in wanted or () for name in each.split(",")]
    unknown = [name for name in names if name not in FIGURES]
    if unknown:
        raise typer.BadParameter(f"no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}")
    return [name for name in FIGURES if not names or name in names]


def _computed(names: Sequence[str], effort: Effort, screen: Screen) -> dict[str, Outcome]:
    from rig.ensembles.executors import cores, worker_processes
    from rig.reproduce.catalogue import compute_all

    with ExitStack() as stack:
        executor = None
        if not effort.quick and min(len(names), cores()) > 1:
            executor = stack.enter_context(worker_processes(min(len(names), cores()))).executor
        bar = stack.enter_context(screen.bar("simulating", len(names), "figures"))
        return compute_all(names, effort, executor, bar.at)


def _verdicts(done: Sequence[Reproduced]) -> str:
    from rig.reproduce.statement import tally

    counts = tally(statement for each in done for statement in each.outcome.statements)
    return ", ".join(f"{verdict.value} {count}" for verdict, count in counts.items())


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RattleError(f"cannot make {folder}: {error.strerror}") from error
    return folder


def _write(file: Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RattleError(f"cannot write {file}: {error.strerror}") from error
