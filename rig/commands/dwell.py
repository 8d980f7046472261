"""`rattle dwell`: the shaft at one speed after the other, in one log."""

from __future__ import annotations

import datetime
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from daq.errors import ConfigurationError, Problem
from rig.commands.arguments import BenchFile, ScenarioFile, load_pair
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.files.scenario import Scenario
    from rig.session.dwells import DwellRequest

_MOST = 50


def dwell(
    scenario_file: ScenarioFile,
    speeds: Annotated[
        str, typer.Option("--speeds", metavar="LIST", help='In their order: "100 rpm, 250 rpm".')
    ],
    each: Annotated[str, typer.Option("--each", metavar="TIME", help="How long at each.")] = "8 s",
    bench_file: BenchFile = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where logs go.")] = Path("runs"),
) -> None:
    from daq.clock import SystemClock
    from rig.app import connect
    from rig.files.pairing import check_pair
    from rig.session.dwells import DwellRequest, record_dwells

    screen = Screen(Console(stderr=False))
    scenario, bench = load_pair(scenario_file, bench_file)
    scenarios = at_speeds(scenario, speeds)
    today = datetime.datetime.now(datetime.UTC).date()
    for one in scenarios:
        check_pair(one, bench, today)
    request = DwellRequest(scenarios, bench, _seconds(each), connect, out)
    screen.say(f"dwells     {request.what}")
    _warn_of_few_positions(request, screen)
    log = record_dwells(request, screen, SystemClock())
    screen.say(f"log        {log}")


def at_speeds(scenario: Scenario, speeds: str) -> list[Scenario]:
    """The scenario at each of the speeds, such as "100 rpm, 250 rpm"; raises ConfigurationError."""
    from rig.files.scenario import edited

    named = [speed.strip() for speed in speeds.split(",") if speed.strip()]
    if not 1 <= len(named) <= _MOST:
        allowed = f'1 to {_MOST} speeds with a comma between them, such as "100 rpm, 250 rpm"'
        raise ConfigurationError("rattle dwell", [Problem("--speeds", speeds, allowed)])
    return [edited(scenario, {"drive.speed": speed}, f"--speeds {speed}") for speed in named]


def _warn_of_few_positions(request: DwellRequest, screen: Screen) -> None:
    """Where the encoder sends too rarely for a mark to be looked up in its positions."""
    from daq.angle.skew import fastest_rad_s

    encoder, fastest = request.bench.encoder, max(request.speeds_rad_s)
    if encoder is not None and fastest > (highest := fastest_rad_s(encoder.period_s)):
        screen.warn(
            f"rattle skew will not use marks above {highest * 60 / math.tau:.0f} rpm: a position every "
            f"{encoder.period_s * 1e3:g} ms (encoder.period) is too few around a mark"
        )


def _seconds(given: str) -> float:
    from daq.quantity import Quantity
    from rig.files.table import FieldError, quantity_field

    time = quantity_field(Quantity("s", 1.0, 600.0))
    try:
        return float(time.read(given))
    except FieldError as error:
        problem = Problem("--each", given, time.allowed)
        raise ConfigurationError("rattle dwell", [problem]) from error
