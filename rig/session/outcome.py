"""How a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from daq.errors import RattleError


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """A finished run: its log, its report (None if it could not be written) and what was noticed."""

    log: Path
    report: Path | None
    notices: tuple[str, ...]


class Stopped(RattleError, RuntimeError):
    """A person stopped the run; the rig is in its safe state."""
