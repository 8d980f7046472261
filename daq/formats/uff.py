"""Universal files (UFF, .unv): one binary dataset 58 for every unbroken part of a channel.

The increment of a dataset has six digits, which is 2 ms off after a quarter of an hour. So ID lines 2, 4 and
5 carry rate, start, index and metadata, as `key=value&...`; of a file that has no such lines the rate is an
interval.
"""

from __future__ import annotations

import datetime
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args
from urllib.parse import parse_qsl, urlencode

from daq.block import NS_PER_S, Flag
from daq.channel import Channel
from daq.errors import LogError
from daq.formats.contents import (
    Column,
    Contents,
    FileFormat,
    StatedRate,
    described_column,
    new_file,
    readable,
    time_axis,
)
from daq.formats.dataset_58 import (
    HEADER,
    ID_WIDTH,
    LABEL_WIDTH,
    TIME_RESPONSE,
    FoundFunction,
    Function,
    end,
    functions,
    header,
    run_header,
)
from daq.formats.description import Described
from daq.formats.recording import Recording, Stretch, TimeBase, Track
from daq.formats.samples import CHUNK, Pieces, Samples, Scratch
from daq.log.reader import Origin

_MARK = "rattle"
_KINDS = {"N": 13, "m/s2": 12, "m/s": 11, "m": 8, "Pa": 15}
"""Specific data types of record 9 by unit; any other is 0, unknown."""
_TIME_KINDS = (0, TIME_RESPONSE)
_DIGITS_AFTER_POINT = 5
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write(recording: Recording, path: Path, warn: Callable[[str], None]) -> tuple[Path, ...]:
    """Write the file; warns of what it cannot hold. Raises RattleError."""
    warn("uff holds no events, clock records, causes of gaps, nor the scenario: import needs --scenario")
    if recording.impacts:
        warn(f"uff holds no impacts: {len(recording.impacts)} of /impact left out")
    empty = [track.name for track in recording.tracks if not track.stretches]
    if empty:
        warn(f"uff holds no channel without samples: {', '.join(empty)} left out")
    for track in recording.tracks:
        if len({stretch.flags for stretch in track.stretches}) > 1:
            warn(f"{track.name}: uff flags a whole unbroken part, not the blocks within it")
    with new_file(path) as file:
        starts = [track.stretches[0].time_ns for track in recording.tracks if track.stretches]
        file.write(run_header(_plain(recording.run_id, ID_WIDTH), _date(min(starts, default=0))))
        for node, track in enumerate(recording.tracks, start=1):
            said: set[str] = set()
            for part in unbroken(track):
                function = _function(recording, track, node, part, said.add)
                file.write(header(function, track.samples.dtype))
                for first in range(part.first_sample, part.end_sample, CHUNK):
                    stop = min(first + CHUNK, part.end_sample)
                    values = track.samples.read(first - track.first_sample, stop - track.first_sample)
                    file.write(values.astype(values.dtype.newbyteorder("<"), copy=False).tobytes())
                file.write(end())
            for text in said:
                warn(text)
    return (path,)


def unbroken(track: Track) -> Iterator[Stretch]:
    """Stretches of a channel joined where only flags change."""
    joined: Stretch | None = None
    for each in track.stretches:
        if joined is not None and (joined.end_sample, joined.base) == (each.first_sample, each.base):
            joined = Stretch(
                joined.first_sample, joined.count + each.count, joined.base, joined.flags | each.flags
            )
            continue
        if joined is not None:
            yield joined
        joined = each
    if joined is not None:
        yield joined


def _function(
    recording: Recording, track: Track, node: int, part: Stretch, warn: Callable[[str], None]
) -> Function:
    first, second, third = _own_lines(track, part, warn)
    name = _plain(track.channel.name, ID_WIDTH)
    return Function(
        (name, first, _date(part.time_ns), second, third),
        TIME_RESPONSE,
        node,
        part.count,
        part.first_sample / part.base.sample_rate,
        1 / part.base.sample_rate,
        _KINDS.get(track.channel.unit, 0),
        _plain(track.channel.quantity, LABEL_WIDTH),
        _plain(track.channel.unit, LABEL_WIDTH),
    )


def _own_lines(track: Track, part: Stretch, warn: Callable[[str], None]) -> tuple[str, str, str]:
    """ID lines 2, 4 and 5: what dataset 58 has no field for."""
    fields = {
        _MARK: "1",
        "origin": track.origin,
        "rate": repr(part.base.sample_rate),
        "ns": str(part.time_ns),
        "first": str(part.first_sample),
        "flags": str(int(part.flags)),
        "name": track.channel.name,
        **track.channel.metadata(),
    }
    # what its own field holds as it is need not be said twice
    for key, width in (("name", ID_WIDTH), ("unit", LABEL_WIDTH)):
        if fields[key] == _plain(fields[key], width):
            del fields[key]
    lost = []
    while len(text := urlencode(fields)) > 3 * ID_WIDTH:
        lost.append(fields.popitem()[0])
    if lost:
        warn(f"{track.name}: too long for the ID lines of uff and left out: {', '.join(lost)}")
    return text[:ID_WIDTH], text[ID_WIDTH : 2 * ID_WIDTH], text[2 * ID_WIDTH :]


def _plain(text: str, width: int) -> str:
    """A text as a field of so many ASCII characters holds it."""
    printable = (c if " " <= c <= "~" else "?" for c in " ".join(text.split()))
    return "".join(printable)[:width]


def _date(time_ns: int) -> str:
    moment = datetime.datetime.fromtimestamp(time_ns // NS_PER_S, datetime.UTC)
    # not %b, which speaks the language of the machine
    return f"{moment:%d}-{_MONTHS[moment.month - 1]}-{moment:%y} {moment:%H:%M:%S}"


def read(path: Path, scratch: Scratch) -> Contents:
    """Read the time records of a universal file; raises LogError."""
    parts: dict[tuple[str, str], list[_Part]] = {}
    columns: list[Column] = []
    notes: list[str] = []
    with readable(path):
        for found in functions(scratch.hold(path.open("rb")), scratch):
            if isinstance(found, int):
                if found != HEADER:
                    notes.append(f"left out: a dataset {found}, which is no time record")
            elif found.function.kind not in _TIME_KINDS or not found.is_real:
                notes.append(f"left out: {found.function.id_lines[0]}, which is no real function of time")
            elif (part := _part(found)) is not None:
                parts.setdefault((part.origin, part.channel.name), []).append(part)
            else:
                columns.append(_foreign(found))
        columns = _named_apart(columns)
        for each in parts.values():
            each.sort(key=lambda part: part.stretch.first_sample)
            stretches = tuple(part.stretch for part in each)
            start = stretches[0].first_sample
            samples = Pieces([(part.stretch.first_sample - start, part.samples) for part in each])
            columns.append(described_column(Described(each[0].origin, each[0].channel, stretches), samples))
        if not columns and not notes:
            raise LogError("it holds no dataset")
    return Contents(tuple(columns), notes=notes)


@dataclass(frozen=True, slots=True)
class _Part:
    """One dataset that rattle wrote."""

    origin: Origin
    channel: Channel
    stretch: Stretch
    samples: Samples


def _part(found: FoundFunction) -> _Part | None:
    """What rattle wrote into the ID lines besides; None if another program wrote the dataset."""
    text = "".join(found.function.id_lines[at] for at in (1, 3, 4))
    fields = dict(parse_qsl(text, keep_blank_values=True)) if text.startswith(f"{_MARK}=") else {}
    if fields.get(_MARK) != "1":
        return None
    channel = Channel.from_metadata(
        fields.get("name", found.function.id_lines[0]), {"unit": found.function.unit, **fields}
    )
    origin: Origin = get_args(Origin)[get_args(Origin).index(fields["origin"])]
    first = int(fields["first"])
    base = TimeBase(first, int(fields["ns"]), float(fields["rate"]))
    stretch = Stretch(first, found.function.count, base, Flag(int(fields["flags"]) & 31))
    return _Part(origin, channel, stretch, found.values)


def _foreign(found: FoundFunction) -> Column:
    function = found.function
    if found.abscissa is None:
        # Six digits of an increment leave the rate open by half a unit of the last one.
        increment, rate, start_s = function.abscissa_increment, None, function.abscissa_min
        if increment:
            half_unit = 0.5 * 10.0 ** (math.floor(math.log10(abs(increment))) - _DIGITS_AFTER_POINT)
            rate = StatedRate.of_increment(increment, half_unit)
    else:
        axis = time_axis(found.abscissa)
        rate, start_s = axis.rate, axis.start_s
    return Column(
        function.id_lines[0],
        Pieces([(0, found.values)]),
        unit=function.unit or None,
        rate=rate,
        start_s=start_s,
    )


def _named_apart(columns: Sequence[Column]) -> list[Column]:
    """Many programs write one and the same ID line 1 into every dataset: these get a number behind it."""
    counts = Counter(column.name for column in columns)
    numbers: Counter[str] = Counter()
    named = []
    for column in columns:
        numbers[column.name] += 1
        name = f"{column.name} {numbers[column.name]}" if counts[column.name] > 1 else column.name
        named.append(replace(column, name=name))
    return named


FORMAT = FileFormat("uff", (".uff", ".unv", ".uf", ".u58"), read, write)
