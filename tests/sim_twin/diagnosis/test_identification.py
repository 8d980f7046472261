"""Values are found far from where they were looked for first, with honest intervals; what is not told is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.identification import (
    VALUES,
    Round,
    Wide,
    draws_of,
    fitted_rounds,
    nothing_known,
)
from sim_twin.diagnosis.subject import Draw, Observed

NUMBERS = 90
WIDES = (
    Wide("stiffness", 1.5e7, 0.5),
    Wide("damping", 0.01, 1.0),
    Wide("friction", 0.01, 0.03, low=0.0, high=1.0, by_ratio=False),
    Wide("mass", 2.0, 0.1),
    Wide("length", 0.3, 0.1),
    Wide("idle", 1.0, 0.3),
)
"""Mass and length are seen by their product alone, the idle one not at all."""
MAP = np.random.default_rng(3).standard_normal((4, NUMBERS))


@dataclass(frozen=True, slots=True)
class Bent:
    """A rig whose numbers follow its values in curves that bend; each rig has a scatter of its own."""

    causes: tuple[Cause, ...] = ()

    @property
    def layout(self) -> Layout:
        return Layout(tuple(Cell(0, f"number {k}", "share of time", 1) for k in range(NUMBERS)))

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        return [(self.shown(draw),) for draw in draws]

    def shown(self, draw: Draw) -> np.ndarray:
        ((name, values),) = draw.effects
        assert name == VALUES
        x = {each.name: float(values[each.name]) for each in WIDES}
        seen = np.array([
            3 * np.log(x["stiffness"] / 1.5e7), np.log(x["damping"] / 0.01), 40 * x["friction"],
            10 * np.log(x["mass"] * x["length"] / 0.6),
        ])  # fmt: skip
        means = (seen + 0.15 * seen**2) @ MAP + 0.3 * np.tanh(seen[::-1] @ MAP)
        rng = np.random.default_rng(draw.seed)
        own = 0.5 * rng.standard_normal(NUMBERS)
        return np.asarray(means + own + rng.standard_normal((draw.blocks, NUMBERS)), np.float32)


@cache
def looked_for(number: int) -> tuple[tuple[Round, ...], np.ndarray]:
    rng = np.random.default_rng([7, number])
    places = rng.standard_normal((1, len(WIDES)))
    known = nothing_known(WIDES)
    (draw,) = draws_of(known, places, rng, blocks=4)
    with threadpool_limits(1, user_api="blas"):  # matrices too small for threads to pay
        found = fitted_rounds(Bent(), WIDES, Bent().shown(draw), Bent().observe, rng)
        return tuple(found), known.values(places)[0]
