"""`rattle overlay`: a prediction for a run that was recorded before."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from rig.commands.arguments import EffectsFile, RunFile
from rig.commands.summary import report_and_name
from rig.session.progress import Screen
from rig.twin.overlay import overlay_run


def add_to(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def overlay(
        run: RunFile,
        out: Annotated[
            Path | None, typer.Option("-o", "--out", metavar="FILE", help="Default: RUN.overlay.mcap")
        ] = None,
        effects: EffectsFile = None,
    ) -> None:
        """Add the twin's prediction to a recorded run, in a new file; the run is never changed."""
        screen = Screen(Console())
        target = out or run.with_suffix(".overlay.mcap")
        with screen.busy("predicting"):
            overlay_run(run, target, effects)
        report_and_name(target, screen)
