"""Off means off: what is out of reach, watched while it drives, stopped in time, and nobody else's."""

from __future__ import annotations

import contextlib
import os
import pty
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from tests.end_to_end.command import ROOT, await_gone, await_true, command
from tests.end_to_end.conftest import SpiedBench
from tests.end_to_end.files import write_bench, write_scenario
from tests.tiers import first_short

SAFE_S = 1.0


class Relay:
    """A network between a run and its generator, which the test takes away and gives back.

    What was on its way and who had asked for a connection is forgotten, so that what comes after is new.
    """

    def __init__(self, port: int) -> None:
        self._to, self._open = port, list[socket.socket]()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._selector, self._ways = selectors.DefaultSelector(), dict[socket.socket, socket.socket]()
        self._up, self._forgets, self._ended = True, False, False
        self._listener.setblocking(False)
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def take_away(self) -> None:
        self._up, self._forgets = False, True

    def give_back(self) -> None:
        self._up = True

    def close(self) -> None:
        self._ended = True
        self._thread.join()
        self._listener.close()

    def _carry(self) -> None:
        """Answers nobody while it is away."""
        self._selector.register(self._listener, selectors.EVENT_READ)
        while not self._ended:
            if self._up and self._forgets:
                self._forget()
            for key, _ in self._selector.select(0.02):
                if not self._up:
                    time.sleep(0.02)
                elif key.fileobj is self._listener:
                    near, _ = self._listener.accept()
                    far = socket.create_connection(("127.0.0.1", self._to))
                    self._ways |= {near: far, far: near}
                    for each in (near, far):
                        self._selector.register(each, selectors.EVENT_READ)
                elif key.fileobj in self._ways:  # its other end may have closed both since
                    self._pass_on(key.fileobj)
        for each in self._ways:
            each.close()
        self._selector.close()

    def _forget(self) -> None:
        for each in self._ways:
            self._selector.unregister(each)
            each.close()
        self._ways.clear()
        with contextlib.suppress(BlockingIOError):
            while True:
                self._listener.accept()[0].close()
        self._forgets = False

    def _pass_on(self, near: socket.socket) -> None:
        far = self._ways[near]
        data = b""
        with contextlib.suppress(OSError):
            data = near.recv(4096)
            far.sendall(data)
        if not data:
            for each in (near, far):
                self._selector.unregister(each)
                self._ways.pop(each)
                each.close()


@pytest.fixture
def relay(bench: SpiedBench) -> Iterator[Relay]:
    relay = Relay(int(bench.generator.address.split("::")[2]))
    yield relay
    relay.close()


def ask(address: str, command: str) -> None:
    """Say something to a generator, as another program would."""
    with socket.create_connection(("127.0.0.1", int(address.split("::")[2]))) as other:
        other.sendall(f"{command}\n*OPC?\n".encode())
        other.recv(16)


@pytest.mark.long
def test_a_generator_out_of_reach_is_switched_off_once_it_is_back_and_no_run_gets_it_before(
    bench: SpiedBench, relay: Relay, tmp_path: Path
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=60.0)
    file = write_bench(tmp_path / "far.toml", f"TCPIP::127.0.0.1::{relay.port}::SOCKET", bench.card.address)
    with command("run", scenario, "--bench", file, "--out", tmp_path) as run:
        run.await_line("recording")
        bench.spy.await_on()
        relay.take_away()
        ended = run.end()
    assert ended.code == 1, ended.err
    assert "no answer to" in ended.err
    goes_on = ended.goes_on
    try:
        assert bench.spy.on
        with command("run", scenario, "--bench", file, "--out", tmp_path) as again:
            refused = again.end()
        assert refused.code == 1
        assert f"in use by process {goes_on.pid}, which goes on switching off a drive" in refused.err
        assert bench.spy.on
        relay.give_back()
        bench.spy.await_off()
        await_gone([goes_on], 30.0)  # it has to hear that it is off, in half a second each time it asks
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            goes_on.kill()


@pytest.mark.long
def test_a_second_run_leaves_the_first_alone(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=6.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as first:
        first.await_line("recording")
        with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as second:
            refused = second.end()
        assert refused.code == 1
        assert f"in use by process {first.pid} since" in refused.err
        assert bench.spy.on
        ended = first.end()
    assert ended.code == 0, ended.err


@pytest.mark.parametrize("how", first_short(["frozen", "killed"]))
def test_a_run_that_is_stopped_dead_is_safe_within_a_second(
    bench: SpiedBench, tmp_path: Path, freeze: Callable[[int], None], how: str
) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        bench.spy.await_on()  # in its ramp
        children = run.children()
        freeze(run.pid) if how == "frozen" else os.kill(run.pid, signal.SIGKILL)
        stopped_s = time.monotonic()
        await_true("drive off", lambda: not bench.spy.on)
        assert time.monotonic() - stopped_s < SAFE_S
        if how == "frozen":
            os.kill(run.pid, signal.SIGCONT)
            assert run.end().code == 1
    psutil.wait_procs(children, timeout=8.0)


def test_a_generator_that_another_program_turns_ends_the_run(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=30.0)
    with command("run", scenario, "--bench", bench.file, "--out", tmp_path) as run:
        run.await_line("recording")
        bench.spy.await_on()
        before = len(bench.spy.heard)
        ask(bench.generator.address, "VOLT 5.5")  # of 5.0
        await_true("heard", lambda: bench.spy.heard[before:])
        asked_s = time.monotonic()
        await_true("drive off", lambda: not bench.spy.on)
        assert time.monotonic() - asked_s < SAFE_S
        ended = run.end()
    assert ended.code == 1
    assert "which it was not told" in ended.err


def test_twice_the_force_is_seen_at_an_eighth_of_it(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", duration_s=30.0)
    file = tmp_path / "wrong.toml"
    text = bench.file.read_text()
    assert text.count('"3.6 N/V"') == 1
    file.write_text(text.replace('"3.6 N/V"', '"1.8 N/V"'))
    with command("run", scenario, "--bench", file, "--out", tmp_path) as run:
        ended = run.end()
    assert ended.code == 3, ended.err
    assert "interlock: drive.force = 2.25 N where 1.12 is ordered: what a volt makes" in ended.err
    assert max(settings.amplitude_v for settings in bench.spy.heard) < 1.0  # of 5 V
    assert not bench.spy.on


def test_more_force_than_the_bench_allows_ends_the_run(bench: SpiedBench, tmp_path: Path) -> None:
    """From rest nothing is proven before: the measured drive ends it."""
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.0, duration_s=30.0)
    file = tmp_path / "wrong.toml"
    file.write_text(bench.file.read_text().replace('"3.6 N/V"', '"1.8 N/V"'))
    with command("run", scenario, "--bench", file, "--out", tmp_path) as run:
        bench.spy.await_on()
        ended = run.end()
    assert ended.code == 3, ended.err
    assert "where the bench allows 12 N" in ended.err
    assert not bench.spy.on


def fill(terminal: str) -> None:
    """Write until the terminal takes nothing ahead any more, from whomever."""
    other = os.open(terminal, os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(other, bytes(64))
    os.close(other)


def test_a_terminal_that_stops_reading_delays_no_off(bench: SpiedBench, tmp_path: Path) -> None:
    scenario = write_scenario(tmp_path / "scenario.toml", settle_s=0.1, duration_s=60.0)
    ours, theirs = pty.openpty()
    arguments = ["run", scenario, "--bench", bench.file, "--out", tmp_path]
    with subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "rig.start", *map(str, arguments)],
        cwd=ROOT,
        stdin=theirs,
        stdout=theirs,
        stderr=subprocess.PIPE,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "100"},
    ) as run:
        terminal = os.ttyname(theirs)
        os.close(theirs)
        shown = b""
        while b"recording" not in shown:
            shown += os.read(ours, 4096)
        bench.spy.await_on()
        fill(terminal)
        with pytest.raises(subprocess.TimeoutExpired):
            run.wait(2.0)  # its bar moves several times meanwhile
        asked_s = time.monotonic()
        run.send_signal(signal.SIGINT)
        await_true("drive off", lambda: not bench.spy.on)
        assert time.monotonic() - asked_s < SAFE_S

        def read_on() -> None:
            with contextlib.suppress(OSError):
                while os.read(ours, 4096):
                    pass

        reading = threading.Thread(target=read_on)
        reading.start()
        assert run.wait(20.0) == 130
        reading.join()
        os.close(ours)
