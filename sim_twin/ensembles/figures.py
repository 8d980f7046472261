"""Observes the figures of every run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from daq.errors import SimulationFailed
from sim_twin.ensembles.variant import Outcome, Variant, status_of
from sim_twin.rigs.rig_model import RigModel
from sim_twin.rigs.side_by_side import RunFigures
from sim_twin.status import Status


@dataclass(frozen=True, slots=True)
class Figures:
    """The rig's own figures of the motion from rest, over `duration` s after the first `settle` s.

    Rigs that have no way to run side by side start at phase 0; another phase is a ValueError.
    """

    settle: float
    duration: float
    together: ClassVar[int] = 16

    def observe(self, variants: Sequence[Variant]) -> list[Outcome[RunFigures]]:
        """Figures of some runs of one rig."""
        model = variants[0].twin.model
        if model.side_by_side is None:
            return [self._alone(model, variant) for variant in variants]
        twins, phases = [each.twin for each in variants], [each.phase for each in variants]
        return [
            _outcome(each) for each in model.side_by_side.figures(twins, phases, self.settle, self.duration)
        ]

    def _alone(self, model: RigModel, variant: Variant) -> Outcome[RunFigures]:
        if variant.phase != 0:
            raise ValueError(f"figures of the {model.name} start at phase 0, not {variant.phase:g} rad")
        try:
            values = model.solver_values(variant.twin, self.settle, self.duration)
        except SimulationFailed as error:
            return Outcome(status_of(error))
        finite = all(value is None or np.isfinite(value) for value in values.values())
        return _outcome(RunFigures(Status.COMPLETED if finite else Status.DIVERGED, values))


def _outcome(figures: RunFigures) -> Outcome[RunFigures]:
    return Outcome(figures.status, figures if figures.status is Status.COMPLETED else None)
