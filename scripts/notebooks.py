"""For the documentation site: each notebook of docs/ as a page, its text and code; run it to see the rest."""

from __future__ import annotations

import json
from typing import Any

from mkdocs.structure.files import File, Files


def on_files(files: Files, config: Any) -> None:
    """Put a page in the place of every notebook."""
    for file in [each for each in files if each.src_uri.endswith(".ipynb")]:
        files.remove(file)
        told = map(_as_markdown, json.loads(file.content_string)["cells"])
        files.append(File.generated(config, file.src_uri.replace(".ipynb", ".md"), content="\n".join(told)))


def _as_markdown(cell: Any) -> str:
    text = "".join(cell["source"])
    return f"{text}\n" if cell["cell_type"] == "markdown" else f"```python\n{text}\n```\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links to notebooks go to their pages."""
    return markdown.replace(".ipynb)", ".md)")
