"""`rattle scenario`: every key that a scenario of a rig may have."""

from __future__ import annotations

from typing import Annotated

import typer


def scenario(
    rig: Annotated[str, typer.Argument(metavar="RIG", help="impact_beam, or another of the rigs.")],
) -> None:
    from rig.files.whole_scenario import whole_scenario
    from rig.rigs import RIGS

    if rig not in RIGS:
        raise typer.BadParameter(f"{rig!r} is none of {', '.join(RIGS)}", param_hint="RIG")
    typer.echo(whole_scenario(RIGS[rig]), nl=False)
