"""What kind of file this is, so that one in the place of another is called by its name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

from daq.errors import ConfigurationError, Problem
from daq.log.reader import begins_as_log
from drivers.protocols.emergency_stop import STOP_TABLE
from rig.files.faults import read_text, read_toml
from rig.instruments import INSTRUMENTS

FileKind = Literal["scenario", "bench", "sweep", "model", "log"]


@cache
def _keys() -> Mapping[FileKind, frozenset[str]]:
    """The tables and keys at the top of each; `name` could be anybody's."""
    return {
        "scenario": frozenset({"rig", "model", "drive", "acquisition", "limits"}),
        "bench": frozenset({*INSTRUMENTS, "emulation", STOP_TABLE}),
        "sweep": frozenset({"sweep", "scenario", "axes", "acquisition"}),
        "model": frozenset({"rig", "runs", "scenarios", "tolerances"}),
    }


_COMMANDS: Final[Mapping[FileKind, str]] = {
    "scenario": "rattle run {}",
    "bench": "rattle run SCENARIO.toml --bench {}",
    "sweep": "rattle sweep {}",
    "model": "rattle run SCENARIO.toml --model {}",
    "log": "rattle replay {}",
}


def kind_of_tables(tables: Mapping[str, Any]) -> FileKind | None:
    """The kind that most of a TOML file's keys are of, the first of several; None where none is of any."""
    kind = max(_keys(), key=lambda each: _keys_in(tables, each))
    return kind if _keys_in(tables, kind) else None


def read_file(path: str | Path, *wanted: FileKind) -> str:
    """Text of a file that is to be of one of the kinds `wanted`; what is wrong in it is left to its parser.

    Raises ConfigurationError where it cannot be read or is plainly of another kind.
    """
    if begins_as_log(Path(path)):
        raise _misplaced(path, "log", wanted)
    text = read_text(path)
    _refuse_others(path, text, wanted)
    return text


def refuse_other_than_log(path: Path) -> None:
    """Raise ConfigurationError for a file that is plainly no log but something else that rattle reads."""
    if begins_as_log(path):
        return
    try:
        text = read_text(path)
    except ConfigurationError:
        return  # what opens the log says more of it
    _refuse_others(path, text, ("log",))


def _refuse_others(path: str | Path, text: str, wanted: tuple[FileKind, ...]) -> None:
    try:
        tables = read_toml(text, str(path))
    except ConfigurationError:
        return  # its parser says where
    kind = kind_of_tables(tables)
    if kind is not None and not any(_keys_in(tables, each) == _keys_in(tables, kind) for each in wanted):
        raise _misplaced(path, kind, wanted)


def _keys_in(tables: Mapping[str, Any], kind: FileKind) -> int:
    return len(_keys().get(kind, frozenset()) & tables.keys())


def _misplaced(path: str | Path, kind: FileKind, wanted: tuple[FileKind, ...]) -> ConfigurationError:
    taken = " or ".join(f"a {each}" for each in wanted)
    allowed = f"{taken} is taken here; a {kind} by: {_COMMANDS[kind].format(path)}"
    return ConfigurationError(str(path), [Problem("file", f"(a {kind})", allowed)])
