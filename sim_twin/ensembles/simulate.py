"""Runs an ensemble on any executor; the results do not depend on which, nor on its number of workers."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.random import SeedSequence
from threadpoolctl import threadpool_limits

from daq.errors import SimulationFailed
from sim_twin.status import Status
from sim_twin.twin import AnyTwin

T_co = TypeVar("T_co", covariant=True)
T = TypeVar("T")
Progress = Callable[[int, int], None]
_OF_THE_RUN = (SimulationFailed, np.linalg.LinAlgError, OverflowError, FloatingPointError)
"""What a run's own numbers may raise; anything else is a fault of the program."""


@dataclass(frozen=True, slots=True)
class Variant:
    """What is simulated and from where: parameters, effects and operating point are all in the `twin`.

    `phase` in rad is the drive's (of a crank: its angle) at t = 0; in a chaotic motion 1e-9 rad more is
    another start. `noise` seeds noise and quantisation of the samples; None: none.
    """

    twin: AnyTwin
    phase: float = 0.0
    noise: SeedSequence | None = None


@dataclass(frozen=True, slots=True)
class Outcome(Generic[T_co]):
    """How a run ended, and what was observed; None unless it completed."""

    status: Status
    value: T_co | None = None


def status_of(error: Exception) -> Status:
    """How a run ended that raised `error`; DIVERGED where the error does not say."""
    said = error.status if isinstance(error, SimulationFailed) else None
    return said if isinstance(said, Status) else Status.DIVERGED


class Observation(Protocol[T_co]):
    """What is wanted of every run; picklable where the executor has processes."""

    @property
    def together(self) -> int:
        """How many runs are simulated in one piece of work, at most."""

    def observe(self, variants: Sequence[Variant]) -> Sequence[Outcome[T_co]]:
        """Simulate some runs of one rig; the bits of a run do not depend on the others."""


def simulate(
    variants: Sequence[Variant],
    observation: Observation[T],
    executor: Executor | None = None,
    progress: Progress | None = None,
    in_flight: int = 64,
) -> tuple[Outcome[T], ...]:
    """Observe every run, in the order of `variants`; a failed one has a status and takes no other along.

    Pieces of work depend on the list alone; `executor` None does them in this thread, else at most
    `in_flight` of them are with it at a time. `progress(done, all)` counts runs, in this thread. Whatever is
    raised, here or in a worker, cancels the rest and is raised.
    """
    pieces: list[Sequence[Variant]] = []
    for _, group in groupby(variants, lambda each: (each.twin.model.name, each.twin.channels)):
        while piece := tuple(islice(group, observation.together)):
            pieces.append(piece)
    found: list[Sequence[Outcome[T]]] = [()] * len(pieces)
    done = 0
    one_thread = threadpool_limits(1, user_api="blas")  # the order of its sums changes last bits
    with one_thread, closing(_finished(pieces, observation, executor, in_flight)) as finished:
        for number, outcomes in finished:
            found[number] = outcomes
            done += len(outcomes)
            if progress is not None:
                progress(done, len(variants))
    return tuple(outcome for outcomes in found for outcome in outcomes)


def _finished(
    pieces: Sequence[Sequence[Variant]],
    observation: Observation[T],
    executor: Executor | None,
    in_flight: int,
) -> Generator[tuple[int, Sequence[Outcome[T]]], None, None]:
    """Number and outcomes of each piece, as they come."""
    if executor is None:
        yield from ((number, observed(observation, piece)) for number, piece in enumerate(pieces))
        return
    waiting = iter(enumerate(pieces))
    running: dict[Future[Sequence[Outcome[T]]], int] = {}
    try:
        while True:
            for number, piece in islice(waiting, in_flight - len(running)):
                running[executor.submit(_at_a_worker, observation, piece)] = number
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()


def _at_a_worker(observation: Observation[T], piece: Sequence[Variant]) -> Sequence[Outcome[T]]:
    # Left at one thread: another piece may be at work in this process when this one ends.
    threadpool_limits(1, user_api="blas")
    return observed(observation, piece)


def observed(observation: Observation[T], piece: Sequence[Variant]) -> Sequence[Outcome[T]]:
    """One piece of work. If it fails as a whole, its runs are done one by one and those that fail, marked."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return observation.observe(piece)
    except _OF_THE_RUN as error:
        if len(piece) == 1:
            return [Outcome(status_of(error))]
        return [outcome for variant in piece for outcome in observed(observation, (variant,))]
