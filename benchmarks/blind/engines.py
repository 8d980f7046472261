"""The truth engines, one a rig: programs that share nothing with the twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, Protocol

from benchmarks.blind.campaigns import Unlisted
from benchmarks.blind.catalogue import BEAM, CRANK, SPATIAL
from benchmarks.blind.recording import Recording

_MODULES = {
    BEAM: "benchmarks.blind.beam.record",
    CRANK: "benchmarks.blind.crank.record",
    SPATIAL: "benchmarks.blind.spatial.record",
}


class Engine(Unlisted, Protocol):
    """Makes a recording of one run."""

    def record(
        self,
        scenario: Mapping[str, Any],
        effects: Sequence[Mapping[str, Any]],
        rig_seed: int,
        run_seed: int,
        *,
        wider: float = 1.0,
    ) -> Recording:
        """Record a run on a healthy rig with `effects` in it, of tolerances so many times `wider`."""


def engine_of(rig: str) -> Engine:
    """The truth engine of a rig, imported when it is asked for (Exudyn is a package of the tests)."""
    engine: Any = import_module(_MODULES[rig])
    checked: Engine = engine
    return checked


def engines() -> dict[str, Engine]:
    """The truth engine of each rig."""
    return {rig: engine_of(rig) for rig in _MODULES}
