"""What a text says of a quantity, as the range in which a result agrees with it."""

from __future__ import annotations

import math
from dataclasses import dataclass

AGREEMENT = 0.10
"""A result agrees with a single value of the text within this share of it: the source says "about", rounds
to two digits, and gives 67 and 64.9 N for one and the same case, 3 % apart. Three times that is allowed."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A result between `low` and `high` agrees; `value` is the text's number, None where it gives none.

    `text` is what the text says, `place` where: section, figure or table of the source.
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


def about(value: float, text: str, place: str) -> Claim:
    """The text gives one number."""
    ends = sorted((value * (1 - AGREEMENT), value * (1 + AGREEMENT)))
    return Claim(text, place, ends[0], ends[1], value)


def between(low: float, high: float, text: str, place: str) -> Claim:
    """The text gives two ends."""
    return Claim(text, place, low, high)


def above(low: float, text: str, place: str) -> Claim:
    """The text says: more than this."""
    return Claim(text, place, low, math.inf)


def below(high: float, text: str, place: str) -> Claim:
    """The text says: less than this."""
    return Claim(text, place, -math.inf, high)
