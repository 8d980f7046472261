"""What an encoder says without being asked: identifiers, states, emergencies, errors of the bus."""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag

from canopen.emcy import EmcyError

from drivers.protocols.encoder import Emergency

TPDO1 = 0x180
EMCY = 0x080
SDO_ANSWER = 0x580
HEARTBEAT = 0x700
"""Function codes of the predefined connection set; the node's number is added (CiA 301, 7.3.5)."""

LINUX_INTERFACES = ("socketcan", "socketcand")
"""Interfaces whose error frames carry Linux's error class in their identifier."""

_EMCY = struct.Struct("<HB5s")  # error code, error register, five bytes of the maker's


class NmtState(IntEnum):
    """State in a heartbeat (CiA 301, 7.2.8.3.2.2)."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(IntEnum):
    """What a master may tell a node (CiA 301, 7.2.8.3.1)."""

    START = 1
    ENTER_PRE_OPERATIONAL = 128


class BusError(IntFlag):
    """Class of an error frame (linux/can/error.h)."""

    CONTROLLER = 0x004
    BUS_ERROR = 0x080
    BUS_OFF = 0x040


def heartbeat_state(data: bytes | bytearray) -> int:
    """Return the state in a heartbeat; ValueError unless it is one byte."""
    if len(data) != 1:
        raise ValueError(f"a heartbeat of {len(data)} bytes")
    # Bit 7 toggles in the older node guarding and is 0 in a heartbeat.
    return data[0] & 0x7F


def state_name(state: int) -> str:
    """Return a state in words."""
    known = {member.value: member.name.lower().replace("_", "-") for member in NmtState}
    return known.get(state, f"state {state}")


def emergency(data: bytes | bytearray, arrival_s: float) -> Emergency:
    """Return an emergency message taken apart (CiA 301, 7.2.7); ValueError unless it has 8 bytes."""
    if len(data) != _EMCY.size:
        raise ValueError(f"an emergency message of {len(data)} bytes")
    code, register, vendor = _EMCY.unpack(data)
    text = EmcyError(code, register, vendor, arrival_s).get_desc()
    return Emergency(arrival_s, code, register, vendor, text)
