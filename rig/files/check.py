"""Tells what kind of file this is and whether it is right; the work of `rattle check`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

from daq.errors import ConfigurationError, Problem
from rig.files.bench import parse_bench
from rig.files.faults import read_toml
from rig.files.file_kind import kind_of_tables, read_file
from rig.files.scenario import parse_scenario
from rig.files.sweep import parse_sweep

CheckedKind = Literal["scenario", "bench", "sweep"]


def validate(path: str | Path) -> CheckedKind:
    """Check a file and return what it is; raises ConfigurationError with every fault in it."""
    text, source = read_file(path, *get_args(CheckedKind)), str(path)
    folder = Path(path).resolve().parent
    match kind_of_tables(read_toml(text, source)):
        case "sweep":
            parse_sweep(text, source, folder)
            return "sweep"
        case "scenario":
            parse_scenario(text, source)
            return "scenario"
        case "bench":
            parse_bench(text, source, folder)
            return "bench"
    allowed = (
        "a scenario (rig, [model], [drive], [acquisition]), "
        "a bench ([signal_generator] or [inverter], [daq_card]) or a sweep ([sweep], [axes])"
    )
    raise ConfigurationError(source, [Problem("file", "(unknown kind)", allowed)])
