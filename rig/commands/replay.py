"""`rattle replay`: a log through the same path as a live run."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from rig.commands.arguments import Live, RunFile
from rig.session.progress import Screen


def replay(
    run: RunFile,
    speed: Annotated[
        float,
        typer.Option("--speed", min=0.0, metavar="X", help="Times real time; 0: as fast as possible."),
    ] = 1.0,
    live: Live = False,
) -> None:
    from daq.clock import SystemClock
    from daq.log.reader import LogReader
    from rig.commands.summary import show
    from rig.report.record import RunCollector
    from rig.report.summary import summary_of
    from rig.session.replay import replay_log

    screen = Screen(Console())
    with LogReader(run) as log:
        collector = RunCollector(log)
        replay_log(run, speed, live, screen, SystemClock(), (collector,))
        show(summary_of(collector.record()), screen)
