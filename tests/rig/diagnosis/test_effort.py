"""How much is simulated: as many times more as `--effort` asks for, and nothing that is kept already."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from contextlib import nullcontext
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daq.errors import RattleError
from rig.commands.cli import FAILED
from rig.diagnosis import diagnose_runs as diagnosing
from rig.diagnosis.kept import KEEP
from rig.session.progress import Screen, Terminal
from sim_twin.diagnosis.diagnose import Effort
from tests.rig.commands.cli import Call, caller
from tests.rig.diagnosis.measured_log import BEAM, recording, write
from tests.rig.diagnosis.test_workers import Here

RIGS = 10


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("effort") / "run.mcap", recording(BEAM), BEAM)


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Call:
    return caller(monkeypatch, capfd)


class Planned:
    """Stands for the diagnosis: keeps the effort that it is asked for and ends there."""

    def __init__(self) -> None:
        self.asked: list[Effort] = []

    def __call__(self, _subject: Any, _measured: Any, effort: Effort, *_: Any) -> None:
        self.asked.append(effort)
        raise RattleError("far enough")


def test_twice_the_effort_asks_for_twice_the_motions(
    call: Call, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = Planned()
    monkeypatch.setattr(diagnosing, "diagnose", planned)
    asked = ((60, ()), (60, ("--effort", 1)), (60, ("--effort", 2)), (120, ()), (60, ("--effort", 0.5)))
    # 60 s ask for three times the fewest motions that there are, and an eighth of the most
    for budget_s, more in asked:
        answer = call("diagnose", run, "--out", tmp_path / "out", "--budget", budget_s, *more)
        assert answer.code == FAILED
        assert "far enough" in answer.err
    usual, once, twice, longer, half = planned.asked
    assert usual == once
    assert twice == longer
    # whole motions
    assert twice.motions == pytest.approx(2 * usual.motions, abs=2)
    assert half.motions == pytest.approx(0.5 * usual.motions, abs=1)
    assert not (tmp_path / "out").exists()


class Nobody(Executor):
    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        raise AssertionError("simulated once more")


def test_the_same_gap_again_simulates_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv(KEEP)
    monkeypatch.setattr(diagnosing, "_HEALTHY", RIGS)
    monkeypatch.setattr(diagnosing, "healthy_band", lambda *_: SimpleNamespace(gap_up_to=1.3))
    screen = Screen(Terminal(file=StringIO()))
    found = []
    for workers in (Here(), Nobody()):
        monkeypatch.setattr(diagnosing, "workers_when_needed", lambda _, these=workers: nullcontext(these))
        found.append(diagnosing.measured_gap([run], None, None, 0, screen))
    assert found[0] == found[1]
    monkeypatch.setenv(KEEP, "0")
    with pytest.raises(AssertionError, match="simulated once more"):
        diagnosing.measured_gap([run], None, None, 0, screen)
