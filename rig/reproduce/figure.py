"""A figure of a source: what its text says, what came out here, and whether the two agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.pages.content import Part
from rig.pages.plots import BLACK, BLUE, ORANGE, Style
from rig.pages.words import DASH, change, number

AGREEMENT = 0.10
"""A result agrees with a single value of the text within this share of it: the source says "about", rounds
to two digits, and gives 67 and 64.9 N for one and the same case, 3 % apart. Three times that is allowed."""

_SIGNIFICANT = 2.0
"""Standard errors between a result and the end of a range, from which the two count as apart."""

_DIGITS = 2
"""Of a spread; the value has as many decimals."""
_COARSE = 0.20
"""Share from which a deviation is shown without decimals."""
_FAINT = 1e-4
"""Share of the value below which a spread is not shown."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A result between `low` and `high` agrees; `value` is the text's number, None where it gives none.

    `text` is what the text says, `place` where: section, figure or table of the source; empty: where the
    figure is.
    """

    text: str
    place: str
    low: float
    high: float
    value: float | None = None

    def deviation(self, ours: float) -> float | None:
        """Share by which `ours` misses the text's value, or the nearer end of its range; None without any."""
        if self.value is None and self.low <= ours <= self.high:
            return None
        said = self.value if self.value is not None else (self.low if ours < self.low else self.high)
        return None if said == 0 else (ours - said) / said


def about(value: float, text: str, place: str = "") -> Claim:
    """The text gives one number."""
    ends = sorted((value * (1 - AGREEMENT), value * (1 + AGREEMENT)))
    return Claim(text, place, ends[0], ends[1], value)


def between(low: float, high: float, text: str, place: str = "") -> Claim:
    """The text gives two ends."""
    return Claim(text, place, low, high)


def above(low: float, text: str, place: str = "") -> Claim:
    """The text says: more than this."""
    return Claim(text, place, low, math.inf)


def below(high: float, text: str, place: str = "") -> Claim:
    """The text says: less than this."""
    return Claim(text, place, -math.inf, high)


@dataclass(frozen=True, slots=True)
class Sample:
    """`values` of shape (n,)."""

    values: NDArray[np.float64]

    @property
    def mean(self) -> float:
        return float(np.mean(self.values))

    @property
    def deviation(self) -> float:
        return float(np.std(self.values, ddof=1))

    @property
    def error(self) -> float:
        """Standard error of their mean, as if they were independent."""
        return self.deviation / float(np.sqrt(len(self.values)))


class Ratio(NamedTuple):
    """A value that is the mean of nothing that scatters, and its standard error."""

    mean: float
    error: float
    deviation: None = None


def ratio(over: Sample, under: Sample) -> Ratio:
    """Ratio of two means, and its standard error (first order)."""
    value = over.mean / under.mean
    return Ratio(value, abs(value) * float(np.hypot(over.error / over.mean, under.error / under.mean)))


class Verdict(Enum):
    """How a result stands to its claim."""

    AGREES = "agrees"
    OPEN = "open"
    DIFFERS = "differs"


@dataclass(frozen=True, slots=True)
class Statement:
    """`ours` in `unit`, standard `deviation` of what it is the mean of, standard `error` of itself.

    `remark` says what was measured, or why it differs. A `what_if` was computed with other values than
    the rig's and does not count.
    """

    subject: str
    claim: Claim
    ours: float
    unit: str = ""
    deviation: float | None = None
    error: float | None = None
    remark: str = ""
    what_if: bool = False

    @property
    def verdict(self) -> Verdict:
        """A range without a number of its own stays open where its end lies within two standard errors."""
        margin = _SIGNIFICANT * (self.error or 0.0)
        nearest = min(abs(self.ours - end) for end in (self.claim.low, self.claim.high))
        if self.claim.value is None and nearest < margin:
            return Verdict.OPEN
        agrees = self.claim.low <= self.ours <= self.claim.high
        return Verdict.AGREES if agrees else Verdict.DIFFERS

    @property
    def gap(self) -> float | None:
        """Share by which ours misses the text, None where there is no number to miss."""
        return self.claim.deviation(self.ours)

    @property
    def ours_words(self) -> str:
        """The result with its unit, and the standard deviation of what it is the mean of, else its error."""
        spread = self.deviation or self.error
        if not spread or spread < _FAINT * abs(self.ours):
            return number(float(f"{self.ours:.3g}"), self.unit)
        decimals = max(0, _DIGITS - 1 - math.floor(math.log10(spread)))
        return f"{self.ours:.{decimals}f} ± {spread:.{decimals}f} {self.unit}".rstrip()

    @property
    def gap_words(self) -> str:
        """How far ours is from the text, in percent; a dash where the text has no number that it misses."""
        if self.gap is None:
            return DASH
        return change(self.gap, 0 if abs(self.gap) >= _COARSE else 1).replace(" ", "\u00a0")

    @property
    def verdict_words(self) -> str:
        if self.verdict is Verdict.OPEN:
            return "open: within our scatter"
        if self.verdict is Verdict.DIFFERS:
            return f"differs by {self.gap_words}"
        return str(self.verdict.value)


def against(
    subject: str, claim: Claim, ours: Sample | Ratio, unit: str = "", remark: str = "", what_if: bool = False
) -> Statement:
    """The mean of a sample, or a ratio, against a claim."""
    return Statement(subject, claim, ours.mean, unit, ours.deviation, ours.error, remark, what_if)


def so_what_if(claim: Claim, ours: Sample | Ratio, unit: str = "") -> Statement:
    """The same of the rig as the source may have had it."""
    return against("the same, what if", claim, ours, unit, WHAT_IF, what_if=True)


def tally(statements: Iterable[Statement]) -> dict[Verdict, int]:
    """How many statements came out in each way; what ifs do not count."""
    counted = [statement.verdict for statement in statements if not statement.what_if]
    return {verdict: counted.count(verdict) for verdict in Verdict}


T = TypeVar("T")
SEED = 1992
"""Of every random number on the page: sensor noise. All motions begin at rest, or centred in their joints."""

OURS_LINE = Style(ORANGE, 1.2)
OURS = Style(ORANGE, mode="lines+markers")
SECOND = Style(BLUE, mode="lines+markers", symbol="square")
SECOND_LINE = Style(BLUE)
THIRD = Style("#5a8f29", mode="lines+markers", symbol="triangle-up")
WHAT_IF_STYLE = Style("#7a5195", mode="lines+markers", dash="dash", symbol="cross-thin-open", size=8)
TEXT = Style(BLACK, mode="markers", symbol="diamond-open", size=13)
TEXT_LINE = Style(BLACK, 1.4, dash="dot")


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is computed: all that the page promises, or a short version to see that everything works."""

    quick: bool = False
    recordings: Path | None = None
    """Where those lie that some figures are of."""

    def of(self, full: T, quick: T) -> T:
        return quick if self.quick else full


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came out: statements, plots with what they need said, and why there is nothing if a run failed."""

    statements: Sequence[Statement]
    parts: Sequence[Part]
    failure: str = ""


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """`name` is that of the command line, `source` whose figure, `place` where in the source."""

    name: str
    title: str
    place: str
    compute: Callable[[Effort], Outcome]
    recorded: bool = False
    """Whether it is of recordings, which are made before."""


LEVEL = (
    "Known: with a converged beam (15 modes) on a rigid base the peaks rise as clearance^0.7, the text's as "
    "clearance^0.5: ours lie below it at small clearances and meet it near 0.5 mm. A beam cut to few modes "
    "raises the level, a real shaker flattens the slope: see 'what if'."
)
WHAT_IF = "Explained in the summary: plausible, not an identification."
WHAT_IF_RIG = (
    "the beam cut to 4 modes with 2 % damping; a shaker of 20 g on 3 kN/m with 20 N s/m of back-emf damping, "
    "driven with 8.9 N (2 lbf). A plausible explanation of level and slope, not an identification: four "
    "values chosen for three numbers of the text (34, 49.4 and 64.9 N)"
)
