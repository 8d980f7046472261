"""TDMS: one group for measured, one for predicted, each channel one waveform with NaN in its gaps.

A channel's samples lie together, as LabVIEW leaves a file that it has defragmented. Time stamps hold 2^-64 s,
so the nanosecond survives; `wf_increment` is a double.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, get_args

import numpy as np
from nptdms import ChannelObject, RootObject, TdmsFile, TdmsWriter
from nptdms.log import log_manager
from nptdms.reader import TdmsReader
from nptdms.timestamp import TdmsTimestamp
from numpy.typing import NDArray

from daq.allowance import Allowance
from daq.block import NS_PER_S
from daq.errors import LogError
from daq.formats import description
from daq.formats.contents import (
    Column,
    Contents,
    FileFormat,
    StatedRate,
    Warn,
    described_contents,
    new_file,
    readable,
)
from daq.formats.recording import Recording, Track
from daq.formats.samples import Samples, Scratch, precision
from daq.formats.tables import KINDS, TABLE, columns_of, impacts_of
from daq.log.reader import Origin

log_manager.set_level(logging.CRITICAL)  # else bytes of a stranger's file go to standard error

_UNIX_EPOCH_S = 2_082_844_800
"""From the epoch of TDMS, 1904-01-01, to 1970-01-01 (66 years, 17 of them leap years)."""
_FRACTIONS = 1 << 64
_SEGMENT = 1 << 22
_MARK = "rattle"
_ULPS = 4
"""An increment is a rounded 1/rate, and somebody may have rounded it once more on the way."""


def write(recording: Recording, path: Path, warn: Warn) -> tuple[Path, ...]:
    """Write the file; raises RattleError."""
    for track in recording.tracks:
        if strays := track.strays():
            warn(f"{strays}, which are all that a waveform has")
    root = {
        "name": recording.run_id or path.stem,
        "description": "recorded by rattle; NaN where samples are missing",
        _MARK: description.encode(recording),
    }
    with new_file(path) as file, TdmsWriter(file) as tdms:
        tdms.write_segment([RootObject(root)])
        for track in recording.tracks:
            properties: dict[str, Any] | None = _properties(track)
            for start in range(0, max(len(track.samples), 1), _SEGMENT):
                values = track.samples.read(start, min(start + _SEGMENT, len(track.samples)))
                tdms.write_segment([ChannelObject(track.origin, track.channel.name, values, properties)])
                properties = None
        if recording.impacts:
            columns = columns_of(recording.impacts)
            kinds: dict[type, Any] = {int: np.int64, float: np.float64, str: str}
            typed = {name: np.array(columns[name], kinds[kind]) for name, kind in KINDS.items()}
            tdms.write_segment([ChannelObject(TABLE, name, values) for name, values in typed.items()])
    return (path,)


def _properties(track: Track) -> dict[str, Any]:
    texts = {key: text for key, text in track.channel.metadata().items() if key != "unit"}
    waveform: dict[str, Any] = {"unit_string": track.channel.unit, "NI_ChannelName": track.channel.name}
    if track.stretches:
        first = track.stretches[0]
        seconds, nanoseconds = divmod(first.time_ns, NS_PER_S)
        # a thousandth of a nanosecond late, so that a reader that cuts off has the same nanosecond
        fractions = (nanoseconds * 1000 + 1) * _FRACTIONS // (1000 * NS_PER_S)
        waveform |= {
            "wf_start_time": TdmsTimestamp(seconds + _UNIX_EPOCH_S, fractions),
            "wf_start_offset": 0.0,
            "wf_increment": 1 / first.base.sample_rate,
            "wf_samples": len(track.samples),
            "sample_rate": first.base.sample_rate,
            "first_sample": track.first_sample,
        }
    return waveform | texts


def read(path: Path, scratch: Scratch) -> Contents:
    """Read the channels of a TDMS file; raises LogError."""
    with readable(path):
        # opened here: the package leaves a file that it cannot read open
        file = scratch.hold(path.open("rb"))
        _Metered(file, Allowance(path, file.fileno())).read_metadata()
        file.seek(0)
        tdms = TdmsFile.open(file, raw_timestamps=True)
        if tdms.file_status.incomplete_final_segment:
            raise LogError("its last segment is cut short")
        if not tdms.groups() and not tdms.properties:
            raise LogError("it holds nothing")
        if _MARK not in tdms.properties:
            return _foreign(tdms)
        groups = {group.name: group for group in tdms.groups()}
        found: dict[str, Samples] = {
            f"{name}/{channel.name}": _InTdms(channel)
            for name, group in groups.items()
            if name != TABLE
            for channel in group.channels()
        }
        contents = described_contents(description.decode(str(tdms.properties[_MARK])), found)
        if TABLE not in groups:
            return contents
        impacts = impacts_of({channel.name: channel[:] for channel in groups[TABLE].channels()})
        return replace(contents, rest=replace(contents.rest, impacts=impacts))


class _Metered(TdmsReader):  # type: ignore[misc]
    """Pays for the objects of every segment, each of which has those of the one before it anew."""

    def __init__(self, file: BinaryIO, allowance: Allowance) -> None:
        super().__init__(file)
        self._allowance = allowance

    def _update_object_metadata(self, segment: Any) -> None:
        self._allowance.spend(records=len(segment.ordered_objects))
        super()._update_object_metadata(segment)


@dataclass(frozen=True, slots=True)
class _InTdms:
    """Samples of a channel, read where they are asked for."""

    channel: Any

    @property
    def dtype(self) -> np.dtype[Any]:
        return precision(np.dtype(self.channel.dtype))

    def __len__(self) -> int:
        return len(self.channel)

    def read(self, start: int, stop: int) -> NDArray[np.floating]:
        """Read from the file; raises LogError."""
        with readable(Path(self.channel.name)):
            values = np.asarray(self.channel.read_data(start, stop - start))
            if len(values) != stop - start:
                raise LogError(f"{len(values)} of {stop - start} samples are there")
            return values.astype(self.dtype)


def _foreign(tdms: TdmsFile) -> Contents:
    groups = [group for group in tdms.groups() if group.channels()]
    several = len([group for group in groups if group.name not in get_args(Origin)]) > 1
    columns, notes = [], []
    for group in groups:
        for channel in group.channels():
            name = f"{group.name}/{channel.name}" if several else channel.name
            if np.dtype(channel.dtype).kind in "fiub":
                columns.append(_column(name, group.name, channel))
            else:
                notes.append(f"left out: {name}, which holds no real numbers")
    return Contents(tuple(columns), notes=notes)


def _column(name: str, group: str, channel: Any) -> Column:
    properties: Mapping[str, Any] = channel.properties
    increment = float(properties.get("wf_increment", 0.0))
    start_s = float(properties.get("wf_start_offset", 0.0))
    stamp, start_ns = properties.get("wf_start_time"), None
    # a waveform that nobody gave a start has 1904
    if isinstance(stamp, TdmsTimestamp) and stamp.seconds > 0:
        nanoseconds = (int(stamp.second_fractions) * NS_PER_S + _FRACTIONS // 2) // _FRACTIONS
        start_ns = (int(stamp.seconds) - _UNIX_EPOCH_S) * NS_PER_S + nanoseconds + round(start_s * NS_PER_S)
    return Column(
        name,
        _InTdms(channel),
        next((origin for origin in get_args(Origin) if origin == group), "measured"),
        unit=str(properties.get("unit_string") or properties.get("NI_UnitDescription") or "") or None,
        rate=StatedRate.of_increment(increment, _ULPS * float(np.spacing(increment))) if increment else None,
        start_ns=start_ns,
        start_s=start_s,
    )


FORMAT = FileFormat("tdms", (".tdms",), read, write)
