"""What goes from the acquisition process to the view process: a header of names and a run of numbers."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import asdict
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.log.reader import Origin
from daq.log.records import Event, Impact

_LENGTHS = struct.Struct("<II")
_SINGLE = np.dtype(np.float32).itemsize


class BlockFrame(NamedTuple):
    """A block of one origin."""

    origin: Origin
    block: SampleBlock


class ShapeFrame(NamedTuple):
    """The twin's rig at one time (s): what `Truth.shape` tells of it, in m."""

    time_s: float
    points_m: NDArray[np.float32]


class DroppedFrame(NamedTuple):
    """How many frames the sender has thrown away so far."""

    frames: int


Frame = BlockFrame | ShapeFrame | DroppedFrame | Event | Impact


def encode_block(origin: Origin, block: SampleBlock) -> bytes:
    """Return the frame of a block; its values are copied, as single unless they are double."""
    kind = "<f8" if block.values.dtype.itemsize > _SINGLE else "<f4"
    header = {
        "kind": "block",
        "origin": origin,
        "channel": block.channel,
        "first": block.first_sample,
        "time": block.time_ns,
        "rate": block.sample_rate,
        "flags": int(block.flags),
        "type": kind,
    }
    return _frame(header, block.values.astype(kind, copy=False).tobytes())


def encode_shape(time_s: float, points_m: NDArray[np.floating]) -> bytes:
    """Return the frame of the twin's shape, points of any number of axes."""
    header = {"kind": "shape", "time": time_s, "dimensions": points_m.shape}
    return _frame(header, points_m.astype("<f4").tobytes())


def encode_event(event: Event) -> bytes:
    """Return the frame of an event."""
    return _frame({"kind": "event", "fields": asdict(event)})


def encode_impact(impact: Impact) -> bytes:
    """Return the frame of an impact."""
    return _frame({"kind": "impact", "fields": asdict(impact)})


def encode_dropped(count: int) -> bytes:
    """Return the frame that says how many frames were thrown away."""
    return _frame({"kind": "dropped", "frames": count})


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
            return BlockFrame(header["origin"], block)
        case "shape":
            points = np.frombuffer(values, "<f4").reshape(header["dimensions"])
            return ShapeFrame(header["time"], points)
        case "event":
            return Event(**header["fields"])
        case "impact":
            return Impact(**header["fields"])
        case _:
            return DroppedFrame(header["frames"])
