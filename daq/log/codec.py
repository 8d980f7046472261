"""The protobuf messages of the log format, package `rattle`, built from a table; between them and the nouns.

Samples travel as `repeated float`, packed. A message class that declares the same field as `bytes` has the
same wire format and moves a whole numpy array at once; only the true declaration is embedded in files.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from daq.block import LATEST, NS_PER_S, Flag, SampleBlock, is_rate
from daq.errors import LogError
from daq.log.records import ClockRecord, Event, Gap, Impact

_Field = descriptor_pb2.FieldDescriptorProto
_TYPES = {
    "double": _Field.TYPE_DOUBLE,
    "float": _Field.TYPE_FLOAT,
    "uint32": _Field.TYPE_UINT32,
    "uint64": _Field.TYPE_UINT64,
    "string": _Field.TYPE_STRING,
    "bytes": _Field.TYPE_BYTES,
    "Timestamp": _Field.TYPE_MESSAGE,
}

MESSAGES: dict[str, tuple[tuple[str, int, str], ...]] = {
    "SampleBlock": (
        ("timestamp", 1, "Timestamp"),
        ("first_sample", 2, "uint64"),
        ("sample_rate", 3, "double"),
        ("values", 4, "repeated float"),
        ("minimum", 5, "float"),
        ("maximum", 6, "float"),
        ("rms", 7, "float"),
        ("flags", 8, "uint32"),
        ("wide", 9, "repeated double"),
    ),
    "Event": (
        ("timestamp", 1, "Timestamp"),
        ("level", 2, "string"),
        ("source", 3, "string"),
        ("code", 4, "string"),
        ("text", 5, "string"),
    ),
    "Gap": (
        ("timestamp", 1, "Timestamp"),
        ("channel", 2, "string"),
        ("first_sample", 3, "uint64"),
        ("count", 4, "uint64"),
        ("cause", 5, "string"),
        ("origin", 6, "string"),
    ),
    "Clock": (
        ("timestamp", 1, "Timestamp"),
        ("device", 2, "string"),
        ("offset_s", 3, "double"),
        ("rate_ppm", 4, "double"),
        ("uncertainty_s", 5, "double"),
    ),
    "Impact": (
        ("timestamp", 1, "Timestamp"),
        ("origin", 2, "string"),
        ("channel", 3, "string"),
        ("first_sample", 4, "uint64"),
        ("end_sample", 5, "uint64"),
        ("peak_sample", 6, "uint64"),
        ("peak", 7, "double"),
        ("first_peak", 8, "double"),
        ("impulse", 9, "double"),
        ("contact_s", 10, "double"),
        ("bounces", 11, "uint32"),
        ("turns", 12, "double"),
    ),
}


def _file(
    name: str, messages: dict[str, tuple[tuple[str, int, str], ...]]
) -> descriptor_pb2.FileDescriptorProto:
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{name}.proto",
        package="rattle",
        syntax="proto3",
        dependency=["google/protobuf/timestamp.proto"],
    )
    for message_name, wanted in messages.items():
        message = file.message_type.add(name=message_name)
        for field_name, number, kind in wanted:
            repeated = kind.startswith("repeated ")
            field = message.field.add(
                name=field_name,
                number=number,
                type=_TYPES[kind.removeprefix("repeated ")],
                label=_Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL,
            )
            if kind == "Timestamp":
                field.type_name = ".google.protobuf.Timestamp"
    return file


def _pool(file: descriptor_pb2.FileDescriptorProto) -> descriptor_pool.DescriptorPool:
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.AddSerializedFile(file.SerializeToString())
    return pool


def _message_class(pool: descriptor_pool.DescriptorPool, name: str) -> Any:
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"rattle.{name}"))


_true_file = {name: _file(f"rattle_{name.lower()}", {name: fields}) for name, fields in MESSAGES.items()}
_true_pool = {name: _pool(file) for name, file in _true_file.items()}
_as_bytes = tuple(
    (name, number, "bytes" if kind.startswith("repeated ") else kind)
    for name, number, kind in MESSAGES["SampleBlock"]
)

SampleBlockMessage = _message_class(_true_pool["SampleBlock"], "SampleBlock")
FastSampleBlockMessage = _message_class(
    _pool(_file("rattle_fast", {"SampleBlock": _as_bytes})), "SampleBlock"
)
EventMessage = _message_class(_true_pool["Event"], "Event")
GapMessage = _message_class(_true_pool["Gap"], "Gap")
ClockMessage = _message_class(_true_pool["Clock"], "Clock")
ImpactMessage = _message_class(_true_pool["Impact"], "Impact")


def embedded_schema(name: str) -> bytes:
    """Return the FileDescriptorSet that MCAP embeds for message `name`, dependencies included."""
    file_set = descriptor_pb2.FileDescriptorSet()
    timestamp_pb2.DESCRIPTOR.CopyToProto(file_set.file.add())
    file_set.file.append(_true_file[name])
    return file_set.SerializeToString()


_NOT_WIDE = np.empty(0)
_Record = TypeVar("_Record", Event, Gap, ClockRecord, Impact)
_MESSAGES: dict[type, Any] = {
    Event: EventMessage,
    Gap: GapMessage,
    ClockRecord: ClockMessage,
    Impact: ImpactMessage,
}
_NAMES = {kind: tuple(field.name for field in fields(kind) if field.name != "time_ns") for kind in _MESSAGES}


def encode_block(block: SampleBlock) -> bytes:
    """Encode a block: float32 values travel as `values`, float64 values as `wide`."""
    message = FastSampleBlockMessage(
        first_sample=block.first_sample, sample_rate=block.sample_rate, flags=int(block.flags)
    )
    _stamp(message, block.time_ns)
    if block.values.dtype == np.float64:
        message.wide = block.values.astype("<f8", copy=False).tobytes()
    else:
        message.values = block.values.astype("<f4", copy=False).tobytes()
    if len(block):  # by ufuncs: an array's methods and np.mean go through Python
        message.minimum, message.maximum = np.minimum.reduce(block.values), np.maximum.reduce(block.values)
        power = np.add.reduce(np.square(block.values, dtype=np.float64)) / len(block)
        message.rms = math.sqrt(power)
    return bytes(message.SerializeToString())


def decode_block(channel: str, data: bytes) -> SampleBlock:
    """Decode a block written by any program to the format; float64 values if it came as `wide`."""
    message = _parsed(FastSampleBlockMessage, data)
    message.DiscardUnknownFields()  # fixed32 `values` (unpacked) too
    if message.ByteSize() != len(data):
        # Unpacked or split arrays are legal protobuf, which the `bytes` declaration cannot see.
        message = _parsed(SampleBlockMessage, data)
        message.DiscardUnknownFields()
        message = _parsed(FastSampleBlockMessage, message.SerializeToString())
    values = _array(message.values, "<f4")
    wide = _array(message.wide, "<f8") if message.wide else _NOT_WIDE
    if not is_rate(message.sample_rate):
        raise LogError(f"a block of {channel} has a sample rate of {message.sample_rate:g} Hz")
    if message.first_sample >= LATEST:
        raise LogError(f"a block of {channel} begins at sample {message.first_sample}")
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
    values = [getattr(message, name) for name in _NAMES[kind]]
    if any(isinstance(value, int) and value >= LATEST for value in values):
        raise LogError(f"a message ({kind.__name__}) counts further than any log")
    return kind(_time_ns(message), *values)


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
    time_ns = int(message.timestamp.seconds) * NS_PER_S + int(message.timestamp.nanos)
    if not -LATEST < time_ns < LATEST:
        raise LogError(f"no log holds a time of {time_ns} ns since 1970")
    return time_ns
