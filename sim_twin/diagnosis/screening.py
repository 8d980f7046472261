"""The first look at every cause: run by run, of a further one only what the earlier ones do not rule out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.cause import Hypothesis
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.library import Library, Order
from sim_twin.diagnosis.subject import Execute

Samples = NDArray[np.float32]


@dataclass(slots=True)
class Screening:
    """Cases of an order, observed of ever more runs."""

    order: Order
    execute: Execute
    asked: int = 0
    whole: bool = True
    """Motions of one run that were asked for, and whether there was time for all."""
    _shown: dict[tuple[int, int, int], Samples | None] = field(default_factory=dict)
    """By draw, its observation, and run."""

    def observe(self, run: int, wanted: Collection[Hypothesis]) -> None:
        """Have the cases of the `wanted` hypotheses observed of a run, if they are not yet."""
        asked: list[tuple[int, list[int]]] = []
        for number, cases in enumerate(self.order.cases):
            at = [k for k, (h, _) in enumerate(cases) if h in wanted and (number, k, run) not in self._shown]
            if at:
                asked.append((number, at))
        draws = [self.order.draws[number] for number, _ in asked]
        seen = [
            replace(draw, sensing=tuple(draw.sensing[k] for k in at), runs=(run,))
            for draw, (_, at) in zip(draws, asked, strict=True)
        ]
        observed = self.execute(seen)
        for (number, at), shown in zip(asked, observed, strict=True):
            for k, blocks in zip(at, shown, strict=bool(shown)):
                self._shown[number, k, run] = blocks
        self.asked += len(observed)
        self.whole &= all(observed)

    def add_to(self, library: Library, runs: Sequence[int], wanted: Collection[Hypothesis]) -> None:
        """Put what was observed of all these runs (in their order) into a library."""
        for number, cases in enumerate(self.order.cases):
            kept, shown = [], []
            for k, case in enumerate(cases):
                seen = all((number, k, run) in self._shown for run in runs)
                if case[0] in wanted and seen:
                    kept.append(case)
                    shown.append(_joined([self._shown[number, k, run] for run in runs]))
            library.add(Order((self.order.draws[number],), (tuple(kept),)), [tuple(shown)])


def _joined(runs: Sequence[Samples | None]) -> Samples | None:
    whole = [one for one in runs if one is not None]
    return np.concatenate(whole, axis=1) if len(whole) == len(runs) else None


def numbers_of(layout: Layout, runs: Sequence[int]) -> NDArray[np.intp]:
    """Which numbers of a fingerprint are of these runs."""
    of_runs = np.array([cell.run in runs for cell in layout.cells])
    return np.flatnonzero(np.repeat(of_runs, np.diff(layout.starts)))


def layout_of(layout: Layout, runs: Sequence[int]) -> Layout:
    """The cells of these runs, which are numbered anew."""
    return Layout(tuple(replace(c, run=list(runs).index(c.run)) for c in layout.cells if c.run in runs))
