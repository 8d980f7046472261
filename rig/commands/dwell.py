"""`rattle dwell`: the shaft at one speed after the other, in one log."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from daq.angle.skew import fastest_rad_s
from daq.clock import SystemClock
from daq.errors import ConfigurationError, Problem
from daq.quantity import Quantity
from rig.commands.arguments import BenchFile, ScenarioFile, load_pair
from rig.files.bench import Bench
from rig.files.pairing import check_pair
from rig.files.scenario import Scenario, edited
from rig.files.table import FieldError, quantity_field
from rig.session.devices import Devices
from rig.session.dwells import DwellRequest, record_dwells
from rig.session.progress import Screen

Connect = Callable[[Scenario, Bench, ExitStack, Screen], tuple[Devices, dict[str, str]]]
_SECONDS = quantity_field(Quantity("s", 1.0, 600.0))
_MOST = 50


def add_to(app: typer.Typer, connect: Connect) -> None:
    """Add the command."""

    @app.command()
    def dwell(
        scenario_file: ScenarioFile,
        speeds: Annotated[
            str, typer.Option("--speeds", metavar="LIST", help='In their order: "100 rpm, 250 rpm".')
        ],
        each: Annotated[str, typer.Option("--each", metavar="TIME", help="How long at each.")] = "8 s",
        bench_file: BenchFile = None,
        out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where logs go.")] = Path("runs"),
    ) -> None:
        """Record a crank at several speeds in one log, without a twin; `rattle skew` reads it."""
        screen = Screen(Console(stderr=False))
        scenario, bench = load_pair(scenario_file, bench_file)
        scenarios = at_speeds(scenario, speeds)
        today = datetime.datetime.now(datetime.UTC).date()
        for one in scenarios:
            check_pair(one, bench, today)
        request = DwellRequest(
            scenarios, bench, _seconds(each), lambda stack, to: connect(scenarios[0], bench, stack, to), out
        )
        screen.say(f"dwells     {request.what}")
        _warn_of_few_positions(request, screen)
        log = record_dwells(request, screen, SystemClock())
        screen.say(f"log        {log}")


def at_speeds(scenario: Scenario, speeds: str) -> list[Scenario]:
    """The scenario at each of the speeds, such as "100 rpm, 250 rpm"; raises ConfigurationError."""
    named = [speed.strip() for speed in speeds.split(",") if speed.strip()]
    if not 1 <= len(named) <= _MOST:
        allowed = f'1 to {_MOST} speeds with a comma between them, such as "100 rpm, 250 rpm"'
        raise ConfigurationError("rattle dwell", [Problem("--speeds", speeds, allowed)])
    return [edited(scenario, {"drive.speed": speed}, f"--speeds {speed}") for speed in named]


def _warn_of_few_positions(request: DwellRequest, screen: Screen) -> None:
    """Where the encoder sends too rarely for a mark to be looked up in its positions."""
    encoder, fastest = request.bench.encoder, max(request.speeds_rad_s)
    if encoder is not None and fastest > (highest := fastest_rad_s(encoder.period_s)):
        screen.warn(
            f"rattle skew will not use marks above {highest * 60 / math.tau:.0f} rpm: a position every "
            f"{encoder.period_s * 1e3:g} ms (encoder.period) is too few around a mark"
        )


def _seconds(given: str) -> float:
    try:
        return float(_SECONDS.read(given))
    except FieldError as error:
        problem = Problem("--each", given, _SECONDS.allowed)
        raise ConfigurationError("rattle dwell", [problem]) from error
