"""`rattle sweep`: runs over what is driven or set by hand; `rattle centre`: the offset that they may need."""

from __future__ import annotations

import datetime
import re
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.errors import ConfigurationError, Problem, RattleError
from rig.commands.arguments import (
    RUNS,
    BenchFile,
    Json,
    Live,
    Model,
    Note,
    ScenarioFile,
    load_pair,
    noted,
    once,
    out_folder,
    print_json,
)
from rig.session.progress import Screen, Terminal

if TYPE_CHECKING:
    from rig.files.bench import Bench
    from rig.files.scenario import Scenario
    from rig.session.centring import CentringPlan, Middle
    from rig.sweep.execute import SweepRequest
    from rig.sweep.state import CentreState


def centre(
    scenario_file: ScenarioFile,
    bench_file: BenchFile = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE.toml", help="Without: SCENARIO.centred.toml beside it."),
    ] = None,
    runs: Annotated[Path, out_folder("Where the log goes.", "--runs")] = RUNS,
    note: Note = None,
    as_json: Json = False,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.faults import read_toml, toml_of
    from rig.files.pairing import check_pair, free_bytes
    from rig.files.scenario import load_scenario, with_values
    from rig.session.centring import plan_of
    from rig.session.centring_run import find_centre
    from rig.twin.scenario_twin import check_twin

    screen = Screen(Terminal(stderr=as_json))
    notes = once(noted(note))
    scenario, bench = load_pair(load_scenario, scenario_file, bench_file)
    recorded = load_scenario(scenario_file, notes)  # what is written has no notes of this search
    written = scenario_file.with_suffix(".centred.toml") if out is None else out
    if written.exists():
        raise RattleError(f"{written} is there already; name another file with -o")
    # how long it takes nobody knows; it may begin where there is room at all
    check_pair(scenario, bench, datetime.datetime.now(datetime.UTC).date(), free_bytes(runs), recorded_s=0.0)
    check_twin(scenario)
    plan = plan_of(scenario, bench)
    screen.say(f"sine       {plan.sine.amplitude:.3g} N at {plan.frequency:.3g} Hz, offsets up to "
               f"+-{plan.farthest:.3g} N, {plan.probe_s:.1f} s at each")  # fmt: skip
    middle, log = find_centre(recorded, bench, plan, connect, screen, SystemClock(), runs)
    found = found_lines(middle, plan)
    for line in found:
        screen.say(line)
    settings = {
        "drive.offset": f"{middle.offset:.5f} N",
        "model.rest_offset": f"{plan.rest_offset(middle) * 1e3:.5f} mm",
    }
    table = with_values(read_toml(scenario.text, scenario.name), settings)
    said = [f"by rattle centre from {scenario_file.name}", *found]
    remarks = "".join(f"# {line}\n" for line in said)
    try:
        with written.open("x") as file:
            file.write(f"{remarks}{toml_of(table)}")
    except OSError as error:
        problem = Problem("-o", str(written), f"a file that can be written ({error.strerror})")
        raise ConfigurationError(str(written), [problem]) from error
    screen.say(f"log        {log}")
    screen.say(f"scenario   {written}")
    if as_json:
        print_json(
            {
                "offset_n": middle.offset,
                "uncertainty_n": middle.uncertainty,
                "rest_offset_m": plan.rest_offset(middle),
                "share_of_clearance": middle.uncertainty / plan.reach,
                "scenario": str(written),
                "log": str(log),
            }
        )


def found_lines(middle: Middle, plan: CentringPlan) -> list[str]:
    """What was found, in words."""
    share, rests = middle.uncertainty / plan.reach, plan.rest_offset(middle)
    return [
        f"offset     {middle.offset:+.4f} N +- {middle.uncertainty:.4f} N ({share:.1%} of the clearance), "
        f"after {middle.probes} offsets",
        f"at rest    the tip stands {rests * 1e3:+.4f} mm from the middle without it (by the twin)",
    ]


def sweep(
    sweep_file: Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="Which runs to make.")],
    bench_file: BenchFile = None,
    out: Annotated[Path | None, out_folder("The sweep's folder; without: runs/NAME.")] = None,
    dry: Annotated[bool, typer.Option("--dry", help="List every move and limit, and end there.")] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="A rehearsal: take moves by hand as done. Emulated only.")
    ] = False,
    again: Annotated[
        list[int] | None,
        typer.Option("--again", metavar="POINT", help="Record this point anew; may be given several times."),
    ] = None,
    set_again: Annotated[bool, typer.Option("--set-again", help="Confirm anew what is set by hand.")] = False,
    live: Live = False,
    model: Model = None,
    note: Note = None,
    as_json: Json = False,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.model_file import load_model
    from rig.files.sweep import load_sweep, points_named
    from rig.session.on_page import come_to, on_page
    from rig.sweep.execute import Sweeping, SweepRequest, begun
    from rig.sweep.plan import real_instruments
    from rig.sweep.results import TABLE, headings_of, points_of, rows_of, write_page
    from rig.sweep.state import held, load_state

    screen = Screen(Terminal(stderr=as_json))
    swept, bench = load_pair(partial(load_sweep, settings=once(noted(note))), sweep_file, bench_file)
    plain = re.sub(r"[^A-Za-z0-9]+", "-", swept.name).strip("-").lower()[:60] or "sweep"
    folder = RUNS / plain if out is None else out
    asked = frozenset(again or [])
    unknown = sorted(asked - {point.number for point in swept.points})
    if unknown:
        problem = Problem("--again", ", ".join(map(str, unknown)), f"points 1 to {len(swept.points)}")
        raise ConfigurationError(swept.source, [problem])
    real = real_instruments(bench)
    if yes and real:
        allowed = "not with real instruments: what is set by hand has to be confirmed by who sets it"
        raise ConfigurationError(bench.source, [Problem("--yes", ", ".join(real), allowed)])
    fitted = None if model is None else load_model(model, swept.rig, swept.points[0].scenario.specimen)
    request = SweepRequest(swept, bench, connect, folder, asked, set_again, yes, fitted)
    _dry_check(request, screen)
    if dry:
        screen.say("nothing has moved")
        return
    with on_page(screen) if live else nullcontext() as view, held(folder):
        now = begun(request)  # read anew: another sweep may have been at work here until just now
        try:
            find_centre = partial(_centred, folder)
            Sweeping(request, now, screen, SystemClock(), centre=find_centre, view=view).all()
        finally:
            state = load_state(folder) or now
            rows = [headings_of(swept), *rows_of(swept, state)]
            widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
            for row in rows if len(rows) > 1 else ():  # as lines, so that no path is cut
                padded = (text.ljust(width) for text, width in zip(row, widths, strict=True))
                screen.say("  ".join(padded).rstrip())
        report = write_page(folder, swept, state)
        screen.say(f"report     {report}")
        screen.say(f"table      {folder / TABLE}")
        if as_json:
            files = {"report": str(report), "table": str(folder / TABLE)}
            print_json({**files, "points": points_of(folder, swept, state)})
        if view is not None:
            come_to(view, screen, f"finished: {folder}", report=report, stays=not as_json)
    bad = state.ended("failed", "interlock")
    if bad:
        named, count = points_named(list(bad)), len(swept.points)
        raise RattleError(f"{named} of {count} not as asked for; see above")


def _centred(folder: Path, scenario: Scenario, bench: Bench, screen: Screen) -> CentreState:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.session.centring import plan_of
    from rig.session.centring_run import find_centre
    from rig.sweep.state import CentreState

    plan = plan_of(scenario, bench)
    middle, log = find_centre(scenario, bench, plan, connect, screen, SystemClock(), folder / "centring")
    for line in (*found_lines(middle, plan), f"log        {log}"):
        screen.say(line)
    seen_from = str(log.relative_to(folder))
    return CentreState(middle.offset, middle.uncertainty, plan.rest_offset(middle), seen_from)


def _dry_check(request: SweepRequest, screen: Screen) -> None:
    """Refuse what no point may do, and say all that would be done."""
    from rig.files.pairing import bytes_of, free_bytes
    from rig.sweep.execute import begun
    from rig.sweep.plan import check_points, listing

    swept, bench, folder = request.sweep, request.bench, request.folder
    free = free_bytes(folder)
    check_points(swept, bench, datetime.datetime.now(datetime.UTC).date(), free)
    state = begun(request)
    ended = {number: point.outcome for number, point in state.points.items()}
    for line in listing(swept, bench, state.by_hand, ended, screen.paces):
        screen.say(line)
    most = bytes_of((point.scenario.acquisition for point in swept.points), bench) / 1e6
    screen.say(f"disk       at most {most:.0f} MB in {folder}; {free / 1e9:.1f} GB free")
