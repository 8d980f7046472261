"""`rattle dwell` and `rattle skew`: several speeds in one log, and how late an encoder is by them."""

from __future__ import annotations

import dataclasses
import datetime
import math
from functools import partial
from math import tau
from pathlib import Path
from typing import Annotated

import typer

from daq.errors import ConfigurationError, LogError, Problem
from rig.commands.arguments import (
    RUNS,
    BenchFile,
    Json,
    Note,
    RunFiles,
    ScenarioFile,
    load_pair,
    noted,
    once,
    out_folder,
    print_json,
)
from rig.session.progress import Screen, Terminal

_MOST = 50


def dwell(
    scenario_file: ScenarioFile,
    speeds: Annotated[
        str, typer.Option("--speeds", metavar="LIST", help='In their order: "100 rpm, 250 rpm".')
    ],
    each: Annotated[str, typer.Option("--each", metavar="TIME", help="How long at each.")] = "8 s",
    bench_file: BenchFile = None,
    out: Annotated[Path, out_folder("Where logs go.")] = RUNS,
    note: Note = None,
) -> None:
    from daq.angle.skew import fastest_rad_s
    from daq.clock import SystemClock
    from daq.quantity import Quantity
    from rig.app import connect
    from rig.files.pairing import check_pair, free_bytes
    from rig.files.scenario import edited, load_scenario
    from rig.files.table import FieldError, quantity_field
    from rig.session.dwells import DwellRequest, record_dwells

    screen = Screen(Terminal(stderr=False))
    scenario, bench = load_pair(partial(load_scenario, settings=once(noted(note))), scenario_file, bench_file)
    named = [speed.strip() for speed in speeds.split(",") if speed.strip()]
    if not 1 <= len(named) <= _MOST:
        allowed = f'1 to {_MOST} speeds with a comma between them, such as "100 rpm, 250 rpm"'
        raise ConfigurationError("rattle dwell", [Problem("--speeds", speeds, allowed)])
    scenarios = [edited(scenario, {"drive.speed": speed}, f"--speeds {speed}") for speed in named]
    time = quantity_field(Quantity("s", 1.0, 600.0))
    try:
        dwell_s = float(time.read(each))
    except FieldError as error:
        raise ConfigurationError("rattle dwell", [Problem("--each", each, time.allowed)]) from error
    today = datetime.datetime.now(datetime.UTC).date()
    for one in scenarios:
        check_pair(one, bench, today, free_bytes(out), recorded_s=dwell_s * len(scenarios))
    request = DwellRequest(scenarios, bench, dwell_s, connect, out)
    screen.say(f"dwells     {request.what}")
    # where the encoder sends too rarely for a mark to be looked up in its positions
    encoder, fastest = request.bench.encoder, max(request.speeds_rad_s)
    if encoder is not None and fastest > (highest := fastest_rad_s(encoder.period_s)):
        screen.warn(
            f"rattle skew will not use marks above {highest * 60 / math.tau:.0f} rpm: a position every "
            f"{encoder.period_s * 1e3:g} ms (encoder.period) is too few around a mark"
        )
    log = record_dwells(request, screen, SystemClock())
    screen.say(f"log        {log}")


def skew(runs: RunFiles, as_json: Json = False) -> None:
    from daq.angle.skew import find_skew, late
    from rig.session.encoder_check import logged_at_marks, refuse_several_rigs

    refuse_several_rigs(runs)
    at_marks, paces, marks_late = zip(*(logged_at_marks(run) for run in runs), strict=True)
    found = find_skew(at_marks)
    if found is None:
        raise LogError("no mark of the crank lies within the encoder's readings")
    if as_json:
        told = dataclasses.asdict(found)
        recordings = zip(runs, told["recordings"], paces, marks_late, found.recordings, strict=True)
        for run, each, pace, late_s, own in recordings:
            taken = pace.without(own)
            each |= {"log": str(run), "mark_late_s": late_s, "first_s": None, "period_s": None}
            each |= {} if taken is None else dataclasses.asdict(taken)
        print_json(told)
        return
    lines = []
    for run, each, mark_late_s in zip(runs, found.recordings, marks_late, strict=True):
        rpm = ", ".join(f"{speed * 60 / tau:.2f}" for speed in each.speeds_rad_s)
        line = f"{run}: {each.revolutions} marks at {rpm} rpm"
        if not rpm:
            line = f"{run}: no speed that stays for three marks"
        if each.skew_s is not None and each.skew_uncertainty_s is not None:
            line += f"; late by {late(each.skew_s, each.skew_uncertainty_s)} as this log places it"
        if mark_late_s:
            line += f"; its marks {mark_late_s * 1e6:.1f} us earlier than the card shows them, by its bench"
        lines.append(line)
    if found.angle_rad is None or found.angle_uncertainty_rad is None:
        lines.append(str(found))
    else:
        lines.append(f"mounted at {found.angle_rad:.5f} +- {found.angle_uncertainty_rad:.5f} rad")
        lines.append(f"{found} by itself, with the travel time of the bus's fastest frame")
    screen = Screen(Terminal())
    for line in lines:
        screen.say(line)
