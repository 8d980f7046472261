"""The commands of `rattle`, each loaded when it is called, and its exit codes."""

from __future__ import annotations

import sys
from pkgutil import resolve_name
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand

from daq.errors import ConfigurationError, InterlockTripped, RattleError, UnphysicalParameter, harmless
from daq.plugins import UNUSED
from rig.session.signals import Stopped

_HELP: Final = {
    "run:run": "Drive the rig, record every instrument, predict, overlay; prints the path of the log.",
    "sweep:sweep": "Run a scenario point by point; the same call goes on where a sweep was stopped.",
    "sweep:centre": (
        "Find the drive's offset that centres the beam between its stops; writes a scenario that has it."
    ),
    "dwell:dwell": "Record a crank at several speeds in one log, without a twin; `rattle skew` reads it.",
    "monitor:monitor": (
        "Show all sensors live with nothing driven; a tap or a turn by hand tells what hangs where."
    ),
    "run:emulate": (
        "Start the emulated instruments on their real wire protocols; prints where each listens."
    ),
    "run:live": (
        "Keep up the page of the live view, which runs and replays with --live tell; the first starts it too."
    ),
    "predict:predict": (
        "Run the twin only: from rest with the full drive, or with --seed a healthy rig with noise."
    ),
    "diagnose:calibrate": (
        "Fit what a healthy rig may differ by to reference runs; --model MODEL.toml then uses it."
    ),
    "identify:identify": (
        "Find values of a rig that nobody knows in recordings of a healthy rig; --model MODEL.toml then "
        "uses them."
    ),
    "predict:ensemble": (
        "Draw healthy rigs of a scenario, run each from rest, and show how their figures spread."
    ),
    "reproduce:reproduce": (
        "Compute the papers' figures anew, and say where they differ from the text and by how much."
    ),
    "logs:overlay": (
        "Add the twin's prediction to a recorded run, in a new file; with effects, the nominal twin too."
    ),
    "logs:replay": "Play a log through the same path as a live run.",
    "diagnose:diagnose": (
        "Say where rig and twin differ, which effect causes it, and how far the gap shrinks with it in."
    ),
    "diagnose:gap": "Measure how far runs lie from their twin, and from the twin with some effects in.",
    "predict:effects": (
        "List the effects that a scenario's twin can have, with the ranges of their parameters."
    ),
    "runs:runs": "List runs by what they were, tag them, or lay two side by side, measured against measured.",
    "scenario:scenario": (
        "Print a scenario with every key of a rig: default, unit, range, and where the value is from."
    ),
    "check:check": "Validate a scenario, bench or sweep file; lists every error at once. Nothing moves.",
    "logs:verify": "Check a log's integrity and account for every sample.",
    "logs:recover": "Rebuild a log that a crash left, into a new file.",
    "exchange:export": "Write a log in another program's format; warns of what the format cannot hold.",
    "exchange:import_": "Make a log of another program's file; a scenario says which rig it was.",
    "surrogate:surrogate": (
        "Predict a crank's frame by a network that learnt from logs; how far that may be trusted."
    ),
    "dwell:skew": (
        "Tell an encoder's lag from its mounting angle; `rattle dwell` records the speeds that it takes."
    ),
}  # by module and function
COMMANDS: Final = tuple(
    (place.partition(":")[2].rstrip("_"), f"rig.commands.{place}", told) for place, told in _HELP.items()
)
"""Name, module and function, help. A module here imports what the work takes in its functions' bodies."""

FAILED, WRONG_USE, INTERLOCK, INTERRUPTED = 1, 2, 3, 130
_CODES: tuple[tuple[type[BaseException], int], ...] = (
    (ConfigurationError, WRONG_USE),
    (UnphysicalParameter, WRONG_USE),
    (InterlockTripped, INTERLOCK),
    (Stopped, INTERRUPTED),
    (KeyboardInterrupt, INTERRUPTED),
    (typer.Abort, INTERRUPTED),
    (RattleError, FAILED),
)


class _LoadedWhenCalled(TyperCommand):
    """Holds what the list of commands shows; the command itself takes over once its arguments are read."""

    def make_context(self, info_name: str | None, args: list[str], *more: Any, **extra: Any) -> Any:
        where, told = next((where, told) for name, where, told in COMMANDS if name == self.name)
        alone, found = _app(), resolve_name(where)
        if isinstance(found, typer.Typer):  # commands of its own
            alone = found
        else:
            alone.command(self.name, help=told)(found)
        return typer.main.get_command(alone).make_context(info_name, args, *more, **extra)


def _app() -> typer.Typer:
    return typer.Typer(
        help="Drive a rig with clearances, record it, and lay its physics twin over every measurement.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"rattle {version('rattle')}")
        raise typer.Exit


def _top(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_version, help="Print the version.")
    ] = False,
) -> None: ...


def main() -> None:
    """Run the command line and end the process with its exit code."""
    app = _app()
    app.callback()(_top)
    for name, _, told in COMMANDS:
        app.command(name, cls=_LoadedWhenCalled, help=told)(lambda: None)
    try:
        try:
            # Without standalone mode typer returns the code of a typer.Exit that a command raised.
            code = int(app(standalone_mode=False) or 0)
        finally:  # what other packages offered in vain is told before what it may have led to
            for fault in UNUSED:
                print(harmless(f"! {fault}"), file=sys.stderr)
    except tuple(kind for kind, _ in _CODES) as error:
        words = "; ".join([str(error) or "interrupted", *getattr(error, "__notes__", ())])
        print(harmless(f"rattle: {words}"), file=sys.stderr)
        code = next(code for kind, code in _CODES if isinstance(error, kind))
    except typer.TyperException as error:
        if words := error.format_message():  # none where the help has been shown
            print(harmless(f"rattle: {words}"), file=sys.stderr)
        code = WRONG_USE
    sys.exit(code)
