"""`rattle skew`: how late an encoder with a clock of its own is against the card's mark."""

from __future__ import annotations

import dataclasses
from math import tau

import typer
from rich.console import Console

from daq.angle import find_skew
from daq.errors import LogError
from rig.commands.arguments import Json, RunFiles, print_json
from rig.session.encoder_check import logged_at_marks


def add_to(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def skew(runs: RunFiles, as_json: Json = False) -> None:
        """Tell an encoder's lag from its mounting angle, from runs at two speeds or more."""
        at_marks = [logged_at_marks(run) for run in runs]
        found = find_skew(at_marks)
        if found is None:
            raise LogError("no mark of the crank lies within the encoder's readings")
        if as_json:
            print_json(dataclasses.asdict(found))
            return
        console = Console()
        for run, each in zip(runs, at_marks, strict=True):
            speed = (
                "no mark" if not len(each.speed_rad_s) else f"{each.speed_rad_s.mean() * 60 / tau:.2f} rpm"
            )
            line = f"{run}: {len(each.speed_rad_s)} marks, {speed}"
            console.print(line, markup=False, highlight=False, soft_wrap=True)
        angle = "" if found.angle_rad is None else f", mounted at {found.angle_rad:.5f} rad"
        console.print(f"{found}{angle}", markup=False, highlight=False, soft_wrap=True)
