"""A clock that is set back while an instrument is awaited makes nobody wait longer."""

from __future__ import annotations

import itertools
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

import can
import pytest
from pyvisa_py.protocols import vxi11

from daq.clock import SystemClock
from daq.errors import InstrumentAbsent, InstrumentSilent
from drivers.canopen_cia406.link import CanLink
from drivers.canopen_cia406.objects import DEVICE_TYPE
from drivers.scpi.link import ScpiLink
from tests.drivers.encoders import socketcand

HOUR_S = 3600.0
SOON_S = 5.0
"""Far above the tenths of a second that everything here takes on a busy machine."""


@pytest.fixture
def set_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every look at the wall clock but the first finds it an hour further back."""
    began_s, looks = time.time(), itertools.count()
    monkeypatch.setattr(time, "time", lambda: began_s - HOUR_S * next(looks))


@pytest.fixture
def mute() -> Iterator[int]:
    """The port of something that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def within(seconds: float, work: Callable[[], None]) -> None:
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    assert not thread.is_alive(), "it waits for the wall clock"


def test_a_generator_is_drained_and_found_silent_in_time(set_back: None, mute: int) -> None:
    def ask() -> None:
        link = ScpiLink("signal generator", f"TCPIP::127.0.0.1::{mute}::SOCKET", timeout_s=0.3)
        link.open()
        try:
            with pytest.raises(InstrumentSilent, match="no answer to OUTP"):
                link.query("OUTP?")
        finally:
            link.close()

    within(SOON_S, ask)


@pytest.fixture
def unread() -> Iterator[int]:
    """The port of something over VXI-11 that answers every call but a read."""
    accepted, done = (1, 0, 0, 0, 0), (0, 1, 0, 4096)  # no error, link 1, no port, bytes at a time

    def answer() -> None:
        connection, _ = server.accept()
        with connection, connection.makefile("rb") as calls:
            while mark := calls.read(4):
                call = calls.read(int.from_bytes(mark) & 0x7FFFFFFF)
                if int.from_bytes(call[20:24]) != vxi11.DEVICE_READ:
                    said = call[:4] + struct.pack(">9I", *accepted, *done)
                    connection.sendall(struct.pack(">I", len(said) | 0x80000000) + said)

    with socket.create_server(("127.0.0.1", 0)) as server:
        answering = threading.Thread(target=answer, daemon=True)
        answering.start()
        yield server.getsockname()[1]
        answering.join(SOON_S)


def test_over_vxi_11_too(set_back: None, unread: int) -> None:
    def ask() -> None:
        link = ScpiLink("signal generator", f"TCPIP::127.0.0.1,{unread}::inst0::INSTR", timeout_s=0.3)
        with pytest.raises(InstrumentAbsent, match=r"nobody answers .*VI_ERROR_IO"):
            link.open()

    within(SOON_S, ask)


class Nobody:
    """Hears of nothing."""

    def frame(self, message: can.Message, arrival_s: float) -> None: ...
    def quiet(self, now_s: float) -> None: ...
    def lost(self, why: str, cause: Exception | None = None) -> None: ...


@pytest.fixture
def empty_bus() -> Iterator[str]:
    """Where a CAN server listens on whose bus there is no node."""

    def greet() -> None:
        server.accept()[0].close()  # somebody looks whether it is there
        connection, _ = server.accept()
        with connection:
            for answer in (b"< hi >", b"< ok >", b"< ok >"):
                connection.sendall(answer)
                connection.recv(100)
            while connection.recv(100):
                pass

    with socket.create_server(("127.0.0.1", 0)) as server:
        greeting = threading.Thread(target=greet)
        greeting.start()
        yield f"127.0.0.1:{server.getsockname()[1]}"
        greeting.join()


def test_a_bus_is_found_quiet_and_a_node_silent_in_time(set_back: None, empty_bus: str) -> None:
    assert vars(can.bus)["time"] is time.monotonic  # bound by its name, where no patch of the module reaches

    def ask() -> None:
        link = CanLink(socketcand(empty_bus, timeout_s=0.2), Nobody(), SystemClock())
        link.open()
        try:
            with pytest.raises(InstrumentSilent, match=r"no answer within 0\.2 s"):
                link.upload(DEVICE_TYPE)
        finally:
            link.close()  # joins the thread that waits for frames

    within(SOON_S, ask)
