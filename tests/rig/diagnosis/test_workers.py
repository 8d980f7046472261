"""A diagnosis's draws at workers: in order, told as they come, none begun after the deadline."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from rig import ensembles
from rig.ensembles import Simulated, Workers, workers_when_needed
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Layout
from sim_twin.diagnosis.library import FEWEST
from sim_twin.diagnosis.subject import Draw, Observed

LATER = 3600.0


@dataclass
class Numbered:
    """Shows the seed of every draw; keeps how many it was asked for at once."""

    pieces: list[int] = field(default_factory=list)
    layout: Layout = field(default_factory=lambda: Layout(()))
    causes: tuple[Cause, ...] = ()

    def observe(self, draws: Sequence[Draw]) -> list[Observed]:
        self.pieces.append(len(draws))
        return [(np.full((1, 1), draw.seed, np.float32),) for draw in draws]


class Here(Executor):
    """Does the first `able` pieces of work at once and leaves all others waiting."""

    def __init__(self, able: int = 10**6) -> None:
        self.able = able
        self.submitted: list[Future[Any]] = []

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if len(self.submitted) < self.able:
            try:
                future.set_result(function(*arguments, **named))
            except ZeroDivisionError as error:
                future.set_exception(error)
        self.submitted.append(future)
        return future


def draws(count: int) -> list[Draw]:
    return [Draw((), seed) for seed in range(count)]


def shown(observed: Sequence[Observed]) -> list[int | None]:
    return [int(one[0][0, 0]) if one and one[0] is not None else None for one in observed]


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ensembles, "cores", lambda: 2)


def test_observations_come_in_the_order_of_their_draws() -> None:
    told: list[float] = []
    subject = Numbered()
    simulated = Simulated(subject, Here(), time.monotonic() + LATER, told.append)
    assert shown(simulated(draws(21))) == list(range(21))
    assert told == [6, 11, 16, 21]
    assert subject.pieces == [6, 5, 5, 5]  # as many for each core
    assert not simulated.cut_short


def test_progress_goes_on_over_several_rounds() -> None:
    told: list[float] = []
    simulated = Simulated(Numbered(), Here(), time.monotonic() + LATER, told.append)
    simulated(draws(8))
    simulated(draws(4))
    assert told == [4, 8, 10, 12]
    assert simulated([]) == []


def test_what_the_deadline_stopped_is_empty_and_said() -> None:
    executor = Here(able=1)
    simulated = Simulated(Numbered(), executor, time.monotonic(), lambda _: None)
    assert shown(simulated(draws(20))) == [seed if seed < 5 else None for seed in range(20)]
    assert simulated.cut_short
    assert all(future.cancelled() for future in executor.submitted[1:])


def test_what_was_done_before_the_deadline_is_kept_even_when_it_is_asked_for_later() -> None:
    simulated = Simulated(Numbered(), Here(), time.monotonic() - 10, lambda _: None)
    assert shown(simulated(draws(20))) == list(range(20))
    assert not simulated.cut_short


def test_an_error_at_a_worker_is_an_error_here() -> None:
    class Broken(Numbered):
        def observe(self, draws: Sequence[Draw]) -> list[Observed]:
            raise ZeroDivisionError("no rig at all")

    simulated = Simulated(Broken(), Here(), time.monotonic() + LATER, lambda _: None)
    with pytest.raises(ZeroDivisionError, match="no rig at all"):
        simulated(draws(3))


def test_workers_start_with_the_first_piece_of_work_and_end_with_the_context(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    happened: list[str] = []

    @contextmanager
    def workers(count: int) -> Iterator[Workers]:
        happened.append(f"{count} started")
        yield Workers(Here(), count)
        happened.append("ended")

    monkeypatch.setattr(ensembles, "worker_processes", workers)
    with workers_when_needed(2):
        pass
    assert happened == []
    with workers_when_needed(2) as executor:
        simulated = Simulated(Numbered(), executor, time.monotonic() + LATER, lambda _: None)
        assert shown(simulated(draws(3))) == [0, 1, 2]
        assert shown(simulated(draws(2))) == [0, 1]
        assert happened == ["2 started"]
    assert happened == ["2 started", "ended"]


def test_rigs_with_the_same_effects_in_come_together_and_what_is_observed_often_is_spread() -> None:
    kinds = [Draw(((name, {}),), seed) for seed, name in enumerate("abcd" * 6)]
    often = [Draw((), 100 + seed, sensing=((), ())) for seed in range(8)]
    asked: list[list[Draw]] = []

    class Kept(Numbered):
        def observe(self, draws: Sequence[Draw]) -> list[Observed]:
            asked.append(list(draws))
            return super().observe(draws)

    simulated = Simulated(Kept(), Here(), time.monotonic() + LATER, lambda _: None)
    assert shown(simulated([*kinds, *often])) == [draw.seed for draw in (*kinds, *often)]
    assert [len(piece) for piece in asked] == [8, 8, 8, 8]
    effects = [[draw.effects[0][0] for draw in piece if draw.effects] for piece in asked]
    assert effects == [["a"] * 6, ["b"] * 6, ["c"] * 6, ["d"] * 6]
    asked.clear()
    assert shown(simulated([*kinds[:3], *often[:1]])) == [0, 1, 2, 100]
    assert shown(simulated(often[:1])) == [100]


def test_of_each_kind_as_many_as_tell_anything_come_before_more_of_any() -> None:
    kinds = [Draw(((name, {}),), seed) for seed, name in enumerate("abcd" * 10)]
    simulated = Simulated(Numbered(), Here(able=4), time.monotonic(), lambda _: None)
    there = [draw.effects[0][0] for draw, one in zip(kinds, simulated(kinds), strict=True) if one]
    assert all(there.count(name) >= FEWEST for name in "abcd")
