"""Makes a page of its parts: one HTML file that opens anywhere and asks for nothing."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import jinja2
from plotly.offline import get_plotlyjs

from rig.pages.content import Part


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
    return (
        _templates()
        .get_template(template)
        .render(
            title=title,
            subtitle=" · ".join(text for text in subtitle if text),
            sections=[(heading, parts) for heading, parts in sections if parts],
            plotly=get_plotlyjs(),
            **more,
        )
    )


@functools.cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("rig", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
