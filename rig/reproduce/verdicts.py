"""Statements as people read them: the row of a table, and the words of a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rig.report.sections.numbers import DASH, number
from rig.reproduce.statement import Statement, Verdict

_DIGITS = 2
"""Of a spread; the value has as many decimals."""
_COARSE = 20.0
"""Percent from which a deviation is shown without decimals."""
_FAINT = 1e-4
"""Share of the value below which a spread is not shown."""


def ours(statement: Statement) -> str:
    """The result with its unit, and the standard deviation of what it is the mean of, else its error."""
    spread = statement.deviation or statement.error
    if not spread or spread < _FAINT * abs(statement.ours):
        return number(float(f"{statement.ours:.3g}"), statement.unit)
    decimals = max(0, _DIGITS - 1 - math.floor(math.log10(spread)))
    return f"{statement.ours:.{decimals}f} ± {spread:.{decimals}f} {statement.unit}".rstrip()


def deviation(statement: Statement) -> str:
    """How far ours is from the text, in percent; a dash where the text has no number that it misses."""
    if statement.gap is None:
        return DASH
    percent = 100 * statement.gap
    text = f"{percent:+.0f}" if abs(percent) >= _COARSE else f"{percent:+.1f}"
    return f"{text}\u00a0%".replace("-", "−")


def words(statement: Statement) -> str:
    """The verdict in words."""
    if statement.verdict is Verdict.OPEN:
        return "open: within our scatter"
    if statement.verdict is Verdict.DIFFERS:
        return f"differs by {deviation(statement)}"
    return str(statement.verdict.value)


def tally(statements: Iterable[Statement]) -> dict[Verdict, int]:
    """How many statements came out in each way; what ifs do not count."""
    counted = [statement.verdict for statement in statements if not statement.what_if]
    return {verdict: counted.count(verdict) for verdict in Verdict}
