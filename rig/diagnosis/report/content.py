"""What a section may consist of, beside what a run's report may."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rig.diagnosis.report.reported import Reported
from rig.report.content import BigNumbers, Figure, Listing, Sentence, Table


@dataclass(frozen=True, slots=True)
class Lead:
    """What to read if one reads nothing else."""

    sentences: Sequence[str]
    kind: str = "lead"


@dataclass(frozen=True, slots=True)
class Bar:
    """A row: its label, a share of 1 as a bar with its text, and further columns; `apart` from the others."""

    label: str
    share: float
    text: str
    more: Sequence[str] = ()
    apart: bool = False


@dataclass(frozen=True, slots=True)
class BarTable:
    """Rows with a bar each; `headings` of the label, the bar and the further columns."""

    headings: Sequence[str]
    rows: Sequence[Bar]
    caption: str = ""
    kind: str = "bars"


Part: TypeAlias = Lead | Sentence | BigNumbers | Table | BarTable | Figure | Listing


@dataclass(frozen=True, slots=True)
class Section:
    """One section: its heading and the function that makes its parts."""

    heading: str
    parts: Callable[[Reported], list[Part]]
