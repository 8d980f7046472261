"""What goes from the acquisition process to the view process: a header of names and a run of float32."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.block import Flag, SampleBlock
from daq.log.reader import Origin
from daq.log.records import Event

_LENGTHS = struct.Struct("<II")


class BlockFrame(NamedTuple):
    """A block of one origin."""

    origin: Origin
    block: SampleBlock


class ShapeFrame(NamedTuple):
    """The beam at one time (s): positions along it and deflections, both in m, shape (n,)."""

    time_s: float
    positions_m: NDArray[np.float32]
    deflection_m: NDArray[np.float32]


class DroppedFrame(NamedTuple):
    """How many frames the sender has thrown away so far."""

    frames: int


Frame = BlockFrame | ShapeFrame | DroppedFrame | Event


def encode_block(origin: Origin, block: SampleBlock) -> bytes:
    """Return the frame of a block; its values are copied."""
    header = {
        "kind": "block",
        "origin": origin,
        "channel": block.channel,
        "first": block.first_sample,
        "time": block.time_ns,
        "rate": block.sample_rate,
        "flags": int(block.flags),
    }
    return _frame(header, block.values.astype("<f4", copy=False).tobytes())


def encode_shape(
    time_s: float, positions_m: NDArray[np.floating], deflection_m: NDArray[np.floating]
) -> bytes:
    """Return the frame of a deflected beam."""
    values = np.concatenate((positions_m, deflection_m)).astype("<f4")
    return _frame({"kind": "shape", "time": time_s}, values.tobytes())


def encode_event(event: Event) -> bytes:
    """Return the frame of an event."""
    return _frame(
        {
            "kind": "event",
            "time": event.time_ns,
            "level": event.level,
            "source": event.source,
            "code": event.code,
            "text": event.text,
        }
    )


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
        yield _decode(json.loads(body[value_bytes:]), np.frombuffer(body, "<f4", count=value_bytes // 4))


def _frame(header: dict[str, str | int | float], values: bytes = b"") -> bytes:
    text = json.dumps(header).encode()
    return _LENGTHS.pack(len(values), len(text)) + values + text


def _decode(header: dict[str, Any], values: NDArray[np.float32]) -> Frame:
    match header["kind"]:
        case "block":
            block = SampleBlock(
                header["channel"],
                header["first"],
                header["time"],
                header["rate"],
                values,
                Flag(header["flags"]),
            )
            return BlockFrame(header["origin"], block)
        case "shape":
            half = len(values) // 2
            return ShapeFrame(header["time"], values[:half], values[half:])
        case "event":
            return Event(header["time"], header["level"], header["source"], header["code"], header["text"])
        case _:
            return DroppedFrame(header["frames"])
