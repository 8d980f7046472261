"""The checker itself: what it must find in a log that is not as it was sent."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.codec import encode_block
from daq.log.records import STOPPING, Event, Gap
from daq.log.writer import LogWriter
from tests.accounting import discrepancies, sent_in

RATE, START_NS = 1000.0, 1_800_000_000 * NS_PER_S
BEGIN, BLOCK, MADE, LOST = 2000, 100, 5000, 500
"""Where the record begins on the card; how many in a block and in all; one that the encoder left out."""
TURN, SCALE = 4096, math.tau / 4096
STOPPED_NS = START_NS + 4 * NS_PER_S


def force(index: int) -> float:
    return round(math.sin(0.37 * index), 9)


def counts(frame: int) -> int:
    return 7 * frame * frame % TURN


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """A card of one input from 0 s on, and an encoder from 1 s on, both until 5 s."""
    folder = tmp_path / "truth"
    folder.mkdir()
    card: list[dict[str, object]] = [{"started_ns": START_NS, "rate": RATE, "inputs": ["a/ai0"]}]
    card += [
        {"first": at, "count": 50, "values": {str(at): [force(at)], str(at + 9): [force(at + 9)]}}
        for at in range(0, MADE, 50)
    ]
    unix_s = START_NS / NS_PER_S + 1.0
    frames: list[dict[str, object]] = [{"counts_per_revolution": TURN, "range": TURN}]
    frames += [
        {
            "since_s": 1.0,
            "frame": frame,
            "unix_s": unix_s + frame / RATE,
            "counts": counts(frame),
            "sent": frame != BEGIN - 1000 + LOST,
        }
        for frame in range(4000)
    ]
    for name, told in (("daq_card", card), ("encoder", frames)):
        (folder / f"{name}-1.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in told))
    return folder


Spoil = Callable[[SampleBlock], SampleBlock | None]


def found(folder: Path, spoil: Spoil, *gaps: Gap) -> str:
    """What the checker says of a record from the card's sample 2000 on, stopped 2 s later."""
    log_path = folder / "log.mcap"
    begin_ns = sample_time_ns(START_NS, BEGIN, RATE)
    with LogWriter(log_path) as log:
        log.declare("measured", Channel("force", "N", scale=2.0, raw_unit="V"))
        log.declare("measured", Channel("encoder.angle", "rad", scale=SCALE, raw_unit="count"))
        for gap in (Gap(begin_ns, "encoder.angle", LOST, 1, "frames missing"), *gaps):
            log.add_gap(gap, begin_ns)
        for first in range(0, MADE - BEGIN, BLOCK):
            index, time_ns = np.arange(first, first + BLOCK), sample_time_ns(begin_ns, first, RATE)
            shown = np.array([2.0 * force(BEGIN + each) for each in index], np.float32)
            turned = np.array([counts(BEGIN - 1000 + each) * SCALE for each in index])
            blocks = [SampleBlock("force", first, time_ns, RATE, shown)]
            if first == LOST:
                index, time_ns, turned = index[1:], sample_time_ns(time_ns, 1, RATE), turned[1:]
            blocks.append(SampleBlock("encoder.angle", int(index[0]), time_ns, RATE, turned))
            for block in filter(None, map(spoil, blocks)):
                log.add_encoded_block("measured", block, encode_block(block), time_ns, record_gap=False)
        log.add_event(Event(STOPPED_NS, "warning", "rig", STOPPING, "stopped"))
    return "; ".join(discrepancies(log_path, sent_in(folder / "truth")))


def without(channel: str, first: int) -> Spoil:
    return lambda block: None if (block.channel, block.first_sample) == (channel, first) else block


def changed(channel: str, change: Callable[[SampleBlock], SampleBlock]) -> Spoil:
    return lambda block: change(block) if block.channel == channel else block


def test_a_log_that_is_as_it_was_sent_is_all_right(truth: Path) -> None:
    assert found(truth.parent, lambda block: block) == ""


@pytest.mark.parametrize("channel", ["force", "encoder.angle"])
def test_a_block_that_is_missing_has_to_be_in_the_ledger(truth: Path, channel: str) -> None:
    assert f"measured {channel}: indices 200 to 299 are neither there nor in /gap" in found(
        truth.parent, without(channel, 200)
    )


def test_one_that_is_in_the_ledger_is_all_right(truth: Path) -> None:
    gap = Gap(START_NS, "force", 200, BLOCK, "samples missing")
    assert found(truth.parent, without("force", 200), gap) == ""


def test_what_is_there_and_in_the_ledger_is_there_twice(truth: Path) -> None:
    gap = Gap(START_NS, "force", 190, 20, "samples missing")
    assert "index 200 is there twice" in found(truth.parent, without("force", 999), gap)


@pytest.mark.parametrize("channel", ["force", "encoder.angle"])
def test_values_at_the_place_of_others_are_found(truth: Path, channel: str) -> None:
    def swapped(block: SampleBlock) -> SampleBlock:
        late = block.first_sample >= 700
        return replace(block, values=np.roll(block.values, 1)) if late else block

    assert "not those that" in found(truth.parent, changed(channel, swapped))


def test_a_position_that_was_never_sent_is_found(truth: Path) -> None:
    told = json.loads((truth / "encoder-1.jsonl").read_text().splitlines()[1200])
    text = (truth / "encoder-1.jsonl").read_text()
    line = json.dumps(told)
    assert line in text
    (truth / "encoder-1.jsonl").write_text(text.replace(line, json.dumps({**told, "sent": False})))
    assert "encoder.angle: its values are not those that were sent" in found(
        truth.parent, lambda block: block
    )


@pytest.mark.parametrize("channel", ["force", "encoder.angle"])
def test_a_tail_that_is_nowhere_is_found(truth: Path, channel: str) -> None:
    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.channel == channel and block.first_sample >= 1500 else block

    assert f"{channel}: " in (said := found(truth.parent, cut))
    assert "of which the last" in said


def test_more_than_was_sent_is_found(truth: Path) -> None:
    lines = (truth / "daq_card-1.jsonl").read_text().splitlines()
    (truth / "daq_card-1.jsonl").write_text("\n".join(lines[:-10]))
    assert "only 2500 were sent" in found(truth.parent, lambda block: block)


def test_times_that_go_back_are_found(truth: Path) -> None:
    def back(block: SampleBlock) -> SampleBlock:
        return replace(block, time_ns=block.time_ns - (NS_PER_S if block.first_sample == 800 else 0))

    assert "time goes back at index 800" in found(truth.parent, changed("force", back))


def test_an_encoder_off_the_time_base_is_found(truth: Path) -> None:
    def late(block: SampleBlock) -> SampleBlock:
        return replace(block, time_ns=block.time_ns + (NS_PER_S // 5 if block.first_sample > 0 else 0))

    assert "s off the time base" in found(truth.parent, changed("encoder.angle", late))
