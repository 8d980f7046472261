"""Between the nouns and the protobuf messages of the log."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from google.protobuf.message import DecodeError
from google.protobuf.unknown_fields import UnknownFieldSet
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag, SampleBlock
from daq.errors import LogError
from daq.log import schema
from daq.log.records import ClockRecord, Event, Gap, Impact

_NOT_WIDE = np.empty(0)
_Record = TypeVar("_Record", Event, Gap, ClockRecord, Impact)
_MESSAGES: dict[type, Any] = {
    Event: schema.EventMessage,
    Gap: schema.GapMessage,
    ClockRecord: schema.ClockMessage,
    Impact: schema.ImpactMessage,
}
_NAMES = {kind: tuple(field.name for field in fields(kind) if field.name != "time_ns") for kind in _MESSAGES}


def encode_block(block: SampleBlock) -> bytes:
    """Encode a block: float32 values travel as `values`, float64 values as `wide`."""
    message = schema.FastSampleBlockMessage(
        first_sample=block.first_sample, sample_rate=block.sample_rate, flags=int(block.flags)
    )
    _stamp(message, block.time_ns)
    if block.values.dtype == np.float64:
        message.wide = block.values.astype("<f8", copy=False).tobytes()
    else:
        message.values = block.values.astype("<f4", copy=False).tobytes()
    if len(block):
        values = np.asarray(block.values, dtype=np.float64)
        message.minimum, message.maximum = float(values.min()), float(values.max())
        message.rms = float(np.sqrt(np.mean(np.square(values))))
    return bytes(message.SerializeToString())


def decode_block(channel: str, data: bytes) -> SampleBlock:
    """Decode a block written by any program to the format; float64 values if it came as `wide`."""
    message = _parsed(schema.FastSampleBlockMessage, data)
    # ByteSize() counts unknown fields too, so fixed32 `values` (unpacked) would slip through.
    if message.ByteSize() == len(data) and not len(UnknownFieldSet(message)):
        values = _array(message.values, "<f4")
        wide = _array(message.wide, "<f8") if message.wide else _NOT_WIDE
    else:
        # Unpacked or split arrays are legal protobuf, which the `bytes` declaration cannot see.
        message = _parsed(schema.SampleBlockMessage, data)
        values = np.asarray(message.values, dtype=np.float32)
        wide = np.asarray(message.wide, dtype=np.float64)
    if not 0 < message.sample_rate < math.inf:
        raise LogError(f"a block of {channel} has a sample rate of {message.sample_rate:g} Hz")
    return SampleBlock(
        channel=channel,
        first_sample=message.first_sample,
        time_ns=_time_ns(message),
        sample_rate=message.sample_rate,
        values=wide if len(wide) else values,
        flags=Flag(message.flags & 31) if message.flags else Flag.GOOD,
    )


def encode_record(record: Event | Gap | ClockRecord | Impact) -> bytes:
    """Encode what a log holds besides samples; a message's fields have the names of the record's."""
    names = _NAMES[type(record)]
    message = _MESSAGES[type(record)](**{name: getattr(record, name) for name in names})
    _stamp(message, record.time_ns)
    return bytes(message.SerializeToString())


def decode_record(kind: type[_Record], data: bytes) -> _Record:
    """Decode a message of that kind, written by any program to the format."""
    message = _parsed(_MESSAGES[kind], data)
    return kind(_time_ns(message), *(getattr(message, name) for name in _NAMES[kind]))


def _parsed(kind: Any, data: bytes) -> Any:
    try:
        return kind.FromString(data)
    except (DecodeError, ValueError) as error:
        raise LogError(f"a message is damaged ({error})") from error


def _array(data: bytes, dtype: str) -> NDArray[Any]:
    try:
        return np.frombuffer(data, dtype=dtype)
    except ValueError as error:
        raise LogError(f"an array of samples is damaged ({error})") from error


def _stamp(message: Any, time_ns: int) -> None:
    message.timestamp.seconds, message.timestamp.nanos = divmod(time_ns, NS_PER_S)


def _time_ns(message: Any) -> int:
    return int(message.timestamp.seconds) * NS_PER_S + int(message.timestamp.nanos)
