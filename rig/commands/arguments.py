"""Arguments that several commands share."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from daq.errors import RattleError

if TYPE_CHECKING:
    from rig.files.bench import Bench
    from rig.files.scenario import Scenario
    from rig.files.sweep import Sweep

_Wanted = TypeVar("_Wanted", "Scenario", "Sweep")

ScenarioFile = Annotated[Path, typer.Argument(metavar="SCENARIO.toml", help="What to run.")]


def is_log(path: Path) -> Path:
    """The path; raises ConfigurationError for a file that is plainly something else."""
    from rig.files.file_kind import refuse_other_than_log

    refuse_other_than_log(path)
    return path


RunFile = Annotated[Path, typer.Argument(metavar="RUN.mcap", help="The log of a run.", callback=is_log)]
RunFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="RUN.mcap...",
        help="Logs of runs of one rig.",
        callback=lambda paths: [is_log(path) for path in paths],
    ),
]
BenchFile = Annotated[
    Path | None,
    typer.Option("--bench", metavar="BENCH.toml", help="Which instrument hangs where. Without: emulated."),
]
EffectsFile = Annotated[
    Path | None, typer.Option("--effects", metavar="EFFECTS.json", help="Effects that the twin gets.")
]
Model = Annotated[
    Path | None,
    typer.Option("--model", metavar="MODEL.toml", help="What rattle identify or calibrate found of the rig."),
]
Json = Annotated[bool, typer.Option("--json", help="Print machine-readable output.")]
Live = Annotated[bool, typer.Option("--live", help="Show it in a browser while it goes on.")]
Note = Annotated[
    list[str] | None,
    typer.Option(
        "--note", metavar="KEY=TEXT", help="What this run is: operator=Ada. May come again; rattle runs."
    ),
]

RUNS = Path("runs")
"""Where logs go unless another folder is named."""


def _to_write(folder: Path | None) -> Path | None:
    from rig.files.out_folder import check_out

    if folder is not None:
        try:
            check_out(folder)
        except RattleError as error:
            raise typer.BadParameter(str(error)) from error
    return folder


def out_folder(told: str, option: str = "--out") -> Any:
    """An option that names a folder for what a command makes, looked at before the command does anything."""
    return typer.Option(option, metavar="DIR", help=told, callback=_to_write)


def load_pair(load: Callable[[Path], _Wanted], file: Path, bench_file: Path | None) -> tuple[_Wanted, Bench]:
    """Scenario or sweep, and bench (the emulated one without a file); raises one error with both's faults."""
    from rig.files.bench import embedded_bench, load_bench
    from rig.files.faults import Gathered

    gathered = Gathered()
    wanted, bench = gathered.of(lambda: load(file)), None
    rig = None if wanted is None else wanted.rig
    if bench_file is not None:
        bench = gathered.of(lambda: load_bench(bench_file, rig))
    elif rig is not None:
        bench = embedded_bench(rig)
    if wanted is None or bench is None:
        raise gathered.error()
    return wanted, bench


def overrides(texts: list[str]) -> Iterator[tuple[str, object]]:
    """What --set says, by key."""
    for text in texts:
        key, mark, value = text.partition("=")
        key, value = key.replace('"', "").strip(), value.strip()
        if not mark or not key or not value:
            raise typer.BadParameter(f'--set {text}: KEY=VALUE, such as drive.frequency="21 Hz"')
        yield key, as_toml(value)


def as_toml(text: str) -> object:
    """A value as TOML has it, or a text, for a shell takes its quotes away."""
    import tomllib

    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def noted(texts: list[str] | None) -> Iterator[tuple[str, object]]:
    """What --note says, by key of the scenario: always a text."""
    for text in texts or []:
        key, mark, value = (each.strip() for each in text.partition("="))
        if not mark or not key or not value or "." in key:
            raise typer.BadParameter(f'--note {text}: KEY=TEXT, such as operator="Ada"')
        yield f"notes.{key}", value


def once(given: Iterable[tuple[str, object]]) -> dict[str, object]:
    """Values by key of the scenario, none of which may come twice."""
    found: dict[str, object] = {}
    for key, value in given:
        if key in found:
            raise typer.BadParameter(f"{key} has two values, {found[key]} and {value}; name one")
        found[key] = value
    return found


def seconds(text: str, option: str) -> float:
    """A time as an option has it, in s: "1.5" or "20 ms"."""
    from rig.files.quantity import QuantityError, si_value

    try:
        found = float(text) if text.strip()[-1:].isdigit() else si_value(text, "s")
    except (QuantityError, ValueError) as error:
        raise typer.BadParameter(f"{option} {text}: a time such as 1.5 or '20 ms'") from error
    if found < 0:
        raise typer.BadParameter(f"{option} {text}: not before the start of recording")
    return found


def print_json(result: object) -> None:
    """Print a result for another program."""
    typer.echo(json.dumps(result, indent=2, allow_nan=False))
