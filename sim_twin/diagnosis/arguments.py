"""What one can argue with: where the runner-up predicts otherwise, and what each run says by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_twin.diagnosis.belief import of_a_part
from sim_twin.diagnosis.cause import Hypothesis, parts_of
from sim_twin.diagnosis.findings import Alone, Contrast
from sim_twin.diagnosis.gap import GapMeasure
from sim_twin.diagnosis.library import FEWEST, Library
from sim_twin.diagnosis.screening import numbers_of
from sim_twin.diagnosis.search import Search, believed

Array = NDArray[np.float64]
_CONTRASTS = 5


def contrasts(
    measure: GapMeasure, measured: NDArray[np.floating], chosen: Array | None, rival: Array
) -> tuple[Contrast, ...]:
    """The cells in which rigs of two explanations differ most, of each figure of a channel the largest.

    `measured` are blocks, `chosen` and `rival` rigs' fingerprints, all (n, numbers); no `chosen`: the nominal
    twin. What differs is told in the larger scatter of both.
    """
    layout = measure.layout
    ours = measure if chosen is None else measure.of_repaired(chosen)
    theirs = measure.of_repaired(rival)
    shown, one, other = (
        np.add.reduceat(numbers, layout.starts[:-1]) / np.diff(layout.starts)
        for numbers in (np.mean(measured, axis=0, dtype=np.float64), ours.twin, theirs.twin)
    )
    apart = np.abs(one - other) / np.maximum(ours.floor, theirs.floor)
    found: dict[tuple[str, str | None, str], Contrast] = {}
    for k in np.argsort(-apart, kind="stable"):
        cell = layout.cells[k]
        contrast = Contrast(int(k), float(shown[k]), float(one[k]), float(other[k]), float(apart[k]))
        found.setdefault((cell.channel, cell.partner, cell.what), contrast)
    return tuple(found.values())[:_CONTRASTS]


def alone(
    search: Search,
    in_question: Sequence[Hypothesis],
    best: Hypothesis,
    searched: float,
) -> tuple[Alone, ...]:
    """What each of several runs says of what is in question, and of the parameters of the `best` of it.

    By the rigs that were simulated for all runs together, of which `searched` is the share that there was
    time for; from one run, nothing.
    """
    layout = search.subject.layout
    runs = {cell.run for cell in layout.cells}
    singles = [(cause,) for each in in_question for cause in each]
    weighed = [
        each for each in dict.fromkeys([(), best, *singles, *in_question]) if _known(search.library, each)
    ]
    found = []
    for run in sorted(runs) if len(runs) > 1 else ():
        library = search.library.of(weighed, numbers_of(layout, [run]))
        part = search.of_runs([run], library)
        ranked = of_a_part(believed(part.weigh(part.learn(), weighed)), searched)
        estimates = next((each.estimates() for each in ranked if each.hypothesis == best), [])
        told = tuple(tuple(estimates[at]) for at in parts_of(best)) if estimates else ()
        shares = tuple((each.hypothesis, each.probability) for each in ranked)
        found.append(Alone(run, shares, best, told))
    return tuple(found)


def _known(library: Library, hypothesis: Hypothesis) -> bool:
    return all(library.count((cause,)) >= FEWEST for cause in hypothesis)
