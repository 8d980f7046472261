"""What a section may consist of. Sections hold data; only the template makes HTML of it, and escapes all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rig.report.record import RunRecord


@dataclass(frozen=True, slots=True)
class Sentence:
    """A line of text; `warning` makes it stand out."""

    text: str
    warning: bool = False
    kind: str = "sentence"


@dataclass(frozen=True, slots=True)
class BigNumber:
    """A number to be read from across the room: what it is, its text with unit, and a remark."""

    label: str
    text: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class BigNumbers:
    """Big numbers in a row."""

    numbers: Sequence[BigNumber]
    kind: str = "numbers"


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under headings; the first column names its row, `caption` says what it is of.

    Columns of numbers stand flush right, those of a table of `words` flush left.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: bool = False
    kind: str = "table"


@dataclass(frozen=True, slots=True)
class Figure:
    """A plot: Plotly's traces and layout, its height in pixels, and whose lines its key explains."""

    name: str
    traces: Sequence[dict[str, Any]]
    layout: dict[str, Any]
    height_px: int
    caption: str = ""
    key: Sequence[str] = ()
    kind: str = "figure"


@dataclass(frozen=True, slots=True)
class Listing:
    """Text as it stands in a file."""

    text: str
    kind: str = "listing"


Part = Sentence | BigNumbers | Table | Figure | Listing


@dataclass(frozen=True, slots=True)
class Section:
    """One section: its heading and the function that makes its parts from a run.

    Where those are none, it has nothing to say of the run's rig and is left out.
    """

    heading: str
    parts: Callable[[RunRecord], list[Part]]
