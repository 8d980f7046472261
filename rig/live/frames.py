"""What goes from the acquisition process to the view process: a header of names and a run of numbers."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import asdict
from typing import IO, Any, NamedTuple

import numpy as np

from daq.block import Flag, SampleBlock
from daq.log.records import Event, Impact
from rig.stream import Block, Record, Shape

_LENGTHS = struct.Struct("<II")
_SINGLE = np.dtype(np.float32).itemsize


class Dropped(NamedTuple):
    """How many records the sender has thrown away so far."""

    records: int


Frame = Block | Shape | Event | Impact | Dropped


def encode(record: Record | Dropped) -> bytes:
    """Return the frame of a record, its values copied; empty for a record that no view shows.

    Samples travel as single unless they are double, the points of a shape as single.
    """
    match record:
        case Block(origin, samples):
            kind = "<f8" if samples.values.dtype.itemsize > _SINGLE else "<f4"
            header: dict[str, Any] = {
                "kind": "block",
                "origin": origin,
                "channel": samples.channel,
                "first": samples.first_sample,
                "time": samples.time_ns,
                "rate": samples.sample_rate,
                "flags": int(samples.flags),
                "type": kind,
            }
            return _frame(header, samples.values.astype(kind, copy=False).tobytes())
        case Shape(time_s, points_m):
            header = {"kind": "shape", "time": time_s, "dimensions": points_m.shape}
            return _frame(header, points_m.astype("<f4").tobytes())
        case Event():
            return _frame({"kind": "event", "fields": asdict(record)})
        case Impact():
            return _frame({"kind": "impact", "fields": asdict(record)})
        case Dropped(records):
            return _frame({"kind": "dropped", "records": records})
        case _:
            return b""


def read_frames(stream: IO[bytes]) -> Iterator[Frame]:
    """Decode frames until the stream ends, also in the middle of one (the sender is gone)."""
    while len(lengths := stream.read(_LENGTHS.size)) == _LENGTHS.size:
        value_bytes, header_bytes = _LENGTHS.unpack(lengths)
        body = stream.read(value_bytes + header_bytes)
        if len(body) < value_bytes + header_bytes:
            return
        yield _decode(json.loads(body[value_bytes:]), body[:value_bytes])


def _frame(header: dict[str, Any], values: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    return _LENGTHS.pack(len(values), len(text)) + values + text


def _decode(header: dict[str, Any], values: bytes) -> Frame:
    match header["kind"]:
        case "block":
            block = SampleBlock(
                header["channel"],
                header["first"],
                header["time"],
                header["rate"],
                np.frombuffer(values, header["type"]),
                Flag(header["flags"]),
            )
            return Block(header["origin"], block)
        case "shape":
            points = np.frombuffer(values, "<f4").reshape(header["dimensions"])
            return Shape(header["time"], points)
        case "event":
            return Event(**header["fields"])
        case "impact":
            return Impact(**header["fields"])
        case _:
            return Dropped(header["records"])
