"""The register table: what may be read in one request, and what may not be known at all."""

from __future__ import annotations

import math

import pytest

from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr import settings
from drivers.mitsubishi_fr.registers import Block, Register

BLOCKS = (fr.STATUS_BLOCK, fr.MONITOR_BLOCK, fr.SET_BLOCK, *settings.CHECKED)


def test_no_block_can_cross_a_hole() -> None:
    """A drive answers 0 for a hole and says nothing: only whole ranges of the map can be asked for."""
    known = set(fr.REGISTERS) - {fr.INVERTER_RESET.number}
    allowed = 0
    for first in range(fr.FIRST_NUMBER, max(known) + 2):
        for count in range(1, 12):
            if known.issuperset(range(first, first + count)):
                assert len(Block(first, count).registers) == count
                allowed += 1
            else:
                with pytest.raises(ValueError, match="not within one declared range"):
                    Block(first, count)
    assert allowed > len(known)


def test_none_at_all_is_no_block() -> None:
    with pytest.raises(ValueError, match="not within one declared range"):
        Block(fr.OUTPUT_FREQUENCY.number, 0)


def test_marks_are_longer_than_whatever_else_is_read() -> None:
    """Else the late answer to one could be taken for that to the other; see `conversation`."""
    assert max(block.count for block in BLOCKS) < min(mark.count for mark in fr.MARKS)
    assert len({mark.count for mark in fr.MARKS}) == len(fr.MARKS)


def test_consecutive_polls_have_answers_of_different_lengths() -> None:
    assert len({block.count for block in (fr.STATUS_BLOCK, fr.MONITOR_BLOCK, fr.SET_BLOCK)}) == 3


def test_the_frequency_that_wears_out_the_memory_is_not_in_the_table() -> None:
    """40015 writes the set frequency into the EEPROM, which bears about 100 000 writes."""
    assert fr.RUNNING_FREQUENCY.number == 40014
    assert 40015 not in fr.REGISTERS


@pytest.mark.parametrize(
    ("register", "value", "raw"),
    [(fr.RUNNING_FREQUENCY, 6.67, 667), (fr.BAUDRATE, 19200.0, 192), (fr.WATCHDOG, 1.5, 15)],
    ids=lambda value: str(value),
)
def test_scales_are_those_of_the_manual(register: Register, value: float, raw: int) -> None:
    assert register.raw(value) == raw
    assert register.value(raw) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("value", [-0.01, 655.36, math.nan, math.inf])
def test_what_no_register_can_hold(value: float) -> None:
    with pytest.raises(ValueError, match="does not fit into 16 bits"):
        fr.RUNNING_FREQUENCY.raw(value)


@pytest.mark.parametrize(("code", "name"), [(0xB1, "E.PUE"), (0x10, "E.OC1"), (0, ""), (0xEE, "fault HEE")])
def test_faults_are_named_as_on_the_display(code: int, name: str) -> None:
    assert fr.fault_name(code) == name
