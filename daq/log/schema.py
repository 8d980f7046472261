"""The protobuf messages of the log format, built from a table; package `rattle`.

Samples travel as `repeated float`, packed. A message class that declares the same field as `bytes` has the
same wire format and moves a whole numpy array at once; only the true declaration is embedded in files.
"""

from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

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
    for message_name, fields in messages.items():
        message = file.message_type.add(name=message_name)
        for field_name, number, kind in fields:
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
