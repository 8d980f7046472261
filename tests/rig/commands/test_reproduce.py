"""`rattle reproduce`: what it writes, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rig.reproduce.page import FIGURES
from tests.rig.commands.cli import Call


def figures(folder: Path) -> list[str]:
    record = json.loads((folder / "reproduce.json").read_text(encoding="utf-8"))
    return [figure["name"] for figure in record["figures"]]


def test_only_what_is_named_is_computed(call: Call, tmp_path: Path) -> None:
    answer = call("reproduce", "--quick", "--only", "ibs-11", "--out", tmp_path / "new")
    assert answer.code == 0, answer.err
    assert figures(tmp_path / "new") == ["ibs-11"]
    assert str(tmp_path / "new" / "reproduce.html") in answer.out
    text = (tmp_path / "new" / "reproduce.html").read_text(encoding="utf-8")
    assert 'id="ibs-11"' in text
    assert 'id="ibs-7"' not in text
    assert "Quick version" in text


@pytest.mark.parametrize("named", [("--only", "ibs-11", "--only", "ibs-7"), ("--only", "ibs-11,ibs-7")])
def test_several_come_in_the_pages_order(call: Call, tmp_path: Path, named: tuple[str, ...]) -> None:
    assert call("reproduce", "--quick", *named, "--out", tmp_path).code == 0
    assert figures(tmp_path) == ["ibs-7", "ibs-11"]


def test_an_unknown_figure_is_wrong_use(call: Call, tmp_path: Path) -> None:
    answer = call("reproduce", "--only", "ibs-99", "--out", tmp_path / "new")
    assert answer.code == 2
    assert "no figure ibs-99" in answer.err
    assert all(name in answer.err for name in FIGURES)
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be_made_fails_before_anything_is_computed(call: Call, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    answer = call("reproduce", "--quick", "--out", tmp_path / "file")
    assert answer.code == 1
    assert answer.err.startswith("rattle: cannot make ")
    assert "simulating" not in answer.out
