"""What was simulated of somebody's own rig is kept as that of ours is, whatever the rig is like."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from rig.diagnosis.kept import KEEP, kept_rig
from rig.ensembles import Simulated
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Cell, Layout
from sim_twin.diagnosis.subject import Draw, Observed, Subject
from tests.rig.diagnosis.test_kept import same
from tests.rig.diagnosis.test_workers import LATER, Here

DRAWS = [Draw((), 3), Draw((), 4, ((), ()), blocks=2)]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv(KEEP)


@dataclass(frozen=True)
class Whole:
    """A rig without runs: three numbers about a middle, as exact as Python's."""

    middle: float = 1.0
    causes: tuple[Cause, ...] = ()

    @property
    def layout(self) -> Layout:
        return Layout((Cell(0, "way", "course", 3),))

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        return [tuple(self._one(draw) for _ in draw.sensing) for draw in draws]

    def _one(self, draw: Draw) -> np.ndarray:
        return self.middle + np.random.default_rng(draw.seed).standard_normal((draw.blocks, 3))


@dataclass(frozen=True)
class InRuns(Whole):
    """A rig that is simulated run by run: what each shows hangs on its own input alone."""

    inputs: tuple[float, ...] = (1.0,)

    @property
    def layout(self) -> Layout:
        return Layout(tuple(Cell(run, "way", "course", 2) for run in range(len(self.inputs))))

    def only(self, numbers: tuple[int, ...]) -> InRuns:
        return replace(self, inputs=tuple(self.inputs[k] for k in numbers))

    def _one(self, draw: Draw) -> np.ndarray:
        rng = np.random.default_rng(draw.seed)
        noise = rng.standard_normal((draw.blocks, 1))
        return np.repeat(np.float32(noise + np.array(self.inputs)), 2, axis=1)


def looked(subject: Whole, version: str = "one") -> tuple[list[Observed], int, list[str]]:
    """What was seen, how many runs were simulated for it, and what was said."""
    told: list[str] = []
    simulated_runs = 0

    class Counted(Simulated):
        def of(self, subject: Subject, draws: Sequence[Draw]) -> list[Observed]:
            nonlocal simulated_runs
            simulated_runs += len(draws) * len(getattr(subject, "inputs", (0,)))
            return super().of(subject, draws)

    simulated = Counted(subject, Here(), time.monotonic() + LATER, lambda _: None)
    shown = kept_rig(subject, lambda: version, told.append).by(simulated)(DRAWS)
    return list(shown), simulated_runs, told


def test_a_second_look_simulates_nothing_and_shows_the_same_bits() -> None:
    first, count, told = looked(Whole())
    assert (count, told) == (2, [])
    again, count, told = looked(Whole())
    assert (count, told) == (0, [])
    assert same(first, again)
    assert not same(first, looked(Whole(middle=2.0))[0])


def test_of_another_program_nothing_is_used() -> None:
    looked(Whole())
    _, count, told = looked(Whole(), version="two")
    assert count == 2
    assert [("another version's" in each) for each in told] == [True]


def test_of_a_rig_with_runs_one_more_costs_that_alone() -> None:
    assert looked(InRuns())[1] == 2
    shown, count, told = looked(InRuns(inputs=(1.0, 5.0)))
    assert (count, told) == (2, [])
    assert same(shown, InRuns(inputs=(1.0, 5.0)).observe(DRAWS))


def test_nothing_is_looked_up_where_nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEEP, "0")

    def version() -> str:
        raise AssertionError("a rig is tried for it")

    assert not kept_rig(Whole(), version, lambda _: None).some
