"""`rattle check`: every fault of a file at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.files.check import validate


def add_to(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def check(file: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario or bench.")]) -> None:
        """Validate a scenario or bench file; lists every error at once."""
        typer.echo(f"{file}: {validate(file)}, no faults")
