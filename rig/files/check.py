"""Reads a file of whatever kind `rattle check` takes."""

from __future__ import annotations

from pathlib import Path

from daq.errors import ConfigurationError, Problem
from rig.files.bench import Bench, parse_bench
from rig.files.faults import read_toml
from rig.files.file_kind import kind_of_tables, read_file
from rig.files.scenario import Scenario, parse_scenario
from rig.files.sweep import Sweep, parse_sweep


def load_any(path: str | Path) -> Scenario | Bench | Sweep:
    """Read a scenario, bench or sweep file; raises ConfigurationError with every fault in it."""
    text, source = read_file(path, "scenario", "bench", "sweep"), str(path)
    folder = Path(path).resolve().parent
    match kind_of_tables(read_toml(text, source)):
        case "sweep":
            return parse_sweep(text, source, folder)
        case "scenario":
            return parse_scenario(text, source)
        case "bench":
            return parse_bench(text, source, folder)
    allowed = (
        "a scenario (rig, [model], [drive], [acquisition]), "
        "a bench ([signal_generator] or [inverter], [daq_card]) or a sweep ([sweep], [axes])"
    )
    raise ConfigurationError(source, [Problem("file", "(unknown kind)", allowed)])
