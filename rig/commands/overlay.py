"""`rattle overlay`: a prediction for a run that was recorded before."""

from __future__ import annotations

from pathlib import Path
from statistics import mean
from typing import Annotated

import typer
from rich.console import Console

from daq.log import LogReader
from rig.commands.arguments import EffectsFile, Model, RunFile
from rig.commands.summary import report_and_name
from rig.report.closeness import overall_closeness
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
        model: Model = None,
    ) -> None:
        """Add the twin's prediction to a recorded run, in a new file; with effects, the nominal twin too."""
        screen = Screen(Console())
        target = out or run.with_suffix(".overlay.mcap")
        with screen.busy("predicting"):
            overlay_run(run, target, effects, model, screen.warn)
        _show_impacts(target, screen)
        if effects is not None:
            _show_closeness(target, screen)
        report_and_name(target, screen)


def _show_impacts(log: Path, screen: Screen) -> None:
    """Number and mean peak of the impacts on each channel, measured and predicted."""
    with LogReader(log) as reader:
        units = {name: channel.unit for name, channel in reader.channels("measured").items()}
        peaks: dict[str, dict[str, list[float]]] = {}
        for impact in reader.impacts():
            peaks.setdefault(impact.channel, {}).setdefault(impact.origin, []).append(impact.peak)
    for channel, by_origin in peaks.items():
        each = (
            f"{origin} {len(found)}, mean peak {mean(found):.4g} {units[channel]}"
            for origin, found in by_origin.items()
        )
        screen.say(f"impacts    {channel}: {'; '.join(each)}")


def _show_closeness(log: Path, screen: Screen) -> None:
    found = overall_closeness(log)
    if found is not None:
        screen.say(f"nominal    autospectra {found.nominal_db:.1f} dB off those measured")
        screen.say(
            f"repaired   {found.repaired_db:.1f} dB; the run's own halves lie {found.halves_db:.1f} dB apart"
        )
