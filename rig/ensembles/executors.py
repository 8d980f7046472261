"""The executor that a command asks for: worker processes here, or a Dask cluster by its address."""

from __future__ import annotations

import logging
import multiprocessing
import os
import re
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from daq.errors import RattleError
from daq.process import OF_THE_TERMINAL, deaf, end_with_parent
from rig.rigs import RIGS

_LIBRARIES = ("OMP", "OPENBLAS", "MKL", "NUMBA")
_ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in _LIBRARIES}
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
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), end_with_parent)
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


def _ready() -> bool:
    """The first task of a worker, which loads what all others take; not what other packages added."""
    return all(kind.nominal().model is not None for kind in RIGS.own.values())


@contextmanager
def _start_conditions() -> Iterator[None]:
    """What processes that start now inherit: one thread each; what the terminal sends is not for them."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)
    try:
        with deaf(OF_THE_TERMINAL):
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
    _hush("distributed")
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


def _hush(package: str) -> None:
    """What goes wrong between us and the cluster is told in one line, not in its log."""
    for name in logging.root.manager.loggerDict:
        if name.partition(".")[0] == package:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
