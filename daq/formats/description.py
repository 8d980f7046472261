"""What a recording is besides its numbers, as one JSON text that a format carries along.

Formats keep units, rates and names in their own way too, for other programs; this is for exactness. Whole
numbers stay whole (nanoseconds), and a float is written so that it reads back as itself.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from daq.block import Flag
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.recording import Recording, Stretch, TimeBase, Track
from daq.log.reader import Origin
from daq.log.records import ClockRecord, Event, Gap

_VERSION = 1
_WRONG = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
"""What taking a damaged text apart raises."""


@dataclasses.dataclass(frozen=True, slots=True)
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


@dataclasses.dataclass(frozen=True, slots=True)
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
        "events": [dataclasses.astuple(event) for event in recording.events],
        "gaps": None if recording.gaps is None else [dataclasses.astuple(gap) for gap in recording.gaps],
        "clocks": [[_number(value) for value in dataclasses.astuple(clock)] for clock in recording.clocks],
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
            [_event(row) for row in document["events"]],
            None if gaps is None else [_gap(row) for row in gaps],
            [_clock(row) for row in document["clocks"]],
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


def _event(row: Sequence[Any]) -> Event:
    time_ns, *texts = row
    return Event(_time(time_ns), *(_text(each) for each in texts))


def _gap(row: Sequence[Any]) -> Gap:
    time_ns, channel, first, count, cause = row
    return Gap(_time(time_ns), _text(channel), _whole(first), _whole(count), _text(cause))


def _clock(row: Sequence[Any]) -> ClockRecord:
    time_ns, device, *numbers = row
    return ClockRecord(_time(time_ns), _text(device), *(float(each) for each in numbers))


def _number(value: Any) -> Any:
    """JSON has no NaN; `float` reads its name."""
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


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


def _time(value: Any) -> int:
    if _whole(value) >= 1 << 63:
        raise ValueError(f"{value} ns is no time that a log holds")
    return int(value)
