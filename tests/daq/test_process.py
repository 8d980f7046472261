"""Child processes: deaf to the terminal from the first instant, gone with their parent, whatever they do."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

import psutil
import pytest

from daq.process import OF_THE_TERMINAL, Child, give_memory_back

GONE_S = 10.0
PARENT = """
import sys
from daq.process import Child
from tests.daq.test_process import blocked, hang
if __name__ == "__main__":
    first = Child("first", blocked)
    first.start()
    print(*first.pipe.recv())
    ends, stays = Child("ends", hang), Child("stays", hang, grace_s=None)
    for child in (ends, stays):
        child.start()
        print(child.pipe.recv(), flush=True)
    input()
"""


LEAVES = """
import os, signal
from daq.process import Child
from tests.daq.test_process import hang
if __name__ == "__main__":
    stays = Child("stays", hang, grace_s=None)
    stays.start()
    print(stays.pipe.recv(), flush=True)
    os.kill(stays.pid, signal.SIGSTOP)
    stays.leave()
"""
STARTS_BOTH = """
from daq.process import Child
from rig.ensembles import worker_processes
from tests.daq.test_process import look
if __name__ == "__main__":
    child = Child("looks", look)
    child.start()
    assert child.pipe.recv() is None
    child.end(10.0)
    with worker_processes(1) as workers:
        assert workers.executor.submit(os.getenv, "PYTHONSAFEPATH").result() is None
    assert "PYTHONSAFEPATH" not in os.environ
"""
TOLD = """
import pathlib
pathlib.Path(__file__).with_suffix(".ran").touch()
"""


def look(pipe: Connection) -> None:
    pipe.send(os.environ.get("PYTHONSAFEPATH"))


def blocked(pipe: Connection) -> None:
    pipe.send(sorted(int(each) for each in signal.pthread_sigmask(signal.SIG_BLOCK, ())))


def hang(pipe: Connection) -> None:
    pipe.send(os.getpid())
    while True:
        time.sleep(GONE_S)


def echo(pipe: Connection, greeting: str) -> None:
    pipe.send((greeting, pipe.recv()))


def test_the_first_child_of_a_process_is_deaf_too_and_all_but_the_one_that_outlives_end_with_it() -> None:
    with subprocess.Popen(  # noqa: S603 - our own text
        [sys.executable, "-c", PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        deaf_to = {int(each) for each in parent.stdout.readline().split()}
        ends, stays = (psutil.Process(int(parent.stdout.readline())) for _ in range(2))
        parent.kill()
    try:
        assert deaf_to >= OF_THE_TERMINAL
        assert psutil.wait_procs([ends], GONE_S)[0]
        assert stays.is_running()
    finally:
        stays.kill()


def test_what_lies_in_the_working_folder_is_no_module_of_ours(tmp_path: Path) -> None:
    data, program = tmp_path / "data", tmp_path / "program.py"
    data.mkdir()
    program.write_text(f"import os\n{STARTS_BOTH}")
    for name in ("signal", "socket", "pickle"):
        (data / f"{name}.py").write_text(TOLD)
    root = str(Path(__file__).parents[2])
    subprocess.run(  # noqa: S603 - our own text
        [sys.executable, program], cwd=data, env=os.environ | {"PYTHONPATH": root}, check=True, timeout=60
    )
    assert not list(data.glob("*.ran"))


def test_what_both_say_goes_through_one_pipe() -> None:
    child = Child("echo", echo, "hello")
    child.start()
    child.pipe.send(b"bytes")
    assert child.pipe.recv() == ("hello", b"bytes")
    child.end(GONE_S)
    child.pipe.close()
    assert child.process.exitcode == 0


@pytest.mark.parametrize(("terminate_s", "by"), [(GONE_S, signal.SIGTERM), (None, signal.SIGKILL)])
def test_one_that_hangs_is_terminated_or_killed(terminate_s: float | None, by: signal.Signals) -> None:
    child = Child("hangs", hang)
    child.start()
    assert child.pipe.recv() == child.pid
    assert child.alive
    assert Path(f"/proc/{child.pid}/comm").read_text() == "hangs\n"  # what top and ps show
    child.end(0.0, terminate_s)
    child.pipe.close()
    assert child.process.exitcode == -by


def test_one_that_was_never_started_has_ended() -> None:
    child = Child("not started", hang)
    child.end(GONE_S)
    child.pipe.close()
    assert child.pid is None


def free_in_between(pipe: Connection, every_s: float | None) -> None:
    """Answers with the memory that 200 MB in pieces took, and with what of it is left once most are freed."""
    if every_s is not None:
        give_memory_back(every_s)
    memory, before = psutil.Process().memory_info, psutil.Process().memory_info().rss
    pieces = [bytearray(50_000) for _ in range(4000)]
    taken = memory().rss - before
    pieces = pieces[::40]
    end_s = time.monotonic() + 5.0
    while memory().rss - before > 0.25 * taken and time.monotonic() < end_s and every_s is not None:
        time.sleep(0.02)
    pipe.send((taken, memory().rss - before, len(pieces)))


def heaps_of_threads(pipe: Connection) -> None:
    """Answers with how many heaps glibc has once four threads have each asked for something."""
    met = threading.Barrier(5)

    def ask() -> None:
        piece = bytearray(50_000)
        met.wait(GONE_S)
        del piece

    for _ in range(4):
        threading.Thread(target=ask).start()
    met.wait(GONE_S)
    glibc = ctypes.CDLL(None)
    glibc.fopen.restype = ctypes.c_void_p
    with tempfile.NamedTemporaryFile() as told:
        file = ctypes.c_void_p(glibc.fopen(told.name.encode(), b"w"))
        glibc.malloc_info(0, file)
        glibc.fclose(file)
        pipe.send(told.read().count(b"<heap nr="))


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="of glibc alone")
@pytest.mark.parametrize("shared", [True, False])
def test_threads_share_one_heap(shared: bool) -> None:
    child = Child("threads", heaps_of_threads, keeps_memory=not shared)
    child.start()
    heaps = child.pipe.recv()
    child.end(GONE_S)
    assert (heaps == 1) == shared


def left_of_it(every_s: float | None) -> float:
    child = Child("freeing", free_in_between, every_s, keeps_memory=True)
    child.start()
    taken, left, _ = child.pipe.recv()
    child.process.join()
    assert taken > 100e6
    return float(left / taken)


def test_who_gives_way_does_so_with_its_session() -> None:
    """Where sessions share the processor first, its own value weighs only against its neighbours there."""
    session = Path("/proc/self/autogroup")
    code = f"""import os
from daq.process import give_way
os.setsid()
give_way()
print(os.nice(0), open({str(session)!r}).read() if {session.exists()} else 'nice 5')"""
    said = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert int(said.split()[0]) == min(os.nice(0) + 5, 19)
    assert said.strip().endswith("nice 5")


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="of glibc alone")
def test_what_is_freed_between_what_stays_is_given_back() -> None:
    assert left_of_it(None) > 0.5  # glibc keeps it
    assert left_of_it(0.05) < 0.25


def test_nobody_waits_at_the_end_for_one_that_was_left_to_itself() -> None:
    """Not even for one that is frozen."""
    run = [sys.executable, "-c", LEAVES]
    with subprocess.Popen(  # noqa: S603 - our own text
        run, cwd=Path(__file__).parents[2], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        left = psutil.Process(int(parent.stdout.readline()))
        try:
            assert parent.wait(GONE_S) == 0
            assert left.status() == psutil.STATUS_STOPPED
        finally:
            left.kill()
            parent.kill()
