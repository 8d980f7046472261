"""`rattle reproduce`: the papers' figures again."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from daq.errors import RattleError
from rig.reproduce.page import FIGURES  # the help of --only names them
from rig.session.pace import Work
from rig.session.progress import Screen, Terminal


def reproduce(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the page goes.")] = Path("runs"),
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only", metavar="FIGURE", help=f"May come again, or a list with commas: {', '.join(FIGURES)}."
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Short runs, and wide scatter.")] = False,
) -> None:
    from rig.ensembles import cores, worker_processes
    from rig.reproduce.figure import Effort, tally
    from rig.reproduce.page import Reproduced, compute_all, document, html

    asked = [name.strip() for each in only or () for name in each.split(",")]
    unknown = [name for name in asked if name not in FIGURES]
    if unknown:
        raise typer.BadParameter(f"no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}")
    screen, names = Screen(Terminal()), [name for name in FIGURES if not asked or name in asked]
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RattleError(f"cannot make {out}: {error.strerror}") from error
    recordings = out / "surrogates" / "logs"
    if any(FIGURES[name].recorded for name in names):
        from daq.clock import SystemClock
        from rig.app import connect
        from rig.surrogates.recordings import PAPER, QUICK_SECONDS, recorded

        recorded(PAPER, recordings, QUICK_SECONDS, connect, screen, SystemClock())
    with ExitStack() as stack:
        executor = None
        if not quick and min(len(names), cores()) > 1:
            executor = stack.enter_context(worker_processes(min(len(names), cores()))).executor
        work = Work(f"reproduce {' '.join(names)}{' quickly' if quick else ''}")
        bar = stack.enter_context(screen.bar("simulating", len(names), "figures", work))
        outcomes = compute_all(names, Effort(quick, recordings), executor, bar)
    done = [Reproduced(FIGURES[name], outcome) for name, outcome in outcomes.items()]
    _write(out / "reproduce.json", document(done, quick))
    _write(out / "reproduce.html", html(done, quick))
    counts = tally(statement for each in done for statement in each.outcome.statements)
    told = ", ".join(f"{verdict.value} {count}" for verdict, count in counts.items())
    screen.say(f"verdicts   {told}")
    screen.say(f"numbers    {out / 'reproduce.json'}")
    screen.say(f"page       {out / 'reproduce.html'}")
    failed = [f"{name}: {outcome.failure}" for name, outcome in outcomes.items() if outcome.failure]
    if failed:
        raise RattleError("\n".join(failed))


def _write(file: Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RattleError(f"cannot write {file}: {error.strerror}") from error
