"""MAT files of version 5: one struct a channel, `rattle` with the description.

Read by MATLAB (`load`), Octave and scipy. A variable holds at most 2 GB: 537 million samples of float32, near
three hours at 51.2 kHz. The whole file may be larger. One channel at a time is in memory.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from daq.allowance import MOST_COLUMNS, Allowance
from daq.errors import LogError, RattleError
from daq.formats import description
from daq.formats.arrays import Arrays, vector
from daq.formats.contents import Contents, FileFormat, Warn, described_contents, new_file, opened
from daq.formats.mat_variables import Variable, variables
from daq.formats.recording import Recording, Track
from daq.formats.samples import Samples, Scratch
from daq.formats.tables import KINDS, TABLE, columns_of, impacts_of

_MOST_BYTES = (1 << 31) - (1 << 16)
_LONGEST_NAME = 63
_MARK = "rattle"
_DESCRIPTION = "description"
_HDF5_MAGIC, _HDF5_AT = b"\x89HDF\r\n\x1a\n", 512


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
        found = list(islice(variables(file.fileno(), Allowance(path, file.fileno())), MOST_COLUMNS + 1))
        if len(found) > MOST_COLUMNS:
            raise LogError(f"its variables are more than the {MOST_COLUMNS} that are read")
        if any(each.name == _MARK for each in found):
            return _described(found, scratch)
        arrays = Arrays(scratch)
        for each in found:
            if each.kind in ("number", "char"):
                arrays.add(each.name, each.read())
            else:
                shape = f" of {' x '.join(map(str, each.shape))}" if each.shape else ""
                arrays.notes.append(f"left out: {each.name}, a {each.kind}{shape}")
        return arrays.contents()


def _text(array: NDArray[Any]) -> str:
    return str(array.item()) if array.size else ""


def _described(found: Sequence[Variable], scratch: Scratch) -> Contents:
    samples: dict[str, Samples] = {}
    text, table = "", None
    for each in found:
        fields = each.read() if each.kind == "struct" else None
        if fields is None:
            continue  # somebody's own
        if each.name == _MARK:
            text = _text(fields[_DESCRIPTION])
        elif each.name == TABLE:
            table = fields
        elif {"origin", "name", "values"} <= fields.keys():
            track = f"{_text(fields['origin'])}/{_text(fields['name'])}"
            samples[track] = scratch.keep(vector(fields["values"], each.name))
    contents = described_contents(description.decode(text), samples)
    if table is None:
        return contents
    columns = {
        name: [_text(cell) for cell in column] if isinstance(column, list) else column.flat
        for name, column in table.items()
    }
    return replace(contents, rest=replace(contents.rest, impacts=impacts_of(columns)))


FORMAT = FileFormat("mat", (".mat",), read, write)
