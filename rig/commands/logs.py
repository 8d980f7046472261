"""`rattle verify` and `rattle recover`: integrity of a log."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from rig.commands.arguments import Json, RunFile, print_json

if TYPE_CHECKING:
    from daq.log.recover import LogReport

_UNSOUND = 1


def verify(log: RunFile, as_json: Json = False) -> None:
    from daq.log.recover import verify_log

    _show(verify_log(log), as_json)


def recover(
    log: RunFile, out: Annotated[Path, typer.Option("-o", metavar="FILE", help="The new log.")]
) -> None:
    from daq.log.recover import recover_log

    _show(recover_log(log, out), as_json=False)


def _show(report: LogReport, as_json: bool) -> None:
    if as_json:
        print_json({**dataclasses.asdict(report), "path": str(report.path), "sound": report.sound})
    else:
        _print(report)
    if not report.sound:
        raise typer.Exit(_UNSOUND)


def _print(report: LogReport) -> None:
    from daq.log.reader import LogReader

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
