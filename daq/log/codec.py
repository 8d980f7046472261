"""Between the nouns and the protobuf messages of the log."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from google.protobuf.unknown_fields import UnknownFieldSet
from numpy.typing import NDArray

from daq.block import NS_PER_S, Flag, SampleBlock
from daq.errors import LogError
from daq.log import schema
from daq.log.records import ClockRecord, Event, Gap, Impact

_NOT_WIDE = np.empty(0)


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


def encode_event(event: Event) -> bytes:
    """Encode an event."""
    message = schema.EventMessage(level=event.level, source=event.source, code=event.code, text=event.text)
    return _finish(message, event.time_ns)


def decode_event(data: bytes) -> Event:
    """Decode an event."""
    message = _parsed(schema.EventMessage, data)
    return Event(_time_ns(message), message.level, message.source, message.code, message.text)


def encode_gap(gap: Gap) -> bytes:
    """Encode a gap."""
    message = schema.GapMessage(
        channel=gap.channel, first_sample=gap.first_sample, count=gap.count, cause=gap.cause
    )
    return _finish(message, gap.time_ns)


def decode_gap(data: bytes) -> Gap:
    """Decode a gap."""
    message = _parsed(schema.GapMessage, data)
    return Gap(_time_ns(message), message.channel, message.first_sample, message.count, message.cause)


def encode_clock(clock: ClockRecord) -> bytes:
    """Encode a clock record."""
    message = schema.ClockMessage(
        device=clock.device,
        offset_s=clock.offset_s,
        rate_ppm=clock.rate_ppm,
        uncertainty_s=clock.uncertainty_s,
    )
    return _finish(message, clock.time_ns)


def decode_clock(data: bytes) -> ClockRecord:
    """Decode a clock record."""
    message = _parsed(schema.ClockMessage, data)
    return ClockRecord(
        _time_ns(message), message.device, message.offset_s, message.rate_ppm, message.uncertainty_s
    )


def encode_impact(impact: Impact) -> bytes:
    """Encode an impact."""
    fields = {name: getattr(impact, name) for name in _IMPACT_FIELDS}
    return _finish(schema.ImpactMessage(**fields), impact.time_ns)


def decode_impact(data: bytes) -> Impact:
    """Decode an impact."""
    message = _parsed(schema.ImpactMessage, data)
    return Impact(_time_ns(message), *(getattr(message, name) for name in _IMPACT_FIELDS))


_IMPACT_FIELDS = tuple(name for name, _, kind in schema.MESSAGES["Impact"] if kind != "Timestamp")


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


def _finish(message: Any, time_ns: int) -> bytes:
    _stamp(message, time_ns)
    return bytes(message.SerializeToString())
