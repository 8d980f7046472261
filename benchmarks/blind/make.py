"""Records the campaigns, on two processes."""

from __future__ import annotations

import multiprocessing
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeVar

from benchmarks.blind.calibration import write_references
from benchmarks.blind.campaigns import Campaign, references_of
from benchmarks.blind.engines import engine_of
from benchmarks.blind.logs import run_names, write_campaign

WORKERS = 2
T = TypeVar("T")
R = TypeVar("R")


def make(folder: Path, campaigns: Sequence[Campaign], part: Sequence[Campaign]) -> None:
    """Record a part of the campaigns with what they are calibrated by; what is recorded already stays."""
    write_references(folder, campaigns)
    todo = [*references_of(campaigns, part), *part]
    with workers() as pool:
        for done, name in enumerate(each_done(pool, partial(_recorded, folder), todo), 1):
            print(f"recorded {name} ({done} of {len(todo)})", flush=True)


def is_recorded(folder: Path, campaigns: Sequence[Campaign], campaign: Campaign) -> bool:
    """Whether all logs of a campaign are there, and of what it is calibrated by."""
    return all(
        (folder / "logs" / each.name / name).exists()
        for each in (campaign, *references_of(campaigns, [campaign]))
        for name in run_names(each)
    )


def discard_logs(folder: Path, campaign: Campaign) -> None:
    """Remove the logs of a campaign."""
    for name in run_names(campaign):
        (folder / "logs" / campaign.name / name).unlink(missing_ok=True)


@contextmanager
def workers() -> Iterator[ProcessPoolExecutor]:
    """Two processes of their own; what waits is dropped where the block is left by an error."""
    # Not forked: the twin's kernels and Exudyn both hold threads.
    pool = ProcessPoolExecutor(WORKERS, mp_context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def each_done(pool: Executor, work: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Results as they come; of work that fails what it raised is printed, and the others go on."""
    asked = {pool.submit(work, item): item for item in items}
    for future in as_completed(asked):
        try:
            found = future.result()
        except BrokenProcessPool:
            raise
        except Exception:  # one campaign of hundreds
            print(f"failed: {asked[future]}", file=sys.stderr)
            traceback.print_exc()
        else:
            yield found


def _recorded(folder: Path, campaign: Campaign) -> str:
    write_campaign(folder / "logs" / campaign.name, campaign, engine_of(campaign.rig))
    return campaign.name
