"""Figures of many rigs by what a surrogate says of them, in place of simulations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from sim_twin.ensembles.simulate import Outcome, Variant
from sim_twin.rigs.planar_slider_crank.solver_values import frame_figures
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.status import Status
from sim_twin.surrogates.samples import COLUMNS
from sim_twin.surrogates.surrogate import Surrogate

Array = NDArray[np.float64]
_POINTS = 720
"""Of a revolution."""
HONOURED = ("clearance_1", "clearance_2", "drive.speed")
"""Tolerances that a surrogate has an input for."""


@dataclass(frozen=True, slots=True)
class SurrogateFigures:
    """What a simulation gives of the frame's channels, by a surrogate over the crank's angle.

    `density` of the links' material in kg/m3. Of a variant's tolerances it knows those that are `HONOURED`.
    """

    surrogate: Surrogate
    density: float
    together: ClassVar[int] = 64

    def observe(self, variants: Sequence[Variant]) -> list[Outcome[RunFigures]]:
        """Figures of some planar slider-cranks."""
        found = []
        for variant in variants:
            said = self.surrogate.predict(self.asked(variant))
            values = frame_figures(dict(zip(self.surrogate.channels, said.T, strict=True)))
            found.append(Outcome(Status.COMPLETED, RunFigures(Status.COMPLETED, values)))
        return found

    def outside(self, variants: Sequence[Variant]) -> tuple[int, dict[str, tuple[float, float]]]:
        """How many lie outside of what was learnt, and least and largest that all ask of such inputs."""
        rows = [self.asked(variant)[:1] for variant in variants]
        count = sum(1 for row in rows if self.surrogate.outside(row))
        return count, self.surrogate.outside(np.concatenate(rows))

    def asked(self, variant: Variant) -> Array:
        """What the surrogate takes for a revolution of a variant, shape (n, inputs)."""
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
