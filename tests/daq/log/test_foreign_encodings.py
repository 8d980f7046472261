"""Blocks that other programs wrote: every legal protobuf form is read, nonsense is refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from daq.block import NS_PER_S
from daq.errors import LogError
from daq.log import codec
from daq.log.codec import SampleBlockMessage
from daq.log.records import Event

VALUES = np.linspace(-3, 3, 7, dtype="<f4")
WIDE = np.linspace(1e9, 1e9 + 1e-3, 5)


def plain(**fields: object) -> bytes:
    """A message as the standard protobuf package writes it."""
    message = SampleBlockMessage(first_sample=70, sample_rate=51_200.0, flags=3, **fields)
    message.timestamp.FromNanoseconds(5 * NS_PER_S + 17)
    return bytes(message.SerializeToString())


def packed(number: int, values: np.ndarray) -> bytes:
    return bytes([number << 3 | 2, values.nbytes]) + values.tobytes()


def unpacked(values: np.ndarray) -> bytes:
    return b"".join(bytes([4 << 3 | 5]) + struct.pack("<f", value) for value in values)


@pytest.mark.parametrize(
    "data",
    [
        plain(values=VALUES),
        plain() + packed(4, VALUES[:3]) + packed(4, VALUES[3:]),
        plain() + unpacked(VALUES),
        plain() + packed(4, VALUES[:3]) + unpacked(VALUES[3:]),
        plain(values=VALUES) + bytes([15 << 3]) + b"\x01",
    ],
    ids=["plain", "split", "unpacked", "packed and unpacked", "with a field of a later version"],
)
def test_every_legal_form_of_an_array_is_read(data: bytes) -> None:
    block = codec.decode_block("c", data)
    assert block.values.tolist() == VALUES.tolist()
    assert (block.first_sample, block.sample_rate, int(block.flags)) == (70, 51_200.0, 3)
    assert block.time_ns == 5 * NS_PER_S + 17


def test_wide_values_keep_double_precision() -> None:
    block = codec.decode_block("c", plain(wide=WIDE))
    assert block.values.dtype == np.float64
    assert block.values.tolist() == WIDE.tolist()


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    data = SampleBlockMessage(sample_rate=rate, values=VALUES).SerializeToString()
    with pytest.raises(LogError, match="a block of c has a sample rate of"):
        codec.decode_block("c", data)


@pytest.mark.parametrize("data", [b"\xff\xff\xff", packed(4, VALUES)[:-1], b"\x22\x03abc"])
def test_garbage_is_refused_in_our_words(data: bytes) -> None:
    with pytest.raises(LogError, match="is damaged"):
        codec.decode_block("c", data)
    with pytest.raises(LogError, match="is damaged"):
        codec.decode_record(Event, b"\xff\xff\xff")
