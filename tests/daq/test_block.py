"""A block that goes to another process is there what it was here."""

from __future__ import annotations

import pickle
from dataclasses import fields

import numpy as np

from daq.block import Flag, SampleBlock, merged
from rig.stream import Block


def block(first: int, count: int, flags: Flag = Flag.GOOD) -> SampleBlock:
    return SampleBlock("a", first, first * 1000, 1e6, np.arange(first, first + count, dtype="f4"), flags)


def test_a_block_is_pickled_with_all_its_fields() -> None:
    sent = Block("measured", block(3, 4, Flag.OVERLOAD))
    came = pickle.loads(pickle.dumps(sent))  # noqa: S301 - our own
    assert came.origin == sent.origin
    for field in fields(SampleBlock):
        assert np.array_equal(getattr(came.samples, field.name), getattr(sent.samples, field.name))


def test_blocks_are_merged_up_to_a_hole_or_other_flags() -> None:
    blocks = [block(0, 4), block(4, 4), block(9, 4), block(13, 4, Flag.OVERLOAD), block(17, 4, Flag.OVERLOAD)]
    found = merged(blocks)
    assert [(each.first_sample, each.end_sample, each.flags) for each in found] == [
        (0, 8, Flag.GOOD),
        (9, 13, Flag.GOOD),
        (13, 21, Flag.OVERLOAD),
    ]
    assert all(np.array_equal(each.values, np.arange(each.first_sample, each.end_sample)) for each in found)
