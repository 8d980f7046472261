"""All figures of the page, in its order, and their computation, here or in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed

from daq.errors import SimulationFailed
from rig.pages.content import Sentence
from rig.reproduce.figure import Effort, Outcome, PaperFigure
from rig.reproduce.figures import ibs_7_11, ibs_8_9, ibs_10, ibs_base, psc, ssc

FIGURES: dict[str, PaperFigure] = {
    figure.name: figure
    for figure in (
        ibs_7_11.FIGURE_7,
        ibs_8_9.FIGURE_8,
        ibs_8_9.FIGURE_9,
        ibs_10.FIGURE,
        ibs_7_11.FIGURE_11,
        ibs_base.FIGURE_12,
        ibs_base.FIGURE_13,
        ibs_base.TABLE_3,
        ssc.FIGURE_16,
        ssc.FIGURE_17,
        psc.FIGURE,
    )
}
"""Adding one means adding a line."""


def compute(name: str, effort: Effort) -> Outcome:
    """One figure; what its simulation failed of is in the outcome."""
    try:
        return FIGURES[name].compute(effort)
    except SimulationFailed as error:
        return Outcome([], [Sentence(f"Not computed: {error}", warning=True)], str(error))


def compute_all(
    names: Sequence[str], effort: Effort, executor: Executor | None, progress: Callable[[int], None]
) -> dict[str, Outcome]:
    """Outcomes in the order of `names`; `progress` hears how many are done. Without `executor`: here."""
    if executor is None:
        outcomes = {}
        for done, name in enumerate(names, start=1):
            outcomes[name] = compute(name, effort)
            progress(done)
        return outcomes
    # The last figures of the page take longest: begun first, no worker waits for them alone in the end.
    futures = {executor.submit(compute, name, effort): name for name in reversed(names)}
    for done, _ in enumerate(as_completed(futures), start=1):
        progress(done)
    found = {name: future.result() for future, name in futures.items()}
    return {name: found[name] for name in names}
