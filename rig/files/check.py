"""Tells what kind of file this is and whether it is right; the work of `rattle check`."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from daq.errors import ConfigurationError, Problem
from rig.files.bench import parse_bench
from rig.files.faults import read_text, read_toml
from rig.files.scenario import parse_scenario

FileKind = Literal["scenario", "bench"]

_SCENARIO_KEYS: Final = {"rig", "model", "drive", "acquisition", "limits"}
_BENCH_KEYS: Final = {"signal_generator", "daq_card", "emulation", "inverter", "encoder"}
_SWEEP_KEYS: Final = {"sweep", "scenario", "bench", "runs"}


def validate(path: str | Path) -> FileKind:
    """Check a scenario or bench file and return which it is; raises ConfigurationError with every fault."""
    text, source = read_text(path), str(path)
    keys = read_toml(text, source).keys()
    if keys & _SCENARIO_KEYS:
        parse_scenario(text, source)
        return "scenario"
    if keys & _BENCH_KEYS:
        parse_bench(text, source, Path(path).resolve().parent)
        return "bench"
    if keys & _SWEEP_KEYS:
        problem = Problem("file", "(a sweep)", "a scenario or a bench; sweeps are not in this version")
    else:
        allowed = (
            "a scenario (rig, [model], [drive], [acquisition])"
            " or a bench ([signal_generator] or [inverter], [daq_card])"
        )
        problem = Problem("file", "(unknown kind)", allowed)
    raise ConfigurationError(source, [problem])
