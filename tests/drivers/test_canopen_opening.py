"""What opening a CANopen encoder over socketcand finds out, and what it refuses."""

from __future__ import annotations

import socket
import threading
from dataclasses import replace

import pytest

from daq.errors import (
    InstrumentAbsent,
    InstrumentSilent,
)
from drivers.canopen_cia406.emulator.process import EncoderSetup
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.link import SocketcandBus
from tests.drivers.encoders import PATIENCE_S, emulated, opened, socketcand

COUNTS = 4096


def test_says_what_it_is() -> None:
    setup = EncoderSetup(vendor=0x1AB, product=0x406, serial=4711, revolutions=16, device_type=0x20196)
    with emulated(setup) as address, opened(socketcand(address, serial=4711)) as encoder:
        assert encoder.identity == (
            "multi-turn rotary encoder, vendor 1ABh, product code 406h, revision 10000h, serial number 4711"
        )
        assert (encoder.counts_per_revolution, encoder.total_range) == (COUNTS, 16 * COUNTS)


def test_without_scaling_the_physical_resolution_counts() -> None:
    setup = EncoderSetup(scaling=False, counts_per_revolution=8192, revolutions=4)
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        assert (encoder.counts_per_revolution, encoder.total_range) == (8192, 4 * 8192)


def test_all_differences_are_listed_at_once() -> None:
    setup = EncoderSetup(
        device_type=0x0000_0191,
        serial=2,
        counts_per_revolution=8192,
        transmission_type=1,
        mapped=(0x6030_0110,),
    )
    with emulated(setup) as address:
        encoder = CanopenEncoder(
            socketcand(address, serial=1, vendor=5, counts_per_revolution=4096, total_range=4096)
        )
        with pytest.raises(InstrumentAbsent, match="it is not the encoder of the bench file") as caught:
            encoder.open()
    assert caught.value.what.partition(": ")[2].split("; ") == [
        "device type (1000h:00) is 00000191h instead of 00010196h (single-turn rotary encoder) "
        "or 00020196h (multi-turn rotary encoder)",
        "vendor (1018h:01) is 0h instead of 5h",
        "serial number (1018h:04) is 2h instead of 1h",
        "counts per revolution is 8192 instead of 4096",
        "total range is 8192 instead of 4096",
        "transmission type of TPDO 1 (1800h:02) is 1 instead of 254 or 255",
        "TPDO 1 holds 60300110h, not the position value (60040020h)",
    ]


def test_another_node() -> None:
    with (
        emulated(EncoderSetup(node=7)) as address,
        pytest.raises(InstrumentAbsent, match=r"nobody answers as node 8 .*no answer within 0\.2 s"),
    ):
        CanopenEncoder(socketcand(address, node=8, timeout_s=0.2)).open()


def test_another_channel() -> None:
    with (
        emulated(EncoderSetup(channel="can1")) as address,
        pytest.raises(InstrumentAbsent, match="it says '< error could not open bus >' and not '< ok >'"),
    ):
        CanopenEncoder(socketcand(address)).open()


def test_a_handshake_on_a_busy_bus() -> None:
    # A frame right behind the last answer, in one piece with it, is neither an error nor lost.
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            server.accept()[0].close()  # somebody looks whether it is there
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"< hi >")
                connection.recv(100)
                connection.sendall(b"< ok >")
                connection.recv(100)
                connection.sendall(b"< ok >< frame 707 1.5 7F >")
                connection.recv(1)

        answering = threading.Thread(target=answer)
        answering.start()
        with SocketcandBus("can0", "127.0.0.1", server.getsockname()[1], timeout_s=PATIENCE_S) as bus:
            message = bus.recv(PATIENCE_S)
        answering.join()
    assert message is not None
    assert (message.arbitration_id, message.timestamp, message.data) == (0x707, 1.5, b"\x7f")


def test_what_listens_there_says_nothing() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(InstrumentSilent, match=r"no answer within 0\.2 s"):
            CanopenEncoder(socketcand(address, timeout_s=0.2)).open()


@pytest.mark.parametrize(
    ("interface", "options", "match"),
    [
        ("no_such", {}, "CAN interface 'no_such' not supported"),
        ("socketcand", {"host": "127.0.0.1", "port": 1, "channel": "can0"}, "nobody answers"),
        ("socketcand", {}, "missing 3 required positional arguments"),
        ("slcan", {"channel": "/dev/no/such/tty"}, "nobody answers"),
    ],
)
def test_nobody_there(interface: str, options: dict[str, str | int], match: str) -> None:
    settings = replace(socketcand("127.0.0.1:1"), interface=interface, options=options)
    with pytest.raises(InstrumentAbsent, match=match) as caught:
        CanopenEncoder(settings).open()
    assert f"node 7 on {interface}" in caught.value.address
