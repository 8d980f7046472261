"""Builds the command line and turns errors into exit codes."""

from __future__ import annotations

import sys
from collections.abc import Callable

import typer

from daq.errors import ConfigurationError, InterlockTripped, RattleError, UnphysicalParameter
from rig.commands import (
    calibrate,
    centre,
    check,
    diagnose,
    dwell,
    effects,
    emulate,
    ensemble,
    exchange,
    logs,
    overlay,
    predict,
    replay,
    reproduce,
    run,
    skew,
    sweep,
)
from rig.session.devices import Connect
from rig.session.signals import Stopped

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


def build(connect: Connect) -> Callable[[], None]:
    """Return the command line, with `connect` making the devices of a bench."""
    app = typer.Typer(
        help="Drive a rig with clearances, record it, and lay its physics twin over every measurement.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
    )
    run.add_to(app, connect)
    sweep.add_to(app, connect)
    centre.add_to(app, connect)
    dwell.add_to(app, connect)
    modules = (
        emulate,
        predict,
        calibrate,
        ensemble,
        reproduce,
        overlay,
        replay,
        diagnose,
        effects,
        check,
        logs,
        exchange,
        skew,
    )
    for module in modules:
        module.add_to(app)
    return lambda: sys.exit(_guarded(app))


def _guarded(app: typer.Typer) -> int:
    try:
        # Without standalone mode typer returns the code of a typer.Exit that a command raised.
        return int(app(standalone_mode=False) or 0)
    except tuple(kind for kind, _ in _CODES) as error:
        print(f"rattle: {error or 'interrupted'}", file=sys.stderr)
        return next(code for kind, code in _CODES if isinstance(error, kind))
    except typer.TyperException as error:
        told = error.format_message() if isinstance(error, typer.BadParameter) else error
        print(f"rattle: {told}", file=sys.stderr)
        return WRONG_USE
