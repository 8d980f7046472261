"""The page: one HTML file that opens anywhere and asks for nothing, and the same as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from rig.pages.content import BigNumber, BigNumbers
from rig.pages.page import page
from rig.reproduce.explanations import WHAT_IF_RIG
from rig.reproduce.figure import SEED, Outcome, PaperFigure
from rig.reproduce.statement import AGREEMENT, Statement, Verdict, tally

SCHEMA = "rattle.reproduction/1"


@dataclass(frozen=True, slots=True)
class Reproduced:
    """A figure with what came out of it."""

    figure: PaperFigure
    outcome: Outcome


def html(figures: Sequence[Reproduced], quick: bool) -> str:
    """Return the page."""
    count = tally(statement for each in figures for statement in each.outcome.statements)
    within = f"within {100 * AGREEMENT:.0f} %, or within the range it gives"
    numbers = BigNumbers(
        [
            BigNumber("Agree with the text", str(count[Verdict.AGREES]), within),
            BigNumber("Differ", str(count[Verdict.DIFFERS]), "by how much, and why where known: below"),
            BigNumber("Open", str(count[Verdict.OPEN]), "the difference lies within our own scatter"),
        ]
    )
    short = "quick: short runs, wide scatter" if quick else ""
    return page(
        "The papers again",
        [f"rattle {version('rattle')}", f"seed {SEED}", short],
        template="reproduce/page.html.j2",
        figures=figures,
        numbers=numbers,
        what_if=WHAT_IF_RIG,
        seed=SEED,
        quick=quick,
    )


def document(figures: Sequence[Reproduced], quick: bool) -> str:
    """Return the same as JSON; null where the text gives no number, and for the open end of a range."""
    record = {
        "schema": SCHEMA,
        "software": f"rattle {version('rattle')}",
        "quick": quick,
        "seed": SEED,
        "agreement": AGREEMENT,
        "figures": [
            {
                "name": each.figure.name,
                "title": each.figure.title,
                "place": each.figure.place,
                "statements": [_record(statement) for statement in each.outcome.statements],
            }
            for each in figures
        ],
    }
    return json.dumps(record, indent=2, allow_nan=False, ensure_ascii=False)


def _record(statement: Statement) -> dict[str, Any]:
    claim = statement.claim
    return {
        "subject": statement.subject,
        "text": claim.text,
        "place": claim.place,
        "text_value": claim.value,
        "agrees_from": claim.low if math.isfinite(claim.low) else None,
        "agrees_to": claim.high if math.isfinite(claim.high) else None,
        "ours": statement.ours,
        "standard_deviation": statement.deviation,
        "standard_error": statement.error,
        "unit": statement.unit,
        "deviation": statement.gap,
        "verdict": statement.verdict.value,
        "what_if": statement.what_if,
        "remark": statement.remark,
    }
