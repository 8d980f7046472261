"""Emulators as processes: they start or say why not, survive Ctrl-C, and never outlive their parent."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import psutil
import pytest

from daq.errors import ConfigurationError, InstrumentAbsent
from drivers.canopen_cia406.emulator.process import start_encoder
from drivers.emulator_process import start
from drivers.ni_daq.card import NiDaqCard
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, Wire
from drivers.scpi.emulator.process import start_function_generator
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from tests.drivers.conftest import WIRING, card_settings
from tests.drivers.encoders import slow_shaft
from tests.drivers.plants import SinePlant, UnbuildablePlant

DEADLINE_S = 10.0
PARENT = """
from drivers.emulator_process import DriveLink
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.scpi.emulator.process import start_function_generator
from tests.drivers.conftest import WIRING
from tests.drivers.plants import SinePlant
if __name__ == "__main__":
    with DriveLink.new() as link:
        generator = start_function_generator(link.sender)
        card = start_daq_card(SinePlant, WIRING, link.receiver)
    print(generator.pid, card.pid, flush=True)
    input()
"""


def gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def await_gone(pids: list[int]) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not all(gone(pid) for pid in pids):
        assert time.monotonic() < deadline, f"still there: {[pid for pid in pids if not gone(pid)]}"
        time.sleep(0.01)


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_they_end_with_their_parent(end: signal.Signals) -> None:
    with subprocess.Popen(  # noqa: S603 - our own text
        [sys.executable, "-c", PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        pids = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(pids) == 2
        parent.send_signal(end)
    await_gone(pids)


class BusyEcho:
    """Says what it hears while another of its threads computes."""

    def __init__(self) -> None:
        self._port, self._stopped = socket.create_server(("127.0.0.1", 0)), threading.Event()

    def open(self) -> tuple[str]:
        for work in (self._compute, self._echo):
            threading.Thread(target=work, daemon=True).start()
        return (str(self._port.getsockname()[1]),)

    def _compute(self) -> None:
        while not self._stopped.is_set():
            sum(range(1000))

    def _echo(self) -> None:
        client, _ = self._port.accept()
        while heard := client.recv(1):
            client.sendall(heard)

    def serve(self) -> None:
        self._stopped.wait()

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._port.close()


def test_one_answers_while_it_computes() -> None:
    with (
        start(BusyEcho, "busy echo") as emulated,
        socket.create_connection(("127.0.0.1", int(emulated.address))) as line,
    ):
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        took_s = list[float]()
        for _ in range(100):
            began_s = time.monotonic()
            line.sendall(b"?")
            line.recv(1)
            took_s.append(time.monotonic() - began_s)
    # with Python's own 5 ms from one thread to the next no answer would come sooner
    assert sorted(took_s)[20] < 0.004


def test_ctrl_c_does_not_reach_them() -> None:
    with start_function_generator() as emulated_generator, start_daq_card(SinePlant, WIRING) as emulated_card:
        for emulator in (emulated_generator, emulated_card):
            for _ in range(3):
                os.kill(emulator.pid, signal.SIGINT)
        generator = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource=emulated_generator.address))
        card = NiDaqCard(card_settings(emulated_card.address))
        generator.open()
        card.open()
        card.start()
        assert card.read(5120).first_sample == 0
        generator.off()
        card.close()
        generator.close()


def test_ctrl_c_in_the_parent_is_not_lost_while_they_start() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, set())
    with start_function_generator():
        assert signal.pthread_sigmask(signal.SIG_BLOCK, set()) == before


def test_closing_ends_the_process_in_good_order_with_a_client_connected() -> None:
    with start_daq_card(SinePlant, WIRING) as emulator:
        card = NiDaqCard(card_settings(emulator.address))
        card.open()
        card.start()
        emulator.close()
        assert emulator.child.process.exitcode == 0
        card.close()
    assert multiprocessing.active_children() == []


def test_a_plant_that_cannot_be_made_is_reported(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InstrumentAbsent, match="ValueError: no such rig"):
        start_daq_card(UnbuildablePlant, WIRING)
    assert "no such rig" in capfd.readouterr().err
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(
    ("wires", "match"),
    [
        ({"cDAQ1Mod1/ai0": Wire("nothing", 1.0)}, "plant channel = nothing: one of force, acceleration"),
        ({"cDAQ1Mod1/ia0": Wire("force", 1.0)}, "physical = cDAQ1Mod1/ia0: an input like"),
    ],
)
def test_a_wiring_that_cannot_be_is_reported(
    wires: dict[str, Wire], match: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises((ConfigurationError, InstrumentAbsent), match=match):
        start_daq_card(SinePlant, CardWiring(wires))
    capfd.readouterr()


def slow_plant() -> SinePlant:
    time.sleep(DEADLINE_S)
    return SinePlant()


def test_a_plant_that_takes_too_long_is_given_up() -> None:
    began = time.monotonic()
    with pytest.raises(InstrumentAbsent, match=r"did not start within 0\.5 s"):
        start_daq_card(slow_plant, WIRING, deadline_s=0.5)
    assert time.monotonic() - began < DEADLINE_S
    assert multiprocessing.active_children() == []


def test_they_listen_on_loopback_only() -> None:
    with (
        start_function_generator() as emulated_generator,
        start_daq_card(SinePlant, WIRING) as emulated_card,
        start_encoder(slow_shaft) as emulated_encoder,
    ):
        for emulator in (emulated_generator, emulated_card, emulated_encoder):
            listeners = [
                connection.laddr.ip.removeprefix("::ffff:")
                for connection in psutil.Process(emulator.pid).net_connections(kind="inet")
                if connection.status == psutil.CONN_LISTEN
            ]
            assert listeners == ["127.0.0.1"]
