"""A figure or table of a source: where it stands and how it is computed anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from rig.report.content import Part
from rig.reproduce.statement import Statement

T = TypeVar("T")
SEED = 1992
"""Of every random number on the page: sensor noise. All motions begin at rest, or centred in their joints."""


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
class Figure:
    """`name` is that of the command line, `source` whose figure, `place` where in the source."""

    name: str
    title: str
    place: str
    compute: Callable[[Effort], Outcome]
