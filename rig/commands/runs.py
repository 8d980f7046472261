"""`rattle runs`: which runs are there, what they were, tags, and two of them side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from rig.commands.arguments import RUNS, Json, print_json
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rig.report.catalogue import Run


_DIGEST: Final = 12
"""Digits of a digest that are shown."""


def runs(
    paths: Annotated[
        list[Path] | None, typer.Argument(metavar="[DIR|RUN.mcap]...", help="Folders or logs; default: runs.")
    ] = None,
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=PATTERN",
            help="Only runs with this note, key of the scenario or of the run record; * is anything.",
        ),
    ] = None,
    tagged: Annotated[list[str] | None, typer.Option(metavar="TAG", help="Only runs with this tag.")] = None,
    tag: Annotated[list[str] | None, typer.Option(metavar="TAG", help="Give these logs a tag.")] = None,
    untag: Annotated[list[str] | None, typer.Option(metavar="TAG", help="Take a tag from them.")] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Two runs: measured against measured, and what was different.")
    ] = False,
    as_json: Json = False,
) -> None:
    from daq.errors import RattleError
    from rig.files.file_kind import refuse_other_than_log
    from rig.report import catalogue

    named = paths or [RUNS]
    for path in named:
        if not path.is_dir():
            refuse_other_than_log(path)
    if tag or untag:
        if any(path.is_dir() for path in named):
            raise typer.BadParameter("--tag and --untag want logs, not a folder: name each, or runs/*.mcap")
        try:
            for log in named:
                catalogue.tag(log, tag or (), untag or ())
        except OSError as error:
            raise RattleError(f"the tags cannot be kept: {error}") from error
    if compare:
        _compare([run for path in named for run in catalogue.runs_in([path])], as_json)
        return
    found = catalogue.runs_in(named)
    wanted = dict(_wanted(each) for each in where or ())
    chosen = [run for run in found if run.fits(wanted) and {*(tagged or ())} <= {*run.tags}]
    if as_json:
        print_json([_told(run) for run in chosen])
        return
    _list(chosen, len(found))


def _wanted(text: str) -> tuple[str, str]:
    key, mark, pattern = (each.strip() for each in text.partition("="))
    if not mark or not key or not pattern:
        raise typer.BadParameter(f"--where {text}: KEY=PATTERN, such as operator=Ada or drive.speed='230*'")
    return key, pattern


def _told(run: Run) -> dict[str, object]:
    told = {"log": str(run.path), "name": run.name, "started": run.started, "damage": run.damage}
    return {**told, "tags": list(run.tags), "notes": dict(run.notes), "facts": dict(run.facts)}


def _list(chosen: list[Run], of: int) -> None:
    from rig.pages.words import counted

    screen, width = Screen(Terminal()), max((len(run.path.name) for run in chosen), default=0)
    for run in chosen:
        begun = run.started[:16].replace("T", " ")
        screen.say(f"{begun:<16}  {run.path.name:<{width}}  {', '.join(run.tags)}".rstrip())
        notes = (f"{key}: {value}" for key, value in run.notes.items())
        screen.say(" " * 18 + "; ".join(filter(None, (run.damage or run.name, *notes))))
    screen.say(counted(of, "run") if len(chosen) == of else f"{len(chosen)} of {counted(of, 'run')}")


def _compare(found: list[Run], as_json: bool) -> None:
    from rig.commands.logs import recorded, show
    from rig.report.catalogue import apart_db, differences, side_by_side
    from rig.report.summary import as_json as figures

    if len(found) != 2:
        raise typer.BadParameter(f"--compare wants two runs, not {len(found)}")
    screen, (one, other) = Screen(Terminal(stderr=as_json)), found
    both = side_by_side(recorded(one.path, screen), recorded(other.path, screen))
    between, halves = apart_db(both)
    unlike = differences(one, other)
    if as_json:
        told = {"first": _told(one), "second": _told(other), "differences": unlike}
        apart = {"apart_db": between, "halves_of_first_db": halves}
        print_json({**told, **apart, **figures(both)})
        return
    screen.say(f"first      {one.path}")
    screen.say(f"second     {other.path}")
    table = Table("different", "first", "second", box=None, pad_edge=False)
    for key, *values in unlike:
        table.add_row(key, *(each[:_DIGEST] if key.endswith("sha256") else each for each in values))
    if unlike:
        screen.console.print(table)
    show(both, screen)
    screen.say(f"autospectra {between:.1f} dB apart; the first's own halves {halves:.1f} dB")
