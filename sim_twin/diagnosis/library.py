"""What has been simulated so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Hypothesis, named, parts_of
from sim_twin.diagnosis.draw import Draw, Observed

Array = NDArray[np.float64]
_FEWEST_SHARED = 4
"""Motions over which those cases are spread that may share some."""


@dataclass(frozen=True, slots=True)
class Order:
    """Draws to be simulated, and what each observation of each of them is a case of."""

    draws: tuple[Draw, ...] = ()
    cases: tuple[tuple[tuple[Hypothesis, Array], ...], ...] = ()

    def __add__(self, other: Order) -> Order:
        return Order(self.draws + other.draws, self.cases + other.cases)

    def __len__(self) -> int:
        return len(self.draws)


@dataclass(slots=True)
class Library:
    """Simulated fingerprints by hypothesis: parameters (n, ...) and fingerprints (n, blocks, numbers)."""

    _values: dict[Hypothesis, list[Array]] = field(default_factory=dict)
    _fingerprints: dict[Hypothesis, list[NDArray[np.float32]]] = field(default_factory=dict)
    failed: int = 0
    observations: int = 0

    def add(self, order: Order, observed: Sequence[Observed]) -> None:
        """Take what came of an order; what failed is counted."""
        for cases, shown in zip(order.cases, observed, strict=True):
            for (hypothesis, values), blocks in zip(cases, shown, strict=bool(shown)):
                if blocks is None:
                    self.failed += 1
                    continue
                self.observations += 1
                self._values.setdefault(hypothesis, []).append(values)
                self._fingerprints.setdefault(hypothesis, []).append(blocks)

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        """All that something has been simulated of."""
        return tuple(self._values)

    def count(self, hypothesis: Hypothesis) -> int:
        """How many observations there are of it."""
        return len(self._values.get(hypothesis, ()))

    def values(self, hypothesis: Hypothesis) -> Array:
        """Parameters of each observation, shape (n, parameters)."""
        return np.array(self._values[hypothesis])

    def fingerprints(self, hypothesis: Hypothesis) -> Sequence[NDArray[np.float32]]:
        """Fingerprints of each observation, (blocks, numbers)."""
        return self._fingerprints[hypothesis]


def order_of(
    cases: Mapping[Hypothesis, Array], rng: np.random.Generator, blocks: int = 1, together: int = 6
) -> Order:
    """Order one observation for each row of parameters of each hypothesis.

    Those in which only sensors differ from a healthy rig share motions, at most `together` of them one,
    spread over four at least.
    """
    order = Order()
    of_sensors = [
        (hypothesis, row)
        for hypothesis, rows in cases.items()
        for row in rows
        if hypothesis and all(cause.sensing for cause in hypothesis)
    ]
    of_sensors = [of_sensors[k] for k in rng.permutation(len(of_sensors))]
    for hypothesis, rows in cases.items():
        if hypothesis and all(cause.sensing for cause in hypothesis):
            continue
        for row in rows:
            order += _one(hypothesis, row, rng, blocks)
    # one that fails must not take most of them along
    together = max(1, min(together, len(of_sensors) // _FEWEST_SHARED))
    for first in range(0, len(of_sensors), together):
        order += _shared(of_sensors[first : first + together], rng, blocks)
    return order


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**62))


def _one(hypothesis: Hypothesis, row: Array, rng: np.random.Generator, blocks: int) -> Order:
    parts = zip(hypothesis, parts_of(hypothesis), strict=True)
    split = [(cause.sensing, cause.named(row[at])) for cause, at in parts]
    moving = tuple(effect for sensing, effect in split if not sensing)
    shown = tuple(effect for sensing, effect in split if sensing)
    return Order((Draw(moving, _seed(rng), (shown,), blocks),), (((hypothesis, row),),))


def _shared(cases: Sequence[tuple[Hypothesis, Array]], rng: np.random.Generator, blocks: int) -> Order:
    sensing = tuple(named(hypothesis, row) for hypothesis, row in cases)
    return Order((Draw((), _seed(rng), sensing, blocks),), (tuple(cases),))
