"""The notebooks of docs/ run from top to bottom, and what a cell ends with can be shown."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
SHOW = """\
def _show(value):
    shown = getattr(value, "_repr_html_", None)
    assert value is None or repr(value) and (shown is None or shown())
    print(value)
"""


def script(notebook: Path) -> str:
    """All code of a notebook; a value at the end of a cell is shown as a notebook would."""
    parts = [SHOW]
    for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            body = ast.parse("".join(cell["source"])).body
            if isinstance(body[-1], ast.Expr):
                body[-1].value = ast.Call(ast.Name("_show", ast.Load()), [body[-1].value], [])
            parts.append("\n".join(ast.unparse(ast.fix_missing_locations(each)) for each in body))
    return "\n".join(parts)


def executed(notebook: Path, folder: Path, deadline_s: float) -> str:
    here = folder / "docs" / "notebooks"
    here.mkdir(parents=True)
    (folder / "scenarios").symlink_to(ROOT / "scenarios")
    (here / "notebook.py").write_text(script(notebook), encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "notebook.py"],
        cwd=here,
        capture_output=True,
        text=True,
        timeout=deadline_s,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_there_are_the_four_that_the_page_names() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    assert {path.name for path in NOTEBOOKS} == {
        "first_run.ipynb",
        "effect.ipynb",
        "diagnosis.ipynb",
        "sweep.ipynb",
    }
    for path in NOTEBOOKS:
        assert f"notebooks/{path.name}" in page
        compile(script(path), path.name, "exec")


def test_an_effect_on_a_prediction(tmp_path: Path) -> None:
    assert "% apart from" in executed(ROOT / "docs" / "notebooks" / "effect.ipynb", tmp_path, 100)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "words"),
    [("first_run", "record.end"), ("sweep", "three-frequencies"), ("diagnosis", "base_flexibility")],
)
def test_those_that_drive_a_rig(tmp_path: Path, name: str, words: str) -> None:
    assert words in executed(ROOT / "docs" / "notebooks" / f"{name}.ipynb", tmp_path, 280)
