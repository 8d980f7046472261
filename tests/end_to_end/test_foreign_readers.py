"""Programs that know nothing of rattle decode its logs by the schema that lies in them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from rerun.chunk import McapReader

from daq.block import NS_PER_S, SampleBlock
from daq.log.reader import LogReader, Origin

ORIGINS: tuple[Origin, Origin] = ("measured", "predicted")
CHANNEL = "contact.force_upper"


def ours(log: Path, origin: Origin) -> list[SampleBlock]:
    with LogReader(log) as reader:
        return [block for _, block in reader.blocks(origin, [CHANNEL])]


@pytest.mark.parametrize("origin", ORIGINS)
def test_rerun_in_rust_reads_the_same_numbers(settled_log: Path, origin: Origin) -> None:
    topic = f"/{origin}/{CHANNEL}"
    reader = McapReader(settled_log, decoders=["protobuf"], include_topic_regex=[f"^{topic}$"])
    rows: list[dict[str, Any]] = []
    for chunk in reader.stream():
        batch = chunk.to_record_batch()
        if "rattle.SampleBlock:message" in batch.schema.names:
            rows += [row[0] for row in batch.column("rattle.SampleBlock:message").to_pylist()]
    expected = ours(settled_log, origin)
    assert len(rows) == len(expected)
    for row, block in zip(sorted(rows, key=lambda row: row["first_sample"]), expected, strict=True):
        assert np.array_equal(np.array(row["values"], dtype=np.float32), block.values)
        assert row["first_sample"] == block.first_sample
        assert row["sample_rate"] == block.sample_rate
        assert row["timestamp"]["seconds"] * NS_PER_S + row["timestamp"]["nanos"] == block.time_ns
        assert row["minimum"] == block.values.min()
        assert row["maximum"] == block.values.max()


def test_reruns_checker_finds_no_fault(settled_log: Path) -> None:
    checked = subprocess.run(  # noqa: S603
        [sys.executable, "-m", "rerun_cli", "mcap", "check", str(settled_log)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def message_class(schema: bytes, name: str) -> Any:
    """A message class made of nothing but what the file's schema record holds."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(name))


@pytest.mark.parametrize("origin", ORIGINS)
def test_protobuf_alone_reads_the_same_numbers(settled_log: Path, origin: Origin) -> None:
    found = []
    with settled_log.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=[f"/{origin}/{CHANNEL}"]):
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            found.append(message_class(schema.data, schema.name).FromString(message.data))
    for block, expected in zip(found, ours(settled_log, origin), strict=True):
        assert np.array_equal(np.asarray(block.values, dtype=np.float32), expected.values)
        assert block.timestamp.ToNanoseconds() == expected.time_ns
        # float32 of the true value
        assert block.rms == pytest.approx(np.sqrt(np.mean(np.square(expected.values, dtype=float))), rel=1e-6)


def test_schemas_are_those_of_the_interface(settled_log: Path) -> None:
    fields: dict[str, list[tuple[str, int]]] = {}
    with settled_log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for schema in summary.schemas.values():
        descriptor = message_class(schema.data, schema.name).DESCRIPTOR
        fields[schema.name] = sorted((f.name, f.number) for f in descriptor.fields)
        assert all(f.is_packed for f in descriptor.fields if f.name in {"values", "wide"})
    assert fields["rattle.SampleBlock"] == sorted(
        [
            ("timestamp", 1),
            ("first_sample", 2),
            ("sample_rate", 3),
            ("values", 4),
            ("minimum", 5),
            ("maximum", 6),
            ("rms", 7),
            ("flags", 8),
            ("wide", 9),
        ]
    )
    assert fields["rattle.Event"] == sorted(
        [("timestamp", 1), ("level", 2), ("source", 3), ("code", 4), ("text", 5)]
    )
    assert fields["rattle.Clock"] == sorted(
        [("timestamp", 1), ("device", 2), ("offset_s", 3), ("rate_ppm", 4), ("uncertainty_s", 5)]
    )
