"""What simulates many rigs: worker processes here or a Dask cluster by its address; and what they came to."""

from __future__ import annotations

import csv
import logging
import multiprocessing
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

from rich.table import Table
from threadpoolctl import threadpool_limits

from daq.errors import RattleError
from daq.process import OF_THE_TERMINAL, begin_as_child, deaf, imports_nothing_here
from rig.rigs import RIGS
from sim_twin.diagnosis.library import FEWEST
from sim_twin.diagnosis.subject import Draw, Observed, Subject
from sim_twin.ensembles.figures import Spread, failures, spread_of
from sim_twin.ensembles.simulate import Outcome
from sim_twin.rigs.rig_model import RunFigures

_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
"""A worker a core is all there is: threads of linear algebra would only fight, and could change last bits."""
_ADDRESS = re.compile(r"(tcp|tls|ws|wss|ucx)://.+:[0-9]+")
_ANSWER_S = 10.0


class WorkersAbsent(RattleError, ConnectionError):
    """The workers that were asked for are not there, or no longer."""


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor and how many pieces of work it does at once."""

    executor: Executor
    count: int


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def worker_processes(count: int) -> Iterator[Workers]:
    """`count` processes of this machine; none is left behind, however the context ends.

    Raises WorkersAbsent if one of them dies.
    """
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), begin_as_child)
    earlier = set(multiprocessing.active_children())
    try:
        with _start_conditions():
            answers = [pool.submit(_ready) for _ in range(count)]
        for answer in answers:
            answer.result()
        yield Workers(pool, count)
    except BaseException as error:
        for process in set(multiprocessing.active_children()) - earlier:
            process.terminate()
        if isinstance(error, BrokenProcessPool):
            raise WorkersAbsent("a worker process died: out of memory?") from error
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def workers_when_needed(count: int) -> Iterator[Executor]:
    """An executor whose `worker_processes` start with the first piece of work: there may be none."""
    with ExitStack() as stack:
        yield _WhenNeeded(stack, count)


class _WhenNeeded(Executor):
    def __init__(self, stack: ExitStack, count: int) -> None:
        self._stack, self._count = stack, count
        self._workers: Workers | None = None

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if self._workers is None:
            self._workers = self._stack.enter_context(worker_processes(self._count))
        return self._workers.executor.submit(fn, *args, **kwargs)


def _ready() -> bool:
    """The first task of a worker, which loads what all others take; not what other packages added."""
    return all(RIGS[name].nominal().model is not None for name in RIGS.own)


@contextmanager
def _start_conditions() -> Iterator[None]:
    """What processes that start now inherit: one thread each, nothing of terminal or working folder."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        with imports_nothing_here(), deaf(OF_THE_TERMINAL):
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """The workers of the Dask scheduler at `address` (tcp://HOST:PORT), which need rattle installed.

    Where their processors are of this machine's kind they give the same bits. Raises WorkersAbsent without
    the package `distributed`, a scheduler there, or a worker that can do it.
    """
    client, count = _connect(address)
    executor = client.get_executor(pure=False)
    try:
        yield Workers(executor, count)
    except (CancelledError, import_module("distributed").KilledWorker) as error:
        raise WorkersAbsent(f"the cluster at {address} lost its scheduler or its workers") from error
    finally:
        executor.shutdown(wait=False)
        client.close()


def _connect(address: str) -> tuple[Any, int]:
    """A client, and how many threads work for it."""
    if not _ADDRESS.fullmatch(address):
        raise WorkersAbsent(f"{address} is no address of a scheduler, such as tcp://127.0.0.1:8786")
    try:
        distributed = import_module("distributed")
    except ModuleNotFoundError as error:
        raise WorkersAbsent("--scheduler needs one more package: pip install 'rattle[cluster]'") from error
    # what goes wrong between us and the cluster is told in one line, not in its log
    for name in logging.root.manager.loggerDict:
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = distributed.Client(address, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise WorkersAbsent(f"no Dask scheduler answers at {address}") from error
    try:
        client.wait_for_workers(1, timeout=_ANSWER_S)
        client.submit(_ready, pure=False).result()
        return client, sum(client.nthreads().values())
    except Exception as error:  # whatever a foreign process raised, it cannot work for us
        client.close()
        raise WorkersAbsent(f"no worker at {address} can simulate: {error}") from error


_TOGETHER = 8


class Simulated:
    """Has the workers of `executor` observe draws; after `deadline` (monotonic s) no more are begun.

    `report(n)` is told how many draws have come in all, those of some runs of `subject` by the share of its
    numbers that they are. `cut_short` says whether the deadline stopped any.
    """

    def __init__(
        self, subject: Subject, executor: Executor, deadline: float, report: Callable[[float], None]
    ) -> None:
        self._subject, self._executor = subject, executor
        self._deadline, self._report = deadline, report
        self.cut_short = False
        self._done = 0.0

    def __call__(self, draws: Sequence[Draw]) -> list[Observed]:
        """Observations of each draw in order; () for one that there was no time for."""
        return self.of(self._subject, draws)

    def known(self, count: float) -> None:
        """So many draws need not be observed."""
        self._done += count
        self._report(self._done)

    def of(self, subject: Subject, draws: Sequence[Draw]) -> list[Observed]:
        """The same of another subject, which may be some of the runs."""
        share = 1.0 if subject is self._subject else subject.layout.size / self._subject.layout.size
        # as many pieces for every core
        pieces = _dealt(draws, cores() * max(1, -(-len(draws) // (cores() * _TOGETHER))))
        futures = [self._executor.submit(observed, subject, [draws[k] for k in piece]) for piece in pieces]
        for future in futures:
            wait([future], timeout=max(0.0, self._deadline - time.monotonic()))
            if not future.done() and future.cancel():
                self.cut_short = True
            else:
                self._done += share * len(future.result())
                self._report(self._done)
        found: list[Observed] = [() for _ in draws]
        for piece, future in zip(pieces, futures, strict=True):
            if not future.cancelled():
                for k, each in zip(piece, future.result(), strict=True):
                    found[k] = each
        return found


def _dealt(draws: Sequence[Draw], count: int) -> list[list[int]]:
    """Which of the draws each of about `count` pieces has.

    Rigs with the same effects in, which are simulated side by side, come into one piece: of each kind first
    as many as tell anything of it, then the others, for there may not be time for all. Of those that are
    observed more than once each piece has as many as the others.
    """
    shared = [k for k, draw in enumerate(draws) if len(draw.sensing) > 1]
    others = list[tuple[bool, tuple[str, ...], int]]()
    seen = Counter[tuple[str, ...]]()
    for k, draw in enumerate(draws):
        if len(draw.sensing) <= 1:
            effects = tuple(name for name, _ in draw.effects)
            others.append((seen[effects] >= FEWEST, effects, k))
            seen[effects] += 1
    if len(seen) > 1:
        others.sort()
    cuts = [-(-len(others) * k // count) for k in range(count + 1)]
    parts = [[k for *_, k in others[a:b]] for a, b in pairwise(cuts)]
    pieces = [[*part, *shared[k::count]] for k, part in enumerate(parts)]
    return [piece for piece in pieces if piece]


def observed(subject: Subject, draws: Sequence[Draw]) -> list[Observed]:
    """One piece of work, at a worker."""
    threadpool_limits(1, user_api="blas")
    return subject.observe(draws)


Outcomes = Sequence[Outcome[RunFigures]]
_COLUMNS = ("runs", "mean", "sd", "5 %", "50 %", "95 %")


def spread_table(spreads: Mapping[str, Spread]) -> Table:
    """One row a figure; the end of its name is its unit."""
    table = Table(box=None, pad_edge=False)
    table.add_column("figure", no_wrap=True)
    for column in _COLUMNS:
        table.add_column(column, justify="right")
    for name, spread in spreads.items():
        numbers = (spread.mean, spread.deviation, spread.p5, spread.median, spread.p95)
        shown = ("-" if x is None else f"{x:{'.0f' if 1e3 <= abs(x) < 1e9 else '.4g'}}" for x in numbers)
        table.add_row(name, str(spread.runs), *shown)
    return table


def failure_lines(outcomes: Outcomes) -> list[str]:
    """One line for each way in which runs failed."""
    lines = (
        (count, status.name.lower().replace("_", " "), status.advice)
        for status, count in failures(outcomes).items()
    )
    return [f"{count} of {len(outcomes)} runs {name}: {advice}" for count, name, advice in lines]


def as_json(outcomes: Outcomes, seed: int) -> dict[str, Any]:
    """The same for a program."""
    return {
        "runs": len(outcomes),
        "seed": seed,
        "failed": {status.name.lower(): count for status, count in failures(outcomes).items()},
        "figures": {name: asdict(spread) for name, spread in spread_of(outcomes).items()},
    }


def write_runs(outcomes: Outcomes, path: Path, by: str = "") -> None:
    """One row a run, in order: its number, how it ended, its figures; what it does not have is empty.

    The last column says `by` whom where they were not simulated.
    """
    said = {"by": by} if by else {}
    names = list(dict.fromkeys(name for each in outcomes if each.value for name in each.value.values))
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["run", "status", *names, *said])
            for run, each in enumerate(outcomes):
                values = {} if each.value is None else each.value.values
                row = [run, each.status.name.lower(), *(values.get(name) for name in names), *said.values()]
                rows.writerow(row)
    except OSError as error:
        raise RattleError(f"{path}: cannot be written ({error.strerror})") from error
