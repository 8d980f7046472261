"""One line of the comparison: what the text says, what came out here, and whether the two agree."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from rig.reproduce.claim import Claim
from rig.reproduce.sample import Sample

_SIGNIFICANT = 2.0
"""Standard errors between a result and the end of a range, from which the two count as apart."""


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


def of_sample(
    subject: str, claim: Claim, sample: Sample, unit: str = "", remark: str = "", what_if: bool = False
) -> Statement:
    """The mean of a sample against a claim."""
    return Statement(subject, claim, sample.mean, unit, sample.deviation, sample.error, remark, what_if)


def of_ratio(subject: str, claim: Claim, ratio: tuple[float, float], remark: str = "") -> Statement:
    """A ratio and its standard error against a claim."""
    return Statement(subject, claim, ratio[0], error=ratio[1], remark=remark)
