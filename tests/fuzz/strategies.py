"""Inputs that get past magic numbers, checksums and keys: sound ones, changed where it hurts.

Each is made of a few drawn bytes, which is quick, and shrinks.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from drivers.mitsubishi_fr.frames import checksum
from rig.files.faults import read_toml, toml_of
from tests.fuzz.seeds import piece
from tests.fuzz.targets import kept

_ODD = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, (1 << 63) - 1, (1 << 64) - 1)
"""Numbers where counts, lengths and places go wrong."""
_FORMS = ("<H", ">H", "<I", ">I", "<Q", "B")
_DRAWN = st.binary(max_size=60)


def _steps(drawn: bytes, size: int) -> Iterator[bytes]:
    return (drawn[at : at + size].ljust(size, b"\0") for at in range(0, len(drawn), size))


def _changed(path: Path, drawn: bytes) -> bytes:
    """A sound input that is cut, spliced, flipped, or has an odd number in it, some of these at once."""
    data = bytearray(path.read_bytes())
    for step in _steps(drawn, 6):
        what, much = step[0] % 6, step[5]
        at = int.from_bytes(step[1:3], "big") * len(data) >> 16
        to = int.from_bytes(step[3:5], "big") * len(data) >> 16
        if what == 0 and data:
            data[at] ^= 1 << much % 8
        elif what in (1, 2):
            form = _FORMS[step[3] % len(_FORMS)]
            size = struct.calcsize(form)
            data[at : at + size] = struct.pack(form, _ODD[much % len(_ODD)] % (1 << 8 * size))
        elif what == 3:
            del data[at : at + much if much < 250 else None]
        elif what == 4:
            data[to:to] = data[at : at + much]
        else:
            data[at:at] = step
    return bytes(data)


def files(name: str) -> st.SearchStrategy[bytes]:
    """Changed inputs of those that are kept of a target."""
    return st.builds(_changed, st.sampled_from(kept(name)), _DRAWN)


def _modbus(drawn: bytes) -> bytes:
    """Frames whose checksum is mostly right and whose length, station or function need not be."""
    parts = []
    for step in _steps(drawn, 5):
        function = (3, 3, 6, 0x83, 0x86, 4)[step[0] % 6]
        length = (4, 6, 10, 12, 14, 16, 255, step[1])[step[1] % 8]
        body = bytes([1 + (step[2] > 230), function, length]) + step[3:] * (step[4] % 9)
        parts.append(b"-" + step[:2] * (step[2] % 2) + body + (checksum(body) if step[3] < 200 else b""))
    return piece(*parts)


def _can(drawn: bytes) -> bytes:
    """Positions on the beat, with odd frames among them."""
    parts = []
    for number, step in enumerate(_steps(drawn, 3)):
        odd = step[0] if step[0] < 128 else 9
        parts.append(
            bytes([odd]) + struct.pack(">h", 10 + (step[1] > 200) * step[2]) + struct.pack("<I", number)
        )
        parts[-1] += step[: step[1] % 3] if step[2] < 40 else b""
    return piece(*parts * 3)


def _sdo(drawn: bytes) -> bytes:
    """Answers of known kinds with numbers that mean something, the last one cut."""
    kinds = (0x43, 0x43, 0x43, 0x4B, 0x4F, 0x47, 0x42, 0x41, 0x40, 0x60, 0x80, 0x01)
    values = (0, 1, 8, 254, 0x187, 0x00020196, 0x60040020, 0x05040000, (1 << 32) - 1)
    steps = _steps(drawn, 2)
    return b"".join(struct.pack("<B3xI", kinds[a % len(kinds)], values[b % len(values)]) for a, b in steps)[
        : -1 - len(drawn) % 3
    ]


_ANSWERS = (
    "1",
    "0",
    '+0,"No error"',
    "-113,x",
    "9.9E37",
    "NAN",
    "1e999",
    "-",
    "",
    "SIN",
    "VPP",
    "²",
    "1" * 5000,
)


def _scpi(drawn: bytes) -> bytes:
    lines = [_ANSWERS[each % len(_ANSWERS)] if each < 200 else chr(each) * 3 for each in drawn]
    return "\n".join(["Agilent Technologies,33220A,1,1", '+0,"x"', *lines, ""]).encode("latin1")


_VALUES: tuple[Any, ...] = (
           0, -1, 10**400, 2**63, 1e308, float("inf"), float("nan"), True, "", "mm", "1e999 mm", "-1 Hz",
           "1 mm^99", "1 m^-9 m^9", "1 " + "(" * 78, "5 \u00b2", "nan mm", [], [[]], {}, {"a": {}}, [{}],
           "impact_beam", "\0", "\ud7ff", 0.5, 100, "10 Hz", "1 N", "1 mm", "1 rpm", [1e400, -1])  # fmt: skip


@cache
def _table(path: Path) -> str:
    return json.dumps(read_toml(path.read_text(), path.name), default=str)


def _with_values(path: Path, drawn: bytes) -> bytes:
    """A file of the operator's in which some of our keys have values of any type, or stand elsewhere."""
    table = json.loads(_table(path))
    for step in _steps(drawn[:15], 3):
        places = [table, *(each for each in table.values() if isinstance(each, dict))]
        keys = sorted({key for each in places for key in each})
        places[step[0] % len(places)][keys[step[1] % len(keys)]] = _VALUES[step[2] % len(_VALUES)]
    return toml_of(table).encode("utf-8", "replace")


_BY_TARGET = {"modbus": _modbus, "can": _can, "sdo": _sdo, "scpi": _scpi}


def inputs(name: str) -> st.SearchStrategy[bytes]:
    """All ways to make an input of a target."""
    ways = [files(name)]
    if name in _BY_TARGET:
        ways.append(_DRAWN.map(_BY_TARGET[name]))
    if tables := [
        path for path in kept(name) if path.suffix == ".toml" and not path.name.startswith("crash")
    ]:
        ways.append(st.builds(_with_values, st.sampled_from(tables), _DRAWN))
    return st.one_of(ways)
