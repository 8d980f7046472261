"""Tells what kind of file this is and whether it is right; the work of `rattle check`."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from daq.errors import ConfigurationError, Problem
from rig.files.bench import parse_bench
from rig.files.faults import read_text, read_toml
from rig.files.scenario import parse_scenario
from rig.files.sweep import parse_sweep

FileKind = Literal["scenario", "bench", "sweep"]

_SCENARIO_KEYS: Final = {"rig", "model", "drive", "acquisition", "limits"}
_BENCH_KEYS: Final = {"signal_generator", "daq_card", "emulation", "inverter", "encoder"}
_SWEEP_KEYS: Final = {"sweep", "axes"}


def validate(path: str | Path) -> FileKind:
    """Check a file and return what it is; raises ConfigurationError with every fault in it."""
    text, source = read_text(path), str(path)
    keys = read_toml(text, source).keys()
    if keys & _SWEEP_KEYS:
        parse_sweep(text, source, Path(path).resolve().parent)
        return "sweep"
    if keys & _SCENARIO_KEYS:
        parse_scenario(text, source)
        return "scenario"
    if keys & _BENCH_KEYS:
        parse_bench(text, source, Path(path).resolve().parent)
        return "bench"
    allowed = (
        "a scenario (rig, [model], [drive], [acquisition]), "
        "a bench ([signal_generator] or [inverter], [daq_card]) or a sweep ([sweep], [axes])"
    )
    raise ConfigurationError(source, [Problem("file", "(unknown kind)", allowed)])
