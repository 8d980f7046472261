"""`rattle sweep`: a series of runs over frequency, amplitude, speed, and what is set by hand."""

from __future__ import annotations

import datetime
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from daq.errors import ConfigurationError, Problem, RattleError
from rig.commands.arguments import RUNS, BenchFile, Live, Model, load_sweep_pair
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.files.bench import Bench
    from rig.files.scenario import Scenario
    from rig.files.sweep import Sweep
    from rig.sweep.execute import Centre, SweepRequest
    from rig.sweep.state import CentreState, SweepState


SweepFile = Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="Which runs to make.")]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="The sweep's folder; without: runs/NAME.")
]
Dry = Annotated[bool, typer.Option("--dry", help="List every move and limit, and end there.")]
Yes = Annotated[bool, typer.Option("--yes", help="A rehearsal: take moves by hand as done. Emulated only.")]
Again = Annotated[
    list[int] | None,
    typer.Option("--again", metavar="POINT", help="Record this point anew; may be given several times."),
]
SetAgain = Annotated[bool, typer.Option("--set-again", help="Confirm anew what is set by hand.")]


def sweep(
    sweep_file: SweepFile,
    bench_file: BenchFile = None,
    out: Out = None,
    dry: Dry = False,
    yes: Yes = False,
    again: Again = None,
    set_again: SetAgain = False,
    live: Live = False,
    model: Model = None,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.model_file import load_model
    from rig.sweep.execute import SweepRequest, begun, run_sweep
    from rig.sweep.page import write_page
    from rig.sweep.state import held, load_state

    screen = Screen(Console(stderr=False))
    swept, bench = load_sweep_pair(sweep_file, bench_file)
    folder = RUNS / _plain(swept.name) if out is None else out
    asked = frozenset(again or [])
    _check_again(asked, swept)
    _check_rehearsal(yes, bench)
    fitted = None if model is None else load_model(model, swept.rig)
    request = SweepRequest(swept, bench, connect, folder, asked, set_again, yes, live, fitted)
    _dry_check(request, screen)
    if dry:
        screen.say("nothing has moved")
        return
    with held(folder):
        now = begun(request)  # read anew: another sweep may have been at work here until just now
        try:
            run_sweep(request, now, screen, SystemClock(), centre=_centring(folder))
        finally:
            state = load_state(folder) or now
            _show_points(request, state, screen)
        screen.say(f"report     {write_page(folder, swept, state)}")
    _sum_up(request, state, screen)


def _centring(folder: Path) -> Centre:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.commands.centre import found_lines
    from rig.session.centring.probe import plan_of
    from rig.session.centring.rig import find_centre
    from rig.sweep.state import CentreState

    def centre(scenario: Scenario, bench: Bench, screen: Screen) -> CentreState:
        plan = plan_of(scenario, bench)
        found = find_centre(scenario, bench, plan, connect, screen, SystemClock(), folder / "centring")
        middle, log = found.middle, str(found.log.relative_to(folder))
        for line in (*found_lines(middle, plan), f"log        {found.log}"):
            screen.say(line)
        return CentreState(middle.offset, middle.uncertainty, plan.rest_offset(middle), log)

    return centre


def _plain(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower()[:60] or "sweep"


def _check_again(again: frozenset[int], swept: Sweep) -> None:
    unknown = sorted(again - {point.number for point in swept.points})
    if unknown:
        problem = Problem("--again", ", ".join(map(str, unknown)), f"points 1 to {len(swept.points)}")
        raise ConfigurationError(swept.source, [problem])


def _check_rehearsal(yes: bool, bench: Bench) -> None:
    from rig.sweep.plan import real_instruments

    real = real_instruments(bench)
    if yes and real:
        allowed = "not with real instruments: what is set by hand has to be confirmed by who sets it"
        raise ConfigurationError(bench.source, [Problem("--yes", ", ".join(real), allowed)])


def _dry_check(request: SweepRequest, screen: Screen) -> None:
    """Refuse what no point may do, and say all that would be done."""
    from rig.sweep.execute import begun
    from rig.sweep.plan import bytes_of, check_points, listing

    swept, bench, folder = request.sweep, request.bench, request.folder
    free = shutil.disk_usage(_there(folder)).free
    check_points(swept, bench, datetime.datetime.now(datetime.UTC).date(), free)
    state = begun(request)
    ended = {number: point.outcome for number, point in state.points.items()}
    for line in listing(swept, bench, state.by_hand, ended):
        screen.say(line)
    most = f"at most {bytes_of(swept, bench) / 1e6:.0f} MB in {folder}"
    screen.say(f"disk       {most}; {free / 1e9:.1f} GB free")


def _there(folder: Path) -> Path:
    """The nearest folder above that is there."""
    return next(each for each in (folder.absolute(), *folder.absolute().parents) if each.is_dir())


def _show_points(request: SweepRequest, state: SweepState, screen: Screen) -> None:
    """Print what the points that have ended came to; as lines, so that no path is cut."""
    from rig.sweep.page import headings_of, rows_of

    rows = [headings_of(request.sweep), *rows_of(request.sweep, state)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows if len(rows) > 1 else ():
        screen.say("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def _sum_up(request: SweepRequest, state: SweepState, screen: Screen) -> None:
    from rig.files.sweep import points_named
    from rig.sweep.results import TABLE

    screen.say(f"table      {request.folder / TABLE}")
    bad = state.ended("failed", "interlock")
    if bad:
        named, count = points_named(list(bad)), len(request.sweep.points)
        raise RattleError(f"{named} of {count} not as asked for; see above")
