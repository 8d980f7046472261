"""`rattle diagnose --subject` on a measured set, and the rig that the page shows."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.own_rigs import Verdict, sets, verdict_of
from tests.rig.commands.cli import caller

Answer = Callable[[str], Verdict]
TIMES = np.arange(0, 2, 1 / 50)
_PAGE = Path(__file__).parents[2] / "docs" / "own_rig.md"


def bouncing_ball() -> str:
    """The program that the page shows."""
    _, _, rest = _PAGE.read_text(encoding="utf-8").partition("```python\n")
    return rest.partition("```")[0]


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder of its own, whose modules no other test sees."""
    path, modules = list(sys.path), set(sys.modules)
    yield tmp_path
    sys.path[:] = path
    for name in sys.modules.keys() - modules:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture
def answer(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Answer:
    call = caller(monkeypatch, capfd)

    def given(name: str) -> Verdict:
        [(subject, file)] = [(subject, file) for each, subject, file in sets() if each == name]
        said = call("diagnose", "--subject", subject, file, "--out", tmp_path, "--seed", 1, "--seeds", 1)
        assert said.code == 0, said.err
        return verdict_of(json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8")))

    return given
