"""Logs, predictions, runs and diagnoses from Python.

    import rattle

    log = rattle.open("runs/RUN.mcap")
    log["contact.force_upper"].to_pandas()

Whatever is wrong raises a `rattle.RattleError` that says what, as the commands do.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from os import PathLike
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from daq.block import SampleBlock
    from daq.errors import RattleError
    from daq.log.reader import Origin
    from daq.log.records import Event, Impact
    from rig.library.diagnosis import Diagnosis
    from rig.library.log import Log, Records, Series

__all__ = ["Diagnosis", "Log", "RattleError", "Records", "Series", "diagnose", "open", "predict", "run"]

_File = str | PathLike[str]
_Effects = _File | Sequence[Mapping[str, Any]]
_LAZY = {
    "Diagnosis": "rig.library.diagnosis",
    "Log": "rig.library.log",
    "RattleError": "daq.errors",
    "Records": "rig.library.log",
    "Series": "rig.library.log",
}


def open(log: _File) -> Log:  # noqa: A001 - as rattle.open it shadows nothing
    """Open a log for reading, also one that a crash left: `Log.complete` and `Log.damage` say so.

    Raises RattleError where it is no log.
    """
    from rig.library.log import Log

    return Log(log)


def predict(
    scenario: _File,
    effects: _Effects | None = None,
    *,
    settings: Mapping[str, object] | None = None,
    seed: int | None = None,
    out: _File | None = None,
) -> Log:
    """Run the twin of a scenario alone, as `rattle predict` does; what it predicts is in `Log.predicted`.

    `effects` is an effects file or what stands in one: `[{"name": ..., "parameters": {...}}]`. `settings` are
    other values of the scenario by key: `{"drive.frequency": "21 Hz"}`. Without `seed` the nominal rig, from
    rest and without noise; with it a healthy one. `out` keeps the log; else it is gone with what is returned.
    Raises RattleError.
    """
    from rig.library.predict import predicted

    return predicted(scenario, effects, settings, seed, out)


def run(
    scenario: _File,
    bench: _File | None = None,
    *,
    out: _File = "runs",
    settings: Mapping[str, object] | None = None,
    on_block: Callable[[Origin, SampleBlock], object] | None = None,
    on_event: Callable[[Event], object] | None = None,
    on_impact: Callable[[Impact], object] | None = None,
    until: Callable[[], bool] = lambda: False,
    quiet: bool = False,
) -> Log:
    """Drive the rig, record and predict, as `rattle run` does; returns the log once the rig stands.

    Without `bench` the instruments are emulated. Callbacks get what comes as it comes, in a thread of their
    own, and the rig waits for none: who is slow misses some, who raises is not called again, and a
    RuntimeWarning says so at the end. `until` is asked after each reading, ten times a second: once it is
    true the record ends. All of them are Python in the process that acquires, and must be quick. An interrupt
    (Ctrl-C, or that of a notebook) switches the drive off. Raises RattleError; the log is then named in what
    is printed.
    """
    from rig.library.run import Callbacks, ran

    return ran(scenario, bench, out, settings, Callbacks(on_block, on_event, on_impact), until, quiet)


def diagnose(
    logs: _File | Log | Sequence[_File | Log],
    *,
    out: _File | None = None,
    model: _File | None = None,
    seed: int = 0,
    budget: float | None = None,
    quiet: bool = False,
    subject: _File | None = None,
) -> Diagnosis:
    """Say where rig and twin differ, which effect causes it, and how far the gap shrinks with that in.

    As `rattle diagnose` does. Several logs are one campaign on one rig. `budget` is the time to spend, in s;
    without it 120, and of a rig of one's own as long as it takes. `subject` is a Python file with such a rig,
    or the name of an installed one; `logs` are its files then, and `model` does not count.
    `out` keeps the report; else it is gone with what is returned. Raises RattleError.
    """
    from rig.library.diagnosis import diagnosed

    return diagnosed(logs, out, model, seed, budget, quiet, subject)


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
