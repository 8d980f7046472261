"""The CANopen driver with a node of the canopen package, described by an EDS file, and its own heartbeat."""

from __future__ import annotations

import logging
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import can
import canopen
import numpy as np
import pytest

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.settings import EncoderSettings
from tests.drivers.encoders import PATIENCE_S, opened

NODE = 0x1C
CHANNEL = "a bus in this process"
PERIOD_S = 0.01
TYPES = {8: 5, 16: 6, 32: 7}

# index, sub-index (None: a variable), name, bits, access, default: an encoder that also maps its speed.
OBJECTS = [
    (0x1000, None, "Device type", 32, "ro", "0x00010196"),
    (0x1001, None, "Error register", 8, "ro", "0"),
    (0x1017, None, "Producer heartbeat time", 16, "rw", "300"),
    (0x1018, 0, "Highest sub-index supported", 8, "ro", "4"),
    (0x1018, 1, "Vendor-ID", 32, "ro", "0x000000AD"),
    (0x1018, 2, "Product code", 32, "ro", "0x00000011"),
    (0x1018, 3, "Revision number", 32, "ro", "0x00020001"),
    (0x1018, 4, "Serial number", 32, "ro", "0x00012345"),
    (0x1800, 0, "Highest sub-index supported", 8, "ro", "5"),
    (0x1800, 1, "COB-ID used by TPDO", 32, "rw", "$NODEID+0x40000180"),
    (0x1800, 2, "Transmission type", 8, "rw", "0xFF"),
    (0x1800, 3, "Inhibit time", 16, "rw", "0"),
    (0x1800, 5, "Event timer", 16, "rw", "0"),
    (0x1A00, 0, "Number of mapped objects", 8, "rw", "2"),
    (0x1A00, 1, "Mapped object 1", 32, "rw", "0x60300110"),
    (0x1A00, 2, "Mapped object 2", 32, "rw", "0x60040020"),
    (0x6000, None, "Operating parameters", 16, "rw", "0x0004"),
    (0x6001, None, "Measuring units per revolution", 32, "rw", "1000"),
    (0x6002, None, "Total measuring range", 32, "rw", "1000"),
    (0x6003, None, "Preset value", 32, "rw", "0"),
    (0x6004, None, "Position value", 32, "ro", "0"),
    (0x6030, 0, "Highest sub-index supported", 8, "ro", "1"),
    (0x6030, 1, "Speed value channel 1", 16, "ro", "0"),
    (0x6200, None, "Cyclic timer", 16, "rw", "0"),
]


def eds(without: tuple[int, ...] = (), read_only: str = "", **changed: str) -> str:
    """Return the objects as an electronic data sheet (CiA 306), some of them left out or changed."""
    present = [item for item in OBJECTS if item[0] not in without]
    lines = ["[FileInfo]", "FileName=encoder.eds", "[DeviceInfo]", "ProductName=Encoder", "[OptionalObjects]"]
    groups = sorted({item[0] for item in present})
    lines += [f"SupportedObjects={len(groups)}"]
    lines += [f"{number}=0x{index:04X}" for number, index in enumerate(groups, 1)]
    for index in groups:
        members = [item for item in present if item[0] == index and item[1] is not None]
        if members:
            lines += [f"[{index:04X}]", f"ParameterName=Group {index:04X}", "ObjectType=0x9"]
            lines += [f"SubNumber={len(members)}"]
    for index, subindex, name, bits, access, default in present:
        section = f"{index:04X}" if subindex is None else f"{index:04X}sub{subindex:X}"
        lines += [f"[{section}]", f"ParameterName={name}", "ObjectType=0x7", f"DataType=0x{TYPES[bits]:04X}"]
        lines += [f"AccessType={'ro' if name == read_only else access}"]
        lines += [f"DefaultValue={changed.get(name, default)}", "PDOMapping=1"]
    return "\n".join(lines) + "\n"


class Peer:
    """A plain `canopen.LocalNode`, with a thread that counts up."""

    def __init__(self, description: Path) -> None:
        self.node = canopen.LocalNode(NODE, str(description))
        self.network = canopen.Network(can.Bus(CHANNEL, interface="virtual"))
        self.network.NOTIFIER_CYCLE = 0.05
        self.network.connect()
        self.network.add_node(self.node)
        self.stopped = threading.Event()
        self.counts = 990
        self.thread = threading.Thread(target=self.count)

    def boot(self) -> None:
        self.node.nmt.state = "INITIALISING"
        self.node.nmt.state = "PRE-OPERATIONAL"
        self.thread.start()

    def count(self) -> None:
        while not self.stopped.wait(PERIOD_S):
            if self.node.nmt.state == "OPERATIONAL":
                self.counts = (self.counts + 1) % 1000
                self.network.send_message(0x180 + NODE, struct.pack("<hI", -5, self.counts))

    def close(self) -> None:
        self.stopped.set()
        self.thread.join()
        self.node.nmt.stop_heartbeat()
        self.network.disconnect()


@pytest.fixture
def peer(tmp_path: Path) -> Callable[..., AbstractContextManager[Peer]]:
    """Return how to run a peer that an EDS describes."""

    @contextmanager
    def running(description: str) -> Iterator[Peer]:
        path = tmp_path / "encoder.eds"
        path.write_text(description)
        node = Peer(path)
        node.boot()
        try:
            yield node
        finally:
            node.close()

    return running


def settings(timeout_s: float = PATIENCE_S) -> EncoderSettings:
    return EncoderSettings(
        NODE, "virtual", options={"channel": CHANNEL}, period_s=PERIOD_S, timeout_s=timeout_s
    )


RunPeer = Callable[[str], AbstractContextManager[Peer]]


def test_positions_of_a_foreign_node(peer: RunPeer) -> None:
    with peer(eds()) as other, opened(settings()) as encoder:
        assert encoder.identity == (
            "single-turn rotary encoder, vendor ADh, product code 11h, revision 20001h, serial number 74565"
        )
        assert (encoder.counts_per_revolution, encoder.total_range) == (1000, 1000)
        assert other.node.sdo[0x6200].raw == 10
        encoder.start()
        block = encoder.read(40)
        # Its thread waits a little more than 10 ms, and stalls with this machine: only the order is certain.
        assert np.array_equal(np.diff(block.counts) % 1000, np.ones(39))
        assert np.all(np.diff(block.timestamp_s) > 0.0)
        encoder.preset(123)
        assert other.node.sdo[0x6003].raw == 123


def test_what_the_libraries_log_reaches_whoever_asks_for_it_and_not_the_screen(
    peer: RunPeer, caplog: pytest.LogCaptureFixture
) -> None:
    with peer(eds()), opened(settings()):
        for library in ("can", "canopen"):
            logger = logging.getLogger(library)
            assert logger.level == logging.NOTSET
            assert any(isinstance(handler, logging.NullHandler) for handler in logger.handlers)
            logger.warning("%s says so", library)
    assert {"can says so", "canopen says so"} <= set(caplog.messages)


def read_on(encoder: CanopenEncoder) -> None:
    while True:
        encoder.read(5)


def test_a_foreign_node_that_falls_back(peer: RunPeer) -> None:
    with peer(eds()) as other, opened(settings()) as encoder:
        encoder.start()
        encoder.read(5)
        other.node.nmt.state = "PRE-OPERATIONAL"
        with pytest.raises(DeviceLost, match="fell back to pre-operational"):
            read_on(encoder)


def test_an_emergency_of_a_foreign_node(peer: RunPeer) -> None:
    with peer(eds()) as other, opened(settings()) as encoder:
        encoder.start()
        other.node.emcy.send(0x8110, 0x11)
        sent_s = time.time()  # the clock of this bus; a position that was sent later comes behind it
        while encoder.read(5).timestamp_s[-1] <= sent_s:
            pass
        assert [(found.code, found.text) for found in encoder.emergencies] == [(0x8110, "Monitoring")]


def test_objects_that_are_missing_are_listed_with_the_rest(peer: RunPeer) -> None:
    with peer(eds(without=(0x6001,), **{"Transmission type": "1", "Number of mapped objects": "0"})):
        with pytest.raises(InstrumentAbsent, match=r"1800h:02\) is 1 instead of 254 or 255") as caught:
            CanopenEncoder(settings()).open()
        assert "reading measuring units per revolution (6001h:00): Code 0x06020000" in caught.value.what
        assert "TPDO 1 holds nothing" in caught.value.what


def test_a_node_that_sends_no_heartbeat_although_it_is_told_to(peer: RunPeer) -> None:
    with peer(eds(**{"Producer heartbeat time": "0"})) as other:
        other.node.nmt.start_heartbeat = lambda _: None
        with pytest.raises(InstrumentSilent, match=r"no heartbeat within 1\.1 s, although it is to send one"):
            CanopenEncoder(settings(timeout_s=0.5)).open()


def test_a_node_that_refuses_its_timer(peer: RunPeer) -> None:
    with peer(eds(read_only="Cyclic timer")):
        with pytest.raises(
            InstrumentRefused, match=r"cyclic timer \(6200h:00\) = 10: Code 0x06010002"
        ) as caught:
            CanopenEncoder(settings()).open()
        assert caught.value.code == "06010002h"
