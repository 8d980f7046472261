"""The checker itself: what it must find in a log that is not as it was sent."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.codec import encode_block
from daq.log.records import RECORD_END, RECORD_START, STOPPING, Event, Gap
from daq.log.writer import LogWriter
from rig.session.driven_rig import STOPPED
from rig.session.run import RECORDED
from tests.accounting import discrepancies, disk_failed, ruined, sent_in
from tests.accounting_by_pieces import discrepancies_by_pieces

RATE, START_NS = 1000.0, 1_800_000_000 * NS_PER_S
BEGIN, BLOCK, MADE, LOST = 2000, 100, 5000, 500
"""Where the record begins on the card; how many in a block and in all; one that the encoder left out."""
ASKED_HZ = 2.0
TURN, SCALE = 4096, math.tau / 4096
STOP = Event(START_NS + 4 * NS_PER_S, "warning", "rig", STOPPING, "stopped")
CRASH_NS = START_NS + 5 * NS_PER_S


@pytest.fixture(autouse=True)
def _false_logs_go(accounts_for_every_sample: None, tmp_path: Path) -> Iterator[None]:
    """Before the checker of all tests looks at them."""
    yield
    for log in tmp_path.rglob("*.mcap"):
        log.unlink()


def force(index: int) -> float:
    return round(math.sin(0.37 * index), 9)


def counts(frame: int) -> int:
    return 7 * frame * frame % TURN


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """A card of two inputs from 0 s on, and an encoder from 1 s on, both until 5 s."""
    folder = tmp_path / "truth"
    folder.mkdir()
    card: list[dict[str, object]] = [{"started_ns": START_NS, "rate": RATE, "inputs": ["a/ai0", "a/ai1"]}]
    card += [
        {
            "first": at,
            "count": 50,
            "values": {
                str(each): np.array([force(each), force(3 * each)]).tobytes().hex() for each in (at, at + 9)
            },
            "counted": {str(each): [counts(each)] for each in (at, at + 9)},
            "read": at,
        }
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


RUN_NAME = "beam_20270115-080000-000.mcap"
ENDED = Event(START_NS + 5 * NS_PER_S, "info", "rig", RECORD_END, RECORDED)
SCENARIO = """\
rig = "impact_beam"
[drive]
frequency = "20 Hz"
amplitude = "9 N"
[acquisition]
sample_rate = "1 kHz"
settle = "1 s"
duration = "3 s"
"""


def predict(log: LogWriter, channel: Channel, count: int | None) -> None:
    if count is None:
        return
    log.declare("predicted", channel)
    for first in range(0, count, BLOCK):
        time_ns = sample_time_ns(START_NS, BEGIN + first, RATE)
        block = SampleBlock(channel.name, first, time_ns, RATE, np.zeros(BLOCK, np.float32))
        log.add_block("predicted", block, time_ns)


def found(
    folder: Path,
    spoil: Spoil,
    *gaps: Gap,
    name: str = "log.mcap",
    ends: Event | Sequence[Event] | None = STOP,
    cut_ns: int | None = None,
    undeclared: str = "",
    predicted: int | None = None,
    emulated: str = "card encoder",
) -> str:
    """What the checker says of a record from the card's sample 2000 on, stopped 2 s later.

    `cut_ns`: as a crash leaves it that was last written then; it came when the last was sent. `predicted`:
    how many samples of the force; None where that is not even declared.
    """
    declared = (
        Channel("force", "N", scale=2.0, raw_unit="V"),
        Channel("strain", "N", scale=1.0, raw_unit="V"),
        Channel("crank.angle", "rad", scale=SCALE, raw_unit="count"),
        Channel("encoder.angle", "rad", scale=SCALE, raw_unit="count"),
        Channel("room.temperature", "°C"),
    )
    log_path = folder / name
    begin_ns = sample_time_ns(START_NS, BEGIN, RATE)
    with LogWriter(log_path) as log:
        log.add_metadata("scenario", {"toml": SCENARIO})
        log.add_metadata("run", {"emulated": emulated})
        for channel in declared:
            if channel.name != undeclared:
                log.declare("measured", channel)
        log.add_event(Event(begin_ns, "info", "rig", RECORD_START, "recording"))
        for gap in (Gap(begin_ns, "encoder.angle", LOST, 1, "frames missing"), *gaps):
            log.add_gap(gap, begin_ns)
        predict(log, declared[0], predicted)
        for first in range(0, MADE - BEGIN, BLOCK):
            index, time_ns = np.arange(first, first + BLOCK), sample_time_ns(begin_ns, first, RATE)
            shown = np.array([2.0 * force(BEGIN + each) for each in index.tolist()], np.float32)
            bent = np.array([force(3 * (BEGIN + each)) for each in index.tolist()], np.float32)
            turned = np.array([counts(BEGIN - 1000 + each) * SCALE for each in index.tolist()])
            passed = np.array([(counts(BEGIN + each) + TURN * each) * SCALE for each in index.tolist()])
            blocks = [
                SampleBlock("force", first, time_ns, RATE, shown),
                SampleBlock("strain", first, time_ns, RATE, bent),
                SampleBlock("crank.angle", first, time_ns, RATE, passed),
            ]
            if first % round(RATE / ASKED_HZ) == 0:
                degrees = np.array([21.0])
                blocks.append(SampleBlock("room.temperature", first // 500, time_ns, ASKED_HZ, degrees))
            if first == LOST:
                index, time_ns, turned = index[1:], sample_time_ns(time_ns, 1, RATE), turned[1:]
            blocks.append(SampleBlock("encoder.angle", int(index[0]), time_ns, RATE, turned))
            for block in filter(None, map(spoil, blocks)):
                host_ns = sample_time_ns(begin_ns, first + BLOCK, RATE)
                log.add_encoded_block("measured", block, encode_block(block), host_ns, record_gap=False)
        for event in (ends,) if isinstance(ends, Event) else ends or ():
            log.add_event(event)
        log.flush_if_older(1 << 62)
        written = log_path.read_bytes()
    if cut_ns is not None:
        log_path.write_bytes(written)
        os.utime(log_path, ns=(cut_ns, cut_ns))
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


@pytest.mark.parametrize("channel", ["force", "crank.angle", "encoder.angle"])
def test_values_at_the_place_of_others_are_found(truth: Path, channel: str) -> None:
    def swapped(block: SampleBlock) -> SampleBlock:
        late = block.first_sample >= 700
        return replace(block, values=np.roll(block.values, 1)) if late else block

    assert "not those that" in found(truth.parent, changed(channel, swapped))


@pytest.mark.parametrize("factor", [0.0, -1.0, 1000.0, 1.0001])
@pytest.mark.parametrize("channel", ["force", "strain"])
def test_values_that_are_not_in_their_unit_are_found(truth: Path, channel: str, factor: float) -> None:
    def scaled(block: SampleBlock) -> SampleBlock:
        return replace(block, values=block.values * np.float32(factor))

    assert "not those that" in found(truth.parent, changed(channel, scaled))


@pytest.mark.parametrize("predicted", [0, 1000])
def test_a_prediction_that_never_came_has_to_be_in_the_ledger(truth: Path, predicted: int) -> None:
    told, whole = Gap(START_NS, "force", predicted, 3000 - predicted, "not predicted", "predicted"), 3000
    lacks = f"predicted force: {whole} samples were sent, of which the last {whole - predicted} are nowhere"
    for gaps, count, words in (((), whole, ""), ((), predicted, lacks), ((told,), predicted, "")):
        said = found(truth.parent, lambda block: block, *gaps, name=RUN_NAME, ends=ENDED, predicted=count)
        assert said == words
        (truth.parent / RUN_NAME).unlink()


def test_a_position_that_was_never_sent_is_found(truth: Path) -> None:
    told = json.loads((truth / "encoder-1.jsonl").read_text().splitlines()[1200])
    text = (truth / "encoder-1.jsonl").read_text()
    line = json.dumps(told)
    assert line in text
    (truth / "encoder-1.jsonl").write_text(text.replace(line, json.dumps({**told, "sent": False})))
    assert "encoder.angle: its values are not those that were sent" in found(
        truth.parent, lambda block: block
    )


@pytest.mark.parametrize("channel", ["force", "crank.angle", "encoder.angle", "room.temperature"])
def test_a_tail_that_is_nowhere_is_found(truth: Path, channel: str) -> None:
    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.channel == channel and block.first_sample >= block.sample_rate / 2 else block

    assert f"{channel}: " in (said := found(truth.parent, cut))
    assert "of which the last" in said


@pytest.mark.parametrize("channel", ["force", "encoder.angle"])
def test_a_ramp_belongs_to_what_was_stopped(truth: Path, channel: str) -> None:
    """Its beginning is no end: a motor turns on for seconds."""
    begins = replace(STOP, time_ns=START_NS + 3 * NS_PER_S)
    stands = Event(START_NS + 4 * NS_PER_S, "info", "inverter", "inverter.off", "run withdrawn")

    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.channel == channel and block.first_sample >= 1500 else block

    assert found(truth.parent, cut, name="begun.mcap", ends=begins) == ""
    assert f"{channel}: " in (said := found(truth.parent, cut, ends=(begins, stands)))
    assert "of which the last" in said
    gap = Gap(START_NS, channel, 1500, 1500, STOPPED)
    assert found(truth.parent, cut, gap, name="told.mcap", ends=(begins, stands)) == ""


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


@pytest.mark.parametrize(
    "ends", [ENDED, replace(ENDED, text="recorded until it was enough"), replace(ENDED, code="drive.off")]
)
@pytest.mark.parametrize("channel", ["force", "encoder.angle"])
def test_a_tail_that_is_nowhere_is_found_where_a_run_ended_well(
    truth: Path, ends: Event, channel: str
) -> None:
    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.channel == channel and block.first_sample >= 2000 else block

    assert found(truth.parent, lambda block: block, name=RUN_NAME, ends=ends) == ""
    (truth.parent / RUN_NAME).unlink()
    assert f"measured {channel}: " in (said := found(truth.parent, cut, name=RUN_NAME, ends=ends))
    assert "of which the last" in said


@pytest.mark.parametrize("kept_s", [0.0, 2.0])
@pytest.mark.parametrize(("first", "words"), [(2500, ""), (2300, "of which the last")])
def test_a_crash_costs_half_a_second_of_what_was_read(
    truth: Path, first: int, words: str, kept_s: float
) -> None:
    """Also where the file was last written long before, by a writer that kept the rest to itself."""

    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.first_sample >= first * block.sample_rate / RATE else block

    said = found(truth.parent, cut, name=RUN_NAME, ends=None, cut_ns=CRASH_NS - round(kept_s * NS_PER_S))
    assert words in said if words else said == ""


def test_a_crash_costs_nothing_of_what_the_card_made_and_nobody_read(truth: Path) -> None:
    lines = [json.loads(line) for line in (truth / "daq_card-1.jsonl").read_text().splitlines()]
    told = [line | {"read": min(line["read"], 4000)} if "read" in line else line for line in lines]
    (truth / "daq_card-1.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in told))

    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.first_sample >= 1.5 * block.sample_rate else block

    assert found(truth.parent, cut, name=RUN_NAME, ends=None, cut_ns=CRASH_NS) == ""


@pytest.mark.parametrize(("read", "words"), [(BEGIN + 700, ""), (BEGIN + 1600, "force: declared, but")])
def test_a_crash_may_cost_all_of_the_card_and_leave_the_encoder(truth: Path, read: int, words: str) -> None:
    """Of which nobody knows then which run of the card it was."""
    [begun, *_] = (truth / "daq_card-1.jsonl").read_text().splitlines()
    (truth / "daq_card-1.jsonl").write_text(f"{json.dumps(json.loads(begun) | {'rate': 25_600.0})}\n")
    frames = truth / "encoder-1.jsonl"
    frames.write_text("".join(frames.read_text().splitlines(keepends=True)[: 1 + read - 1000]))

    def cut(block: SampleBlock) -> SampleBlock | None:
        return block if block.channel == "encoder.angle" and block.end_sample <= read - BEGIN else None

    cut_ns = sample_time_ns(START_NS, read, RATE)
    said = found(truth.parent, cut, name=RUN_NAME, ends=None, cut_ns=cut_ns)
    assert words in said if words else said == ""


@pytest.mark.parametrize(
    ("read", "undeclared", "words"),
    [
        (BEGIN + 400, "", ""),
        (BEGIN + 400, "force", ""),
        (BEGIN + 1600, "", "force: declared, but"),
        (BEGIN + 1600, "force", "1 analog channels of 2 inputs"),
    ],
)
def test_a_crash_may_cost_a_channel_all_of_a_record_that_has_just_begun(
    truth: Path, read: int, undeclared: str, words: str
) -> None:
    """And its declaration; and what the others hold is still looked for at their own inputs."""
    lines = [json.loads(line) for line in (truth / "daq_card-1.jsonl").read_text().splitlines()]
    told = [line | {"read": min(line["read"], read)} if "read" in line else line for line in lines]
    (truth / "daq_card-1.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in told))

    def cut(block: SampleBlock) -> SampleBlock | None:
        late = block.first_sample > 0 and block.channel != "encoder.angle"
        return None if late or block.channel == "force" else block

    def wrong(block: SampleBlock) -> SampleBlock | None:
        kept = cut(block)
        return replace(kept, values=kept.values[::-1]) if kept and kept.channel == "strain" else kept

    said = found(truth.parent, cut, name=RUN_NAME, ends=None, cut_ns=CRASH_NS, undeclared=undeclared)
    assert words in said if words else said == ""
    (truth.parent / RUN_NAME).unlink()
    said = found(truth.parent, wrong, name=RUN_NAME, ends=None, cut_ns=CRASH_NS, undeclared=undeclared)
    assert "the values of strain" in said


def test_a_disk_that_failed_holds_what_was_sent_before(truth: Path) -> None:
    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.first_sample >= 1.5 * block.sample_rate else block

    disk_failed(truth.parent / RUN_NAME)
    assert found(truth.parent, cut, name=RUN_NAME, ends=None, cut_ns=START_NS + 4 * NS_PER_S) == ""
    (truth.parent / RUN_NAME).unlink()
    assert "of which the last" in found(truth.parent, cut, name=RUN_NAME, ends=None, cut_ns=CRASH_NS)


@pytest.mark.parametrize("channel", ["force", "crank.angle", "encoder.angle", "room.temperature"])
def test_a_channel_that_was_declared_has_to_come(truth: Path, channel: str) -> None:
    assert f"{channel}: " in found(
        truth.parent, lambda block: None if block.channel == channel else block, name=RUN_NAME
    )


@pytest.mark.parametrize(("ends", "cut_ns"), [(STOP, None), (ENDED, None), (None, CRASH_NS)])
def test_a_record_without_a_sample_is_found(truth: Path, ends: Event | None, cut_ns: int | None) -> None:
    said = found(truth.parent, lambda _: None, name=RUN_NAME, ends=ends, cut_ns=cut_ns)
    for channel in ("force", "crank.angle", "room.temperature"):
        assert f"{channel}: declared, but nothing of it is there" in said
    assert "measured encoder.angle: indices 0 to 499 are neither there nor in /gap" in said


def test_a_run_says_how_it_ended(truth: Path) -> None:
    assert found(truth.parent, lambda block: block, ends=None) == ""
    assert found(truth.parent, lambda block: block, name=RUN_NAME, ends=None) == "nothing says how it ended"
    (truth.parent / RUN_NAME).unlink()
    assert "nothing says how it ended" in found(truth.parent, lambda _: None, name=RUN_NAME, ends=None)


def test_a_record_that_had_its_end_was_not_stopped(truth: Path) -> None:
    gap = Gap(START_NS, "force", MADE - BEGIN, 7, STOPPED)
    said = found(truth.parent, lambda block: block, gap, name=RUN_NAME, ends=ENDED)
    assert said == "force: said to be stopped, but it had its end"


def test_a_log_of_emulators_that_sent_nothing_then_is_found(truth: Path) -> None:
    text = (truth / "daq_card-1.jsonl").read_text()
    (truth / "daq_card-1.jsonl").write_text(text.replace(f"{START_NS}", f"{START_NS + 60 * NS_PER_S}"))
    assert "its emulated card sent nothing then" in found(truth.parent, lambda block: block)
    (truth / "encoder-1.jsonl").write_text("")
    (truth.parent / "log.mcap").unlink()
    assert "its emulated encoder sent nothing then" in found(truth.parent, lambda block: block)


def test_a_run_on_instruments_that_a_test_holds_has_to_be_of_one_that_sent_then(truth: Path) -> None:
    text = (truth / "daq_card-1.jsonl").read_text()
    (truth / "daq_card-1.jsonl").write_text(text.replace(f"{START_NS}", f"{START_NS - 60 * NS_PER_S}"))
    said = found(truth.parent, lambda block: block, name=RUN_NAME, emulated="")
    assert "no card that sent samples at its rate did so then" in said


def test_a_log_of_a_run_has_to_be_readable_unless_a_test_ruined_it(tmp_path: Path) -> None:
    for name in (RUN_NAME, "log.mcap"):
        (tmp_path / name).write_bytes(bytes(1000))
    assert discrepancies(tmp_path / "log.mcap", []) == []
    assert "it cannot be read" in discrepancies(tmp_path / RUN_NAME, [])[0]
    assert discrepancies(ruined(tmp_path / RUN_NAME), []) == []


def by_pieces(folder: Path, spoil: Spoil, *gaps: Gap) -> str:
    """What is found of the same record, which had its end, half a second at a time."""
    found(folder, spoil, *gaps, name=RUN_NAME, ends=ENDED)
    return "; ".join(discrepancies_by_pieces(folder / RUN_NAME, folder / "truth", 0.5))


def test_by_pieces_a_log_that_is_as_it_was_sent_is_all_right(truth: Path) -> None:
    assert by_pieces(truth.parent, lambda block: block) == ""


@pytest.mark.parametrize("channel", ["force", "strain", "encoder.angle"])
@pytest.mark.parametrize("first", [1000, 1200])
def test_by_pieces_a_block_that_is_missing_has_to_be_in_the_ledger(
    truth: Path, channel: str, first: int
) -> None:
    lacks = f"measured {channel}: indices {first} to {first + BLOCK - 1} are neither there nor in /gap"
    assert lacks in by_pieces(truth.parent, without(channel, first))
    (truth.parent / RUN_NAME).unlink()
    gap = Gap(START_NS, channel, first, BLOCK, "samples missing")
    assert by_pieces(truth.parent, without(channel, first), gap) == ""


@pytest.mark.parametrize("channel", ["force", "crank.angle", "encoder.angle"])
def test_by_pieces_values_at_the_place_of_others_are_found(truth: Path, channel: str) -> None:
    def swapped(block: SampleBlock) -> SampleBlock:
        late = block.first_sample >= 2700
        return replace(block, values=np.roll(block.values, 1)) if late else block

    said = by_pieces(truth.parent, changed(channel, swapped))
    assert said.startswith("from index 2500 on: ")
    assert "not those that were sent" in said


@pytest.mark.parametrize("of", ["card", "encoder"])
def test_by_pieces_a_sample_that_went_and_left_no_hole_is_found(truth: Path, of: str) -> None:
    """Each piece by itself would be what was sent, a sample later."""

    def slipped(block: SampleBlock) -> SampleBlock:
        whose = {"encoder.angle": "encoder", "room.temperature": ""}.get(block.channel, "card")
        if whose != of or block.first_sample < 1500:
            return block
        index = range(BEGIN + block.first_sample + 1, BEGIN + block.end_sample + 1)
        sent: dict[str, Callable[[int], float]] = {
            "force": lambda each: 2.0 * force(each),
            "strain": lambda each: force(3 * each),
            "crank.angle": lambda each: (counts(each) + TURN * each) * SCALE,
            "encoder.angle": lambda each: counts(each - 1000) * SCALE,
        }
        values = np.array([sent[block.channel](each) for each in index], block.values.dtype)
        return replace(block, values=values)

    said = by_pieces(truth.parent, slipped)
    assert said.startswith("from index 1500 on: ")
    assert "not those that were sent" in said


@pytest.mark.parametrize("channel", ["force", "strain", "encoder.angle"])
def test_by_pieces_a_tail_that_is_nowhere_is_found(truth: Path, channel: str) -> None:
    def cut(block: SampleBlock) -> SampleBlock | None:
        return None if block.channel == channel and block.first_sample >= 2000 else block

    said = by_pieces(truth.parent, cut)
    assert f"measured {channel}: " in said
    assert "of which the last" in said


def test_by_pieces_times_that_go_back_are_found(truth: Path) -> None:
    def back(block: SampleBlock) -> SampleBlock:
        return replace(block, time_ns=block.time_ns - (NS_PER_S if block.first_sample == 1500 else 0))

    assert "time goes back at index 1500" in by_pieces(truth.parent, changed("strain", back))


def test_by_pieces_a_log_of_emulators_that_sent_nothing_then_is_found(truth: Path) -> None:
    text = (truth / "daq_card-1.jsonl").read_text()
    (truth / "daq_card-1.jsonl").write_text(text.replace(f"{START_NS}", f"{START_NS + 60 * NS_PER_S}"))
    (truth / "encoder-1.jsonl").write_text("")
    said = by_pieces(truth.parent, lambda block: block)
    assert "its emulated card sent nothing then" in said
    assert "its emulated encoder sent nothing then" in said
