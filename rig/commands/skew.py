"""`rattle skew`: how late an encoder with a clock of its own is against the card's mark."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from math import tau
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from daq.errors import LogError
from rig.commands.arguments import Json, RunFiles, print_json

if TYPE_CHECKING:
    from daq.angle.skew import RecordingSkew, Skew


def skew(runs: RunFiles, as_json: Json = False) -> None:
    from daq.angle.skew import find_skew
    from rig.session.encoder_check import logged_at_marks, refuse_several_rigs

    refuse_several_rigs(runs)
    at_marks, paces = zip(*(logged_at_marks(run) for run in runs), strict=True)
    found = find_skew(at_marks)
    if found is None:
        raise LogError("no mark of the crank lies within the encoder's readings")
    if as_json:
        told = dataclasses.asdict(found)
        for run, each, pace, own in zip(runs, told["recordings"], paces, found.recordings, strict=True):
            taken = pace.without(own)
            each |= {"log": str(run), "first_s": None, "period_s": None}
            each |= {} if taken is None else dataclasses.asdict(taken)
        print_json(told)
        return
    console = Console()
    for line in (*map(_of_run, runs, found.recordings), *_of_all(found)):
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def _of_run(run: Path, each: RecordingSkew) -> str:
    from daq.angle.skew import late

    rpm = ", ".join(f"{speed * 60 / tau:.2f}" for speed in each.speeds_rad_s)
    marks = f"{each.revolutions} marks at {rpm} rpm" if rpm else "no speed that stays for three marks"
    if each.skew_s is None or each.skew_uncertainty_s is None:
        return f"{run}: {marks}"
    return f"{run}: {marks}; late by {late(each.skew_s, each.skew_uncertainty_s)} as this log places it"


def _of_all(found: Skew) -> Iterator[str]:
    if found.angle_rad is None or found.angle_uncertainty_rad is None:
        yield str(found)
        return
    yield f"mounted at {found.angle_rad:.5f} +- {found.angle_uncertainty_rad:.5f} rad"
    yield f"{found} by itself, with the travel time of the bus's fastest frame"
