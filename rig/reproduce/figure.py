"""A figure or table of a source: where it stands, how it is computed anew, and how its lines are drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rig.pages.content import Part
from rig.pages.plots import BLACK, BLUE, ORANGE, Style
from rig.reproduce.statement import Statement

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

    def of(self, full: T, quick: T) -> T:
        """Return the one or the other."""
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
