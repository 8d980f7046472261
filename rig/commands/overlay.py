"""`rattle overlay`: a prediction for a run that was recorded before."""

from __future__ import annotations

from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from rig.commands.arguments import EffectsFile, Model, RunFile
from rig.session.progress import Screen

if TYPE_CHECKING:
    from rig.report.record import RunRecord


def overlay(
    run: RunFile,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Default: RUN.overlay.mcap")
    ] = None,
    effects: EffectsFile = None,
    model: Model = None,
) -> None:
    from rig.commands.summary import report_and_name
    from rig.report.record import read_run
    from rig.session.overlay import overlay_run

    screen = Screen(Console())
    target = out or run.with_suffix(".overlay.mcap")
    with screen.busy("predicting"):
        overlay_run(run, target, effects, model, screen.warn)
    overlaid = read_run(target)
    _show_impacts(overlaid, screen)
    if effects is not None:
        _show_closeness(overlaid, screen)
    report_and_name(overlaid, screen)


def _show_impacts(run: RunRecord, screen: Screen) -> None:
    """Number and mean peak of the impacts on each channel, measured and predicted."""
    peaks: dict[str, dict[str, list[float]]] = {}
    for impact in run.impacts:
        peaks.setdefault(impact.channel, {}).setdefault(impact.origin, []).append(impact.peak)
    for channel, by_origin in peaks.items():
        each = (
            f"{origin} {len(found)}, mean peak {mean(found):.4g} {run.channels[channel].unit}"
            for origin, found in by_origin.items()
        )
        screen.say(f"impacts    {channel}: {'; '.join(each)}")


def _show_closeness(run: RunRecord, screen: Screen) -> None:
    from rig.report.closeness import overall_closeness

    found = overall_closeness(run)
    if found is not None:
        screen.say(f"nominal    autospectra {found.nominal_db:.1f} dB off those measured")
        screen.say(
            f"repaired   {found.repaired_db:.1f} dB; the run's own halves lie {found.halves_db:.1f} dB apart"
        )
