"""Observations and executors that show what `simulate` asks of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.ensembles.simulate import Outcome, Variant
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.status import Status
from sim_twin.twin import Twin

BEAM = Twin(nominal(), SineDrive(9.0, 20.0), nominal_sensors(nominal()))


class Beyond(SineDrive):
    """Drives without bounds, which no parameters within their ranges do."""

    def phasors(self) -> NDArray[np.complex128]:
        return 1e200 * super().phasors()


def numbered(count: int) -> list[Variant]:
    """Variants of one twin, told apart by their phase."""
    return [Variant(BEAM, float(number)) for number in range(count)]


def never(variant: Variant) -> Exception | None:
    return None


@dataclass
class Phases:
    """Observes the phase of every run; `fails` says what it raises for a run."""

    together: int = 4
    fails: Callable[[Variant], Exception | None] = never
    pieces: list[int] = field(default_factory=list)

    def observe(self, variants: Sequence[Variant]) -> list[Outcome[float]]:
        self.pieces.append(len(variants))
        for variant in variants:
            error = self.fails(variant)
            if error is not None:
                raise error
        return [Outcome(Status.COMPLETED, variant.phase) for variant in variants]


class LastFirst(Executor):
    """Collects `batch` pieces of work, then does the last one first; refuses to hold more."""

    def __init__(self, batch: int) -> None:
        self.batch = batch
        self.submitted: list[Future[Any]] = []
        self._waiting: list[tuple[Future[Any], Callable[[], Any]]] = []

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.submitted.append(future)
        self._waiting.append((future, lambda: function(*arguments, **named)))
        assert len([each for each in self.submitted if not each.done()]) <= self.batch
        if len(self._waiting) == self.batch:
            while self._waiting:
                _do(*self._waiting.pop())
        return future


class OnlyTheFirst(Executor):
    """Does the first piece of work and leaves all others waiting."""

    def __init__(self) -> None:
        self.submitted: list[Future[Any]] = []

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **named: Any) -> Future[Any]:
        self.submitted.append(Future())
        if len(self.submitted) == 1:
            _do(self.submitted[0], lambda: function(*arguments, **named))
        return self.submitted[-1]


def _do(future: Future[Any], work: Callable[[], Any]) -> None:
    try:
        future.set_result(work())
    except Exception as error:
        future.set_exception(error)
