"""Simulates a diagnosis's draws in worker processes, with progress and a deadline."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, wait

from threadpoolctl import threadpool_limits

from sim_twin.diagnosis.draw import Draw, Observed
from sim_twin.diagnosis.subject import Subject

_TOGETHER = 8
Report = Callable[[float], None]


class Simulated:
    """Has the workers of `executor` observe draws; after `deadline` (monotonic s) no more are begun.

    `report(n)` is told how many draws have come in all. `cut_short` says whether the deadline stopped any.
    """

    def __init__(self, subject: Subject, executor: Executor, deadline: float, report: Report) -> None:
        self._subject, self._executor = subject, executor
        self._deadline, self._report = deadline, report
        self.cut_short = False
        self._done = 0

    def __call__(self, draws: Sequence[Draw]) -> list[Observed]:
        """Observations of each draw in order; () for one that there was no time for."""
        pieces = [draws[first : first + _TOGETHER] for first in range(0, len(draws), _TOGETHER)]
        futures = [self._executor.submit(observed, self._subject, piece) for piece in pieces]
        for future in futures:
            self._await(future)
        found: list[Observed] = []
        for piece, future in zip(pieces, futures, strict=True):
            found += [() for _ in piece] if future.cancelled() else future.result()
        return found

    def _await(self, future: Future[list[Observed]]) -> None:
        wait([future], timeout=max(0.0, self._deadline - time.monotonic()))
        if not future.done() and future.cancel():
            self.cut_short = True
            return
        self._done += len(future.result())
        self._report(self._done)


def observed(subject: Subject, draws: Sequence[Draw]) -> list[Observed]:
    """One piece of work, at a worker."""
    threadpool_limits(1, user_api="blas")
    return subject.observe(draws)
