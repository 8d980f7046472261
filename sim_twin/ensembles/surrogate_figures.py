"""Figures of many rigs by what a surrogate says of them, in place of simulations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim_twin.ensembles.simulate import Outcome, Variant
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.status import Status
from sim_twin.surrogates.samples import COLUMNS
from sim_twin.surrogates.surrogate import Surrogate

_POINTS = 720
"""Of a revolution."""


@dataclass(frozen=True, slots=True)
class SurrogateFigures:
    """Rms and peak of each channel over a revolution; `density` of the links' material in kg/m3."""

    surrogate: Surrogate
    density: float
    together: ClassVar[int] = 64

    def observe(self, variants: Sequence[Variant]) -> list[Outcome[RunFigures]]:
        """Figures of some planar slider-cranks."""
        found = []
        for variant in variants:
            said = self.surrogate.predict(self._asked(variant))
            values: dict[str, float | int | None] = {}
            for name, row in zip(self.surrogate.channels, said.T, strict=True):
                values[f"{name}_rms_m_s2"] = float(np.sqrt(np.mean(row**2)))
                values[f"{name}_peak_m_s2"] = float(np.abs(row).max())
            found.append(Outcome(Status.COMPLETED, RunFigures(Status.COMPLETED, values)))
        return found

    def _asked(self, variant: Variant) -> np.ndarray:
        rig, drive = variant.twin.rig, variant.twin.drive
        columns = {
            "time": 0.0,
            "angle": 2 * math.pi * np.arange(_POINTS) / _POINTS,
            "speed": drive.speed * 60 / (2 * math.pi),
            "clearance_1": 1e3 * rig.clearance_1,
            "clearance_2": 1e3 * rig.clearance_2,
            "density": self.density,
        }
        return np.column_stack([np.broadcast_to(columns[name], _POINTS) for name in COLUMNS])
