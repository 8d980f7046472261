"""`rattle verify` and `rattle recover`: integrity of a log."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from daq.log.reader import LogReader
from daq.log.recover import LogReport, recover_log, verify_log
from rig.commands.arguments import Json, RunFile, print_json

_UNSOUND = 1


def add_to(app: typer.Typer) -> None:
    """Add the commands."""

    @app.command()
    def verify(log: RunFile, as_json: Json = False) -> None:
        """Check a log's integrity and account for every sample."""
        _show(verify_log(log), as_json)

    @app.command()
    def recover(
        log: RunFile, out: Annotated[Path, typer.Option("-o", metavar="FILE", help="The new log.")]
    ) -> None:
        """Rebuild a log that a crash left, into a new file."""
        _show(recover_log(log, out), as_json=False)


def _show(report: LogReport, as_json: bool) -> None:
    if as_json:
        print_json({**dataclasses.asdict(report), "path": str(report.path), "sound": report.sound})
    else:
        _print(report)
    if not report.sound:
        raise typer.Exit(_UNSOUND)


def _print(report: LogReport) -> None:
    table = Table("topic", "blocks", "samples", "missing", box=None, pad_edge=False)
    for topic in report.topics:
        table.add_row(topic.topic, str(topic.messages), str(topic.samples), str(topic.missing))
    console = Console()
    console.print(table)
    with LogReader(report.path) as log:
        for gap in log.gaps():
            console.print(f"gap: {gap.channel}, {gap.count} samples from {gap.first_sample}: {gap.cause}")
    ended = "complete" if report.complete else f"cut short ({report.damage or 'no end'}): rattle recover"
    verdict = "sound" if report.sound else report.damage or "samples are missing outside the ledger"
    line = f"{report.path}: {verdict if report.complete else ended}"
    console.print(line, markup=False, highlight=False, soft_wrap=True)
