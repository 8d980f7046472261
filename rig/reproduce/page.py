"""The page and its figures: one HTML file that opens anywhere and asks for nothing, and the same as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from importlib.metadata import version

from daq.errors import LogError, SimulationFailed
from rig.pages.content import BigNumber, BigNumbers, Sentence, page
from rig.reproduce import figure as paper
from rig.reproduce.figures import ibs_10, ibs_base, ibs_rigid, psc, psc_networks, ssc

SCHEMA = "rattle.reproduction/1"

FIGURES: dict[str, paper.PaperFigure] = {
    figure.name: figure
    for figure in (
        ibs_rigid.FIGURE_7,
        ibs_rigid.FIGURE_8,
        ibs_rigid.FIGURE_9,
        ibs_10.FIGURE,
        ibs_rigid.FIGURE_11,
        ibs_base.FIGURE_12,
        ibs_base.FIGURE_13,
        ibs_base.TABLE_3,
        ssc.FIGURE_16,
        ssc.FIGURE_17,
        psc.FIGURE,
        *psc_networks.FIGURES,
    )
}
"""Adding one means adding a line."""


def compute(name: str, effort: paper.Effort) -> paper.Outcome:
    """One figure; what it failed of is in the outcome."""
    try:
        return FIGURES[name].compute(effort)
    except (SimulationFailed, LogError) as error:
        return paper.Outcome([], [Sentence(f"Not computed: {error}", warning=True)], str(error))


def compute_all(
    names: Sequence[str], effort: paper.Effort, executor: Executor | None, progress: Callable[[int], None]
) -> dict[str, paper.Outcome]:
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


@dataclass(frozen=True, slots=True)
class Reproduced:
    """A figure with what came out of it."""

    figure: paper.PaperFigure
    outcome: paper.Outcome


def html(figures: Sequence[Reproduced], quick: bool) -> str:
    """Return the page."""
    count = paper.tally(statement for each in figures for statement in each.outcome.statements)
    within = f"within {100 * paper.AGREEMENT:.0f} %, or within the range it gives"
    numbers = BigNumbers(
        [
            BigNumber("Agree with the text", str(count[paper.Verdict.AGREES]), within),
            BigNumber("Differ", str(count[paper.Verdict.DIFFERS]), "by how much, and why where known: below"),
            BigNumber("Open", str(count[paper.Verdict.OPEN]), "the difference lies within our own scatter"),
        ]
    )
    short = "quick: short runs, wide scatter" if quick else ""
    return page(
        "The papers again",
        [f"rattle {version('rattle')}", f"seed {paper.SEED}", short],
        template="reproduce/page.html.j2",
        figures=figures,
        numbers=numbers,
        what_if=paper.WHAT_IF_RIG,
        seed=paper.SEED,
        quick=quick,
    )


def document(figures: Sequence[Reproduced], quick: bool) -> str:
    """Return the same as JSON; null where the text gives no number, and for the open end of a range."""
    record = {
        "schema": SCHEMA,
        "software": f"rattle {version('rattle')}",
        "quick": quick,
        "seed": paper.SEED,
        "agreement": paper.AGREEMENT,
        "figures": [
            {
                "name": each.figure.name,
                "title": each.figure.title,
                "place": each.figure.place,
                "statements": [
                    {
                        "subject": statement.subject,
                        "text": statement.claim.text,
                        "place": statement.claim.place or each.figure.place,
                        "text_value": statement.claim.value,
                        "agrees_from": statement.claim.low if math.isfinite(statement.claim.low) else None,
                        "agrees_to": statement.claim.high if math.isfinite(statement.claim.high) else None,
                        "ours": statement.ours,
                        "standard_deviation": statement.deviation,
                        "standard_error": statement.error,
                        "unit": statement.unit,
                        "deviation": statement.gap,
                        "verdict": statement.verdict.value,
                        "what_if": statement.what_if,
                        "remark": statement.remark,
                    }
                    for statement in each.outcome.statements
                ],
            }
            for each in figures
        ],
    }
    return json.dumps(record, indent=2, allow_nan=False, ensure_ascii=False)
