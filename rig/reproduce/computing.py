"""Computes figures, here or in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed

from daq.errors import SimulationFailed
from rig.report.content import Sentence
from rig.reproduce.catalogue import FIGURES
from rig.reproduce.figure import Effort, Outcome


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
