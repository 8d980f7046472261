"""MAT files of version 5: one struct a channel, `rattle` with the description.

Read by MATLAB (`load`), Octave and scipy. A variable holds at most 2 GB: 537 million samples of float32, near
three hours at 51.2 kHz. The whole file may be larger. One channel at a time is in memory.
"""

from __future__ import annotations

import itertools
import math
import os
import re
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.io
from numpy.typing import NDArray

from daq.allowance import Allowance
from daq.errors import LogError, RattleError
from daq.formats import description
from daq.formats.arrays import Arrays, vector
from daq.formats.contents import Contents, FileFormat, Warn, described_contents, new_file, opened
from daq.formats.recording import Recording, Track
from daq.formats.samples import Samples, Scratch
from daq.formats.tables import KINDS, TABLE, columns_of, impacts_of

_MOST_BYTES = (1 << 31) - (1 << 16)
_LONGEST_NAME = 63
_MARK = "rattle"
_DESCRIPTION = "description"
_HEAD_BYTES, _ORDER, _TAG_BYTES, _COMPRESSED = 128, 126, 8, 15
_PIECE = 1 << 20
_DOUBLE = 8
_TOGETHER, _TOGETHER_BYTES = 256, 64 << 20
"""Variables that are in memory at once, where they are of one length."""
_HEAD_READ = 8 << 10
"""Bytes unpacked in the time that the head of a variable takes, some 10 us."""
_HDF5_MAGIC, _HDF5_AT = b"\x89HDF\r\n\x1a\n", 512
_NUMBERS = (
    "double",
    "single",
    "int8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
    "logical",
)


def write(recording: Recording, path: Path, warn: Warn) -> tuple[Path, ...]:
    """Write the file; raises RattleError where a channel is too long for a variable."""
    for track in recording.tracks:
        if len(track.samples) * track.samples.dtype.itemsize > _MOST_BYTES:
            raise RattleError(f"{track.name}: more than the 2 GB that mat holds of a channel; use tdms")
        if strays := track.strays():
            warn(f"{strays}, which other programs see")
    with new_file(path) as file:
        _append(file, _MARK, {_DESCRIPTION: description.encode(recording), "version": "1"})
        names = variable_names(track.name for track in recording.tracks)
        for name, track in zip(names, recording.tracks, strict=True):
            _append(file, name, _struct(track))
        if recording.impacts:
            kinds: dict[type, Any] = {int: np.int64, float: np.float64, str: object}  # texts: a cell array
            columns = columns_of(recording.impacts)
            impacts = {name: np.array(columns[name], kinds[kind]) for name, kind in KINDS.items()}
            _append(file, TABLE, impacts)
    return (path,)


def _append(file: Any, name: str, fields: dict[str, Any]) -> None:
    """One variable more: scipy writes the head of the file only at its beginning."""
    scipy.io.savemat(file, {name: fields}, long_field_names=True, oned_as="column")


def variable_names(names: Iterable[str]) -> list[str]:
    """MATLAB's names of these channels, each another: `measured_contact_force_upper`."""
    taken = [_MARK, TABLE]
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:_LONGEST_NAME]
        numbered = (f"{plain[: _LONGEST_NAME - 5]}_{number}" for number in itertools.count(2))
        taken.append(next(each for each in itertools.chain([plain], numbered) if each not in taken))
    return taken[2:]


def _struct(track: Track) -> dict[str, Any]:
    channel = track.channel
    fields: dict[str, Any] = {"origin": track.origin, "name": channel.name, "unit": channel.unit}
    for key in ("quantity", "location", "sensor", "serial", "raw_unit"):
        fields[key] = getattr(channel, key)
    fields["scale"] = np.nan if channel.scale is None else channel.scale
    if track.stretches:
        base = track.stretches[0].base
        fields |= {
            "sample_rate": base.sample_rate,
            "start_unix_ns": np.int64(track.stretches[0].time_ns),
            "first_sample": np.int64(track.first_sample),
        }
    fields["gaps"] = np.array(track.gaps(), np.int64).reshape(-1, 2)
    fields["flags"] = np.array(
        [(each.first_sample, each.count, int(each.flags)) for each in track.stretches], np.int64
    ).reshape(-1, 3)
    fields["values"] = track.samples.read(0, len(track.samples))
    return fields


def read(path: Path, scratch: Scratch) -> Contents:
    """Read structs that rattle wrote, or the vectors of any program; raises LogError."""
    with opened(path) as file:
        start = file.read(_HDF5_AT + len(_HDF5_MAGIC))  # MATLAB puts 512 bytes of its own before an HDF5 file
        if start.startswith(_HDF5_MAGIC) or start.endswith(_HDF5_MAGIC):
            raise LogError("a MAT file of version 7.3 is not read; save it with -v7")
        allowance = Allowance(path, file.fileno())
        total = os.fstat(file.fileno()).st_size
        if 0 not in start[:4]:  # version 4 compresses nothing
            total += _check_unpacked(file, start[_ORDER : _ORDER + 1] == b"I", allowance)
        variables = scipy.io.whosmat(_rewound(file))
        names = [name for name, _, _ in variables]
        if _MARK in names:
            ours = [name for name, shape, kind in variables if (kind, shape) == ("struct", (1, 1))]
            return _described(_loaded(file, ours, total, allowance), scratch)
        arrays, plain = Arrays(scratch), list[str]()
        for name, shape, kind in variables:
            if kind in _NUMBERS or kind == "char":
                allowance.spend(held=_DOUBLE * math.prod(shape))
                plain.append(name)
            else:
                arrays.notes.append(f"left out: {name}, a {kind} of {' x '.join(map(str, shape))}")
        for name, array in _loaded(file, plain, total, allowance):
            arrays.add(name, array)
        return arrays.contents()


def _check_unpacked(file: BinaryIO, little_endian: bool, allowance: Allowance) -> int:
    """Unpack every variable once, in pieces: how large a struct becomes, nothing in the file says."""
    total = 0
    file.seek(_HEAD_BYTES)
    while len(tag := file.read(_TAG_BYTES)) == _TAG_BYTES:
        kind, length = struct.unpack("<II" if little_endian else ">II", tag)
        following = file.tell() + length
        unpacking = zlib.decompressobj()
        while kind == _COMPRESSED and not unpacking.eof and file.tell() < following:
            packed = file.read(min(_PIECE, following - file.tell()))
            if not packed:
                return total
            while packed:
                allowance.spend(held=(size := len(unpacking.decompress(packed, _PIECE))))
                total += size
                packed = unpacking.unconsumed_tail
        file.seek(following)
    return total


def _rewound(file: Any) -> Any:
    file.seek(0)
    return file


def _loaded(
    file: BinaryIO, names: Sequence[str], total: int, allowance: Allowance
) -> Iterator[tuple[str, Any]]:
    """Variables, short ones many at once: scipy goes over the heads of all whenever it loads some."""
    most = min(max(_TOGETHER_BYTES * len(names) // total, 1), _TOGETHER)
    for begin in range(0, len(names), most):
        allowance.spend(unpacked=_HEAD_READ * len(names))
        group = list(names[begin : begin + most])
        found = scipy.io.loadmat(_rewound(file), variable_names=group)
        for name in group:
            if name not in found:
                raise LogError(f"its variable {name} cannot be read")
            yield name, found.pop(name)


def _text(array: NDArray[Any]) -> str:
    return str(array.item()) if array.size else ""


def _described(variables: Iterable[tuple[str, Any]], scratch: Scratch) -> Contents:
    found: dict[str, Samples] = {}
    text, table = "", None
    for name, variable in variables:
        if name == _MARK:
            text = _text(variable[0, 0][_DESCRIPTION])
        elif name == TABLE:
            table = variable
        elif {"origin", "name", "values"} <= set(variable.dtype.names or ()):  # else somebody's own
            fields = variable[0, 0]
            track = f"{_text(fields['origin'])}/{_text(fields['name'])}"
            found[track] = scratch.keep(vector(fields["values"], name))
    contents = described_contents(description.decode(text), found)
    if table is None:
        return contents
    columns = {
        name: [
            str(cell.item()) if table[0, 0][name].dtype == object else cell for cell in table[0, 0][name].flat
        ]
        for name in table.dtype.names or ()
    }
    return replace(contents, rest=replace(contents.rest, impacts=impacts_of(columns)))


FORMAT = FileFormat("mat", (".mat",), read, write)
