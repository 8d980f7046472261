"""Bytes of CANopen objects and frames."""

from __future__ import annotations

import pytest

from daq.errors import ConfigurationError
from drivers.canopen_cia406 import frames, objects
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.objects import PositionLayout
from drivers.canopen_cia406.settings import EncoderSettings

SPEED = 0x6030_0110
POSITION = 0x6004_0020


@pytest.mark.parametrize(
    ("mapping", "data", "counts"),
    [
        ((POSITION,), "01020304", 0x04030201),
        ((SPEED, POSITION), "aabb01020304", 0x04030201),
        ((POSITION, SPEED), "ffffffff0000", 0xFFFFFFFF),
    ],
)
def test_position_in_a_tpdo(mapping: tuple[int, ...], data: str, counts: int) -> None:
    layout = PositionLayout.of(mapping)
    assert layout.length == len(bytes.fromhex(data))
    assert layout.decode(bytes.fromhex(data)) == counts


@pytest.mark.parametrize(
    ("mapping", "match"),
    [
        ((), "holds nothing, not the position value"),
        ((SPEED,), "holds 60300110h, not the position value"),
        ((0x6500_0004, POSITION), "36 bits with the position at bit 4"),
        ((POSITION, POSITION, SPEED), "80 bits"),
    ],
)
def test_mappings_without_a_position_that_can_be_read(mapping: tuple[int, ...], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        PositionLayout.of(mapping)


def test_entries() -> None:
    assert objects.CYCLIC_TIMER.encode(1000) == b"\xe8\x03"
    assert objects.DEVICE_TYPE.decode(b"\x96\x01\x01\x00") in objects.ROTARY
    with pytest.raises(ValueError, match=r"cyclic timer \(6200h:00\) has 4 bytes instead of 2"):
        objects.CYCLIC_TIMER.decode(bytes(4))
    with pytest.raises(OverflowError, match="too big"):
        objects.CYCLIC_TIMER.encode(65536)


def test_emergency() -> None:
    found = frames.emergency(bytes.fromhex("0050 81 0102030405"), 3.0)
    assert (found.code, found.register, found.vendor) == (0x5000, 0x81, b"\1\2\3\4\5")
    assert found.text == "Device Hardware"
    with pytest.raises(ValueError, match="an emergency message of 7 bytes"):
        frames.emergency(bytes(7), 0.0)


@pytest.mark.parametrize(("byte", "name"), [(5, "operational"), (0xFF, "pre-operational"), (9, "state 9")])
def test_heartbeat(byte: int, name: str) -> None:
    assert frames.state_name(frames.heartbeat_state(bytes([byte]))) == name


def test_heartbeat_of_the_wrong_length() -> None:
    with pytest.raises(ValueError, match="a heartbeat of 0 bytes"):
        frames.heartbeat_state(b"")


def test_settings_that_cannot_be_are_listed_at_once() -> None:
    wrong = EncoderSettings(128, "", options={}, period_s=1.5e-3, buffer_s=0.0, timeout_s=float("nan"))
    with pytest.raises(ConfigurationError, match=r"encoder\.node = 128: 1 to 127") as caught:
        CanopenEncoder(wrong).open()
    keys = [problem.key for problem in caught.value.problems]
    assert keys == [f"encoder.{key}" for key in ("interface", "node", "period", "buffer", "timeout")]
