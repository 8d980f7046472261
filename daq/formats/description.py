"""What a recording is besides its numbers, as one JSON text that a format carries along.

Formats keep units, rates and names in their own way too, for other programs; this is for exactness. Whole
numbers stay whole (nanoseconds), and a float is written so that it reads back as itself.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from math import isfinite
from typing import Any, TypeVar, get_args

from daq.block import Flag
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.recording import Recording, Stretch, TimeBase, Track
from daq.log.reader import Origin
from daq.log.records import ClockRecord, Event, Gap

_Record = TypeVar("_Record", Event, Gap, ClockRecord)
_VERSION = 1
_WRONG = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
"""What taking a damaged text apart raises."""


@dataclass(frozen=True, slots=True)
class Described:
    """A channel as the description has it: what a `Track` is, without its samples."""

    origin: Origin
    channel: Channel
    stretches: tuple[Stretch, ...]
    wide: bool = False
    """True if its samples are float64."""

    @property
    def name(self) -> str:
        """Origin and name, as `Track.name`."""
        return f"{self.origin}/{self.channel.name}"


@dataclass(frozen=True, slots=True)
class Description:
    """A recording without its samples."""

    tracks: tuple[Described, ...]
    rest: Recording
    """Metadata, events, gaps and clocks; no tracks."""


def encode(recording: Recording, tracks: Sequence[Track] | None = None) -> str:
    """Describe a recording in one line of JSON, or only some `tracks` of it."""
    document = {
        "rattle": _VERSION,
        "tracks": [_track(track) for track in (recording.tracks if tracks is None else tracks)],
        "metadata": {name: dict(record) for name, record in recording.metadata.items()},
        "events": [astuple(event) for event in recording.events],
        "gaps": None if recording.gaps is None else [astuple(gap) for gap in recording.gaps],
        # JSON has no NaN; `float` reads its name
        "clocks": [
            [value if isinstance(value, int | str) or isfinite(value) else repr(value) for value in row]
            for row in map(astuple, recording.clocks)
        ],
    }
    return json.dumps(document, allow_nan=False, separators=(",", ":"))


def decode(text: str) -> Description:
    """Read a description; raises LogError if it is damaged."""
    try:
        document = json.loads(text)
        if document["rattle"] != _VERSION:
            raise LogError(f"its description is of version {document['rattle']}, not {_VERSION}")
        gaps = document["gaps"]
        rest = Recording(
            (),
            {str(name): _texts(record) for name, record in document["metadata"].items()},
            [_record(Event, row) for row in document["events"]],
            None if gaps is None else [_record(Gap, row) for row in gaps],
            [_record(ClockRecord, row) for row in document["clocks"]],
        )
        return Description(tuple(_described(each) for each in document["tracks"]), rest)
    except _WRONG as error:
        if isinstance(error, LogError):
            raise
        raise LogError(f"its description is damaged ({type(error).__name__}: {error})") from error


def _track(track: Track) -> dict[str, Any]:
    bases: list[TimeBase] = []
    for stretch in track.stretches:
        if stretch.base not in bases[-1:]:
            bases.append(stretch.base)
    place, rows = -1, []
    for stretch in track.stretches:
        place += stretch.base != (bases[place] if place >= 0 else None)
        rows.append([stretch.first_sample, stretch.count, place, int(stretch.flags)])
    return {
        "origin": track.origin,
        "name": track.channel.name,
        "channel": track.channel.metadata(),
        "wide": track.samples.dtype.itemsize == 8,
        "bases": [[base.sample, base.time_ns, base.sample_rate] for base in bases],
        "stretches": rows,
    }


def _described(track: Mapping[str, Any]) -> Described:
    if track["origin"] not in get_args(Origin):
        raise LogError(f"its description holds an origin {track['origin']!r}")
    bases = [TimeBase(_whole(a), _whole(b), float(c)) for a, b, c in track["bases"]]
    stretches = tuple(
        Stretch(_whole(first), _whole(count), bases[_whole(base)], Flag(_whole(flags) & 31))
        for first, count, base, flags in track["stretches"]
    )
    channel = Channel.from_metadata(_text(track["name"]), _texts(track["channel"]))
    return Described(track["origin"], channel, stretches, bool(track["wide"]))


def _record(kind: type[_Record], row: Sequence[Any]) -> _Record:
    """A record of the log from the list of its fields, each as its annotation wants it."""
    reads: dict[str, Callable[[Any], Any]] = {"int": _whole, "str": _text, "float": float}
    record = kind(*(reads[str(field.type)](value) for field, value in zip(fields(kind), row, strict=True)))
    if record.time_ns >= 1 << 63:
        raise ValueError(f"{record.time_ns} ns is no time that a log holds")
    return record


def _texts(record: Mapping[str, Any]) -> dict[str, str]:
    return {_text(key): _text(value) for key, value in record.items()}


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return value


def _whole(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value < 1 << 64:
        raise ValueError(f"{value!r} is no whole number that a log holds")
    return value
