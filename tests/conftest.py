"""A test that leaves a thread, a process, a socket or a file behind fails, and one whose log does not account
for what emulated instruments sent."""

from __future__ import annotations

import gc
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from daq.plugins import UNUSED
from drivers.emulator_truth import TRUTH_FOLDER

# What has been told to end may take this long to be gone: a killed child is reaped, a gRPC thread polls.
GRACE_S = 5.0
# Python keeps one process for the resources that spawned processes share, and its pipe, until it ends itself.
RESOURCE_TRACKER = "multiprocessing.resource_tracker"
_KEPT = ("pipe:", "/dev/", "/proc/", "anon_inode:")


_TESTS = Path(__file__).parent
_ALONE = (
    "drivers",
    "end_to_end",
    "rig/session/test_guard.py",
    "rig/session/test_hung_ends.py",
    "rig/session/test_hung_motor.py",
    "rig/session/test_supervisor.py",
    "rig/live/test_cranks_in_viewer.py",
    "rig/live/test_live_view.py",
    "rig/live/test_sender.py",
    "rig/ensembles",
    "rig/commands/test_ensemble.py",
    "rig/diagnosis/test_workers.py",
    "benchmarks_blind/test_three_campaigns.py",
    "own_rigs",
    "plugin",
)
"""They have deadlines, or take all cores by themselves."""


def pytest_configure() -> None:
    """Interrupted commands hear it, even if the tests are a shell's background job, which would not.

    No test but those of the verdict waits for healthy rigs to be simulated, and what one test took changes
    nothing that another sees.
    """
    os.environ["RATTLE_HEALTHY_RIGS"] = "0"
    os.environ["RATTLE_LIVE_PORT"] = "0"  # a page of each run's own, which ends with it
    os.environ["RATTLE_PACES"] = "0"
    os.environ["RATTLE_SIMULATED"] = "0"
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--part", choices=["alone", "others"], help="what is run by itself, or the others")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave the other part unread: merely to import all tests takes a quarter of a minute."""
    part = config.getoption("part")
    if part is None or not collection_path.match("test_*.py"):
        return None
    alone = any(collection_path.is_relative_to(_TESTS / place) for place in _ALONE)
    return True if alone != (part == "alone") else None


@pytest.fixture(autouse=True)
def _packages_of_one_test() -> Iterator[None]:
    yield
    UNUSED.clear()  # a process is one command, but that of the tests


class _Held:
    """What this process holds now: threads, child processes, sockets and regular files."""

    def __init__(self) -> None:
        self.threads = {thread for thread in threading.enumerate() if thread.is_alive()}
        self.processes = {child for child in psutil.Process().children(recursive=True) if _is_ours(child)}
        self.files = Counter(_open_files())

    def leaked_since(self, before: _Held) -> list[str]:
        threads = [f"thread {thread.name}" for thread in self.threads - before.threads]
        processes = [f"process {_name(child)}" for child in self.processes - before.processes]
        files = [f"{target} x {count}" for target, count in (self.files - before.files).items()]
        return sorted(threads + processes + files)


def _is_ours(child: psutil.Process) -> bool:
    with suppress(psutil.Error):
        return child.status() != psutil.STATUS_ZOMBIE and not any(
            RESOURCE_TRACKER in argument for argument in child.cmdline()
        )
    return False


def _name(child: psutil.Process) -> str:
    with suppress(psutil.Error):
        return f"{child.pid} {' '.join(child.cmdline())[:120]}"
    return f"{child.pid}, gone by now"


def _open_files() -> Iterator[str]:
    """Sockets as one kind, each file by its name; pipes, devices and event queues belong to libraries."""
    for entry in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            target = os.readlink(entry)
            if target.startswith("socket:"):
                yield "socket"
            elif not target.startswith(_KEPT):
                yield target.removesuffix(" (deleted)")


@pytest.fixture(autouse=True)
def leaves_nothing_behind() -> Iterator[None]:
    before = _Held()
    yield
    deadline = time.monotonic() + GRACE_S
    while leaked := _Held().leaked_since(before):
        if time.monotonic() > deadline:
            pytest.fail(f"left behind: {'; '.join(leaked)}")
        gc.collect()
        time.sleep(0.02)


@pytest.fixture(scope="session", autouse=True)
def truths(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where every emulated instrument, in whatever process, keeps what it sent."""
    folder = tmp_path_factory.mktemp("truth")
    os.environ[TRUTH_FOLDER] = str(folder)
    yield folder
    del os.environ[TRUTH_FOLDER]


_CHECKED: set[Path] = set()
_SINCE_S = 1.0
"""Before a test began: times of files are coarser than the clock."""


@pytest.fixture(scope="session")
def seen_until() -> list[float]:
    """When logs were last looked at (Unix s)."""
    return [time.time()]


@pytest.fixture(autouse=True)
def accounts_for_every_sample(
    truths: Path,
    seen_until: list[float],
    tmp_path_factory: pytest.TempPathFactory,
    leaves_nothing_behind: None,
) -> Iterator[None]:
    """No test that records from emulators can forget it."""
    yield
    since_s, seen_until[0] = seen_until[0] - _SINCE_S, time.time()
    if any(truths.iterdir()):
        from tests.accounting import discrepancies, sent_in

        every = {*tmp_path_factory.getbasetemp().rglob("*.mcap")} - _CHECKED
        logs = {log for log in every if log.stat().st_mtime > since_s}
        sent = sent_in(truths) if logs else []
        _CHECKED.update(logs)
        wrong = [f"{log.name}: {each}" for log in logs for each in discrepancies(log, sent)]
        if wrong:
            pytest.fail("not accounted for: " + "; ".join(wrong))
