"""What a report is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.findings import Findings, Judged
from sim_twin.diagnosis.latent_force import LatentForce

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RunFacts:
    """One run: its file's `name`, the scenario in a line, and the unit of each channel."""

    name: str
    scenario: str
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Reported:
    """Findings with the diagnosis as its file holds it (interface.md), and what is known of the runs.

    `forces` are what the joints' forces lack, the largest first; none where nobody asked. `folder` holds the
    diagnosis.
    """

    findings: Findings
    diagnosis: Mapping[str, Any]
    runs: Sequence[RunFacts]
    remarks: Sequence[str]
    forces: Sequence[LatentForce] = ()
    folder: Path = Path()

    @property
    def verdict(self) -> str:
        """The most probable of "none", "effect" and "unknown"."""
        return self.findings.verdict

    @property
    def judged(self) -> list[Judged]:
        """Every effect, most probable first."""
        return sorted(self.findings.judged, key=lambda each: -each.probability)

    @property
    def repaired(self) -> bool:
        """Whether a repaired twin was compared: one was selected, and there was time to simulate it."""
        return bool(self.findings.selected) and self.findings.repaired is not None

    def judged_of(self, name: str) -> Judged | None:
        """The judgement on an effect."""
        return next((each for each in self.findings.judged if each.cause.name == name), None)

    def run_name(self, number: int) -> str:
        """Name of a run, or its number where nobody gave one."""
        return self.runs[number].name if number < len(self.runs) else f"run {number + 1}"

    def unit(self, run: int, channel: str) -> str:
        """Unit of a channel; "" where nobody gave one."""
        return self.runs[run].units.get(channel, "") if run < len(self.runs) else ""
