"""A run of a rig from Python: callbacks get what comes, and hold nothing up."""

from __future__ import annotations

import datetime
import os
import queue
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from daq.block import SampleBlock
from daq.clock import SystemClock
from daq.log.reader import Origin
from daq.log.records import Event, Impact
from rig.app import connect
from rig.files.bench import embedded_bench, load_bench
from rig.files.out_folder import check_out
from rig.files.pairing import check_pair, free_bytes, too_late
from rig.files.scenario import load_scenario
from rig.library.log import Log
from rig.session.progress import Screen, Terminal
from rig.session.run import RunRequest, run_scenario
from rig.stream import Block, Record
from rig.twin.scenario_twin import check_twin

_WAITING: Final = 4096
"""Records that may wait for a callback: some seconds of a large rig."""
_PATIENCE_S = 5.0
"""With a callback, once the rig stands."""


@dataclass(frozen=True, slots=True)
class Callbacks:
    """Who is told of what; None: nobody."""

    on_block: Callable[[Origin, SampleBlock], object] | None = None
    on_event: Callable[[Event], object] | None = None
    on_impact: Callable[[Impact], object] | None = None

    def __call__(self, record: Record) -> None:
        if isinstance(record, Block) and self.on_block is not None:
            self.on_block(record.origin, record.samples)
        elif isinstance(record, Event) and self.on_event is not None:
            self.on_event(record)
        elif isinstance(record, Impact) and self.on_impact is not None:
            self.on_impact(record)


def ran(
    scenario_file: str | PathLike[str],
    bench_file: str | PathLike[str] | None,
    out: str | PathLike[str],
    settings: Mapping[str, object] | None,
    callbacks: Callbacks,
    until: Callable[[], bool],
    quiet: bool,
) -> Log:
    """See `rattle.run`."""
    os.environ.setdefault("GRPC_VERBOSITY", "ERROR")
    folder = Path(out)
    check_out(folder)
    scenario = load_scenario(Path(scenario_file), settings)
    bench = embedded_bench(scenario.rig) if bench_file is None else load_bench(Path(bench_file), scenario.rig)
    check_pair(scenario, bench, datetime.datetime.now(datetime.UTC).date(), free_bytes(folder))
    check_twin(scenario)
    screen = Screen(Terminal(quiet=quiet))
    for told in too_late(scenario, bench):
        screen.warn(told)
    with _told(callbacks) as consumer, unguarded_main():
        request = RunRequest(scenario, bench, connect, folder, consumers=(consumer,), enough=until)
        return Log(run_scenario(request, screen, SystemClock()))


@contextmanager
def _told(callbacks: Callbacks) -> Iterator[Callable[[Record], None]]:
    """What hands records to a thread that calls back, and never waits for it."""
    waiting: queue.Queue[Record | None] = queue.Queue(_WAITING)
    wrong: list[str] = []
    missed = 0

    def give(record: Record) -> None:
        nonlocal missed
        try:
            waiting.put_nowait(record)
        except queue.Full:
            missed += 1

    def call() -> None:
        while (record := waiting.get()) is not None:
            try:
                if not wrong:
                    callbacks(record)
            except Exception as error:  # whatever somebody's callback does, the run goes on
                wrong.append(f"a callback raised {type(error).__name__}: {error}; it was not called again")

    thread = threading.Thread(target=call, name="callbacks", daemon=True)
    thread.start()
    try:
        yield give
    finally:
        with suppress(queue.Full):
            waiting.put(None, timeout=_PATIENCE_S)
        thread.join(_PATIENCE_S)
        if thread.is_alive():
            wrong.append("a callback does not return")
        if missed:
            wrong.append(f"callbacks were too slow: {missed} records passed them by")
        for each in wrong:
            warnings.warn(each, RuntimeWarning, stacklevel=5)


@contextmanager
def unguarded_main() -> Iterator[None]:
    """Processes that start meanwhile do not import the script that calls: it needs no guard on its name."""
    main: Any = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
