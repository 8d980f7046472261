"""The page: one HTML file that opens anywhere and asks for nothing, and the same as JSON."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import jinja2
from plotly.offline import get_plotlyjs

from rig.reproduce import verdicts
from rig.reproduce.claim import AGREEMENT, Claim
from rig.reproduce.explanations import WHAT_IF_RIG
from rig.reproduce.figure import SEED, Figure, Outcome
from rig.reproduce.statement import Statement, Verdict

SCHEMA = "rattle.reproduction/1"


@dataclass(frozen=True, slots=True)
class Reproduced:
    """A figure with what came out of it."""

    figure: Figure
    outcome: Outcome


def html(figures: Sequence[Reproduced], quick: bool) -> str:
    """Return the page."""
    statements = [statement for each in figures for statement in each.outcome.statements]
    return _template().render(
        figures=figures,
        tally=verdicts.tally(statements),
        verdicts=verdicts,
        Verdict=Verdict,
        what_if=WHAT_IF_RIG,
        agreement=f"{100 * AGREEMENT:.0f} %",
        seed=SEED,
        quick=quick,
        version=version("rattle"),
        plotly=get_plotlyjs(),
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
        **_numbers(claim),
        "ours": statement.ours,
        "standard_deviation": statement.deviation,
        "standard_error": statement.error,
        "unit": statement.unit,
        "deviation": statement.gap,
        "verdict": statement.verdict.value,
        "what_if": statement.what_if,
        "remark": statement.remark,
    }


def _numbers(claim: Claim) -> dict[str, float | None]:
    ends = {"agrees_from": claim.low, "agrees_to": claim.high}
    return {
        "text_value": claim.value,
        **{key: end if math.isfinite(end) else None for key, end in ends.items()},
    }


@functools.cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("rig", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("reproduce/page.html.j2")
