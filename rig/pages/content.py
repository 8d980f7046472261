"""What a page may consist of: plain data. Only the template makes HTML of it, and escapes all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Generic, TypeAlias, TypeVar
from urllib.parse import quote

import jinja2
from plotly.offline import get_plotlyjs

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Lead:
    """What to read if one reads nothing else; `warning` makes it stand out."""

    kind: ClassVar = "lead"
    sentences: Sequence[str]
    warning: bool = False


@dataclass(frozen=True, slots=True)
class Sentence:
    """A line of text; `warning` makes it stand out."""

    kind: ClassVar = "sentence"
    text: str
    warning: bool = False


@dataclass(frozen=True, slots=True)
class BigNumber:
    """A number to be read from across the room: what it is, its text with unit, and a remark."""

    label: str
    text: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class BigNumbers:
    """Big numbers in a row."""

    kind: ClassVar = "numbers"
    numbers: Sequence[BigNumber]


@dataclass(frozen=True, slots=True)
class Link:
    """A cell that leads to a file, `path` from where the page lies."""

    text: str
    path: str

    @property
    def href(self) -> str:
        return quote(self.path)


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under headings; the first column names its row, `caption` says what it is of.

    Columns of numbers stand flush right, those of a table of `words` flush left.
    """

    kind: ClassVar = "table"
    headings: Sequence[str]
    rows: Sequence[Sequence[str | Link]]
    caption: str = ""
    words: bool = False


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

    kind: ClassVar = "bars"
    headings: Sequence[str]
    rows: Sequence[Bar]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Figure:
    """Plots: Plotly's traces and layout, the height in pixels, and whose lines the page's own key explains.

    `name` is its own on the page.
    """

    kind: ClassVar = "figure"
    name: str
    traces: Sequence[dict[str, Any]]
    layout: dict[str, Any]
    height_px: int
    caption: str = ""
    key: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Listing:
    """Text as it stands in a file."""

    kind: ClassVar = "listing"
    text: str


Part: TypeAlias = Lead | Sentence | BigNumbers | Table | BarTable | Figure | Listing


@dataclass(frozen=True, slots=True)
class Section(Generic[T]):
    """A heading, and the function that makes a section's parts from what the page is of.

    A section without parts is left out.
    """

    heading: str
    parts: Callable[[T], list[Part]]


def page(
    title: str,
    subtitle: Sequence[str],
    sections: Sequence[tuple[str, Sequence[Part]]] = (),
    template: str = "pages/page.html.j2",
    **more: Any,
) -> str:
    """The page of sections, each a heading with its parts; those without any are left out.

    `template` is one below `rig` that extends this page's own and is given `more`.
    """
    return _TEMPLATES.get_template(template).render(
        title=title,
        subtitle=" · ".join(text for text in subtitle if text),
        sections=[(heading, parts) for heading, parts in sections if parts],
        plotly=get_plotlyjs(),
        **more,
    )


_TEMPLATES: Final = jinja2.Environment(
    loader=jinja2.PackageLoader("rig", "."),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
