"""`rattle centre`: find the offset of the drive that holds the beam in the middle between its stops."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from daq.errors import ConfigurationError, Problem, RattleError
from rig.commands.arguments import RUNS, BenchFile, Json, ScenarioFile, load_pair, print_json
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.files.scenario import Scenario
    from rig.session.centring.probe import CentringPlan
    from rig.session.centring.search import Middle


def centre(
    scenario_file: ScenarioFile,
    bench_file: BenchFile = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE.toml", help="Without: SCENARIO.centred.toml beside it."),
    ] = None,
    runs: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the log goes.")] = RUNS,
    as_json: Json = False,
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.pairing import check_pair
    from rig.session.centring.probe import plan_of
    from rig.session.centring.rig import find_centre
    from rig.twin.scenario_twin import check_twin

    screen = Screen(Console(stderr=as_json))
    scenario, bench = load_pair(scenario_file, bench_file)
    written = scenario_file.with_suffix(".centred.toml") if out is None else out
    if written.exists():
        raise RattleError(f"{written} is there already; name another file with -o")
    check_pair(scenario, bench, datetime.datetime.now(datetime.UTC).date())
    check_twin(scenario)
    plan = plan_of(scenario, bench)
    screen.say(f"sine       {plan.sine.amplitude:.3g} N at {plan.frequency:.3g} Hz, offsets up to "
               f"+-{plan.farthest:.3g} N, {plan.probe_s:.1f} s at each")  # fmt: skip
    centred = find_centre(scenario, bench, plan, connect, screen, SystemClock(), runs)
    middle = centred.middle
    found = found_lines(middle, plan)
    for line in found:
        screen.say(line)
    _write(written, scenario, middle, plan, [f"by rattle centre from {scenario_file.name}", *found])
    screen.say(f"log        {centred.log}")
    screen.say(f"scenario   {written}")
    if as_json:
        print_json(
            {
                "offset_n": middle.offset,
                "uncertainty_n": middle.uncertainty,
                "rest_offset_m": plan.rest_offset(middle),
                "share_of_clearance": middle.uncertainty / plan.reach,
                "scenario": str(written),
                "log": str(centred.log),
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


def _write(path: Path, scenario: Scenario, middle: Middle, plan: CentringPlan, said: list[str]) -> None:
    from rig.files.faults import read_toml
    from rig.files.sweep_axes import with_values
    from rig.files.toml_text import toml_of

    settings = {
        "drive.offset": f"{middle.offset:.5f} N",
        "model.rest_offset": f"{plan.rest_offset(middle) * 1e3:.5f} mm",
    }
    table = with_values(read_toml(scenario.text, scenario.name), settings)
    remarks = "".join(f"# {line}\n" for line in said)
    try:
        with path.open("x") as file:
            file.write(f"{remarks}{toml_of(table)}")
    except OSError as error:
        problem = Problem("-o", str(path), f"a file that can be written ({error.strerror})")
        raise ConfigurationError(str(path), [problem]) from error
