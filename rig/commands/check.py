"""`rattle check`: every fault of a file at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rig.files.check import validate
from rig.files.scenario import load_scenario
from rig.twin.scenario_twin import check_twin


def add_to(app: typer.Typer) -> None:
    """Add the command."""

    @app.command()
    def check(
        file: Annotated[Path, typer.Argument(metavar="FILE", help="A scenario, bench or sweep.")],
    ) -> None:
        """Validate a scenario, bench or sweep file; lists every error at once."""
        kind = validate(file)
        if kind == "scenario":
            check_twin(load_scenario(file))
        typer.echo(f"{file}: {kind}, no faults")
