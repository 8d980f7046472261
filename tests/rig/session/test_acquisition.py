"""What belongs to the record goes to the stream, sample for sample; whatever goes wrong is told."""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest

from daq.block import Flag, sample_time_ns
from daq.channel import Channel
from daq.clock import SystemClock
from daq.errors import InstrumentSilent
from drivers.protocols.card import CardReading, Finding
from rig.files.scenario import Limit
from rig.session.acquisition import READING_S, Acquisition, AcquisitionFault, Reader
from rig.session.interlock import LimitWatch
from rig.stream import Block, Stream
from tests.rig.session.fakes import RATE, Kept, SteppedCard

CHANNELS = (Channel("a", "N"), Channel("b", "N"))
COUNT = round(READING_S * RATE)


def acquisition(
    card: SteppedCard,
    kept: Kept,
    limits: tuple[Limit, ...] = (),
    *readers: Reader,
    warn: Callable[[str], None] = lambda _: None,
) -> Acquisition:
    watch = LimitWatch(limits, RATE)
    return Acquisition(card, SystemClock(), Stream([kept]), watch, readers, warn)  # type: ignore[arg-type]


def advance(acquiring: Acquisition, card: SteppedCard, blocks: int) -> None:
    """Let blocks through and wait until they have been taken."""
    end = acquiring.acquired + blocks * COUNT
    card.let(blocks)
    with acquiring.changed:
        assert acquiring.changed.wait_for(lambda: acquiring.acquired >= end or acquiring.error, 10)


@pytest.mark.parametrize("count", [COUNT * 2, COUNT * 2 + 17, COUNT * 3, 5])
def test_the_record_is_every_sample_from_its_start_to_its_end(count: int) -> None:
    card, kept = SteppedCard(CHANNELS), Kept()
    with acquisition(card, kept) as acquiring:
        advance(acquiring, card, 2)
        begin = acquiring.start_record(count)
        advance(acquiring, card, 4)
        card.let()
    assert begin == 2 * COUNT
    assert card.stopped
    for row, channel in enumerate(CHANNELS):
        blocks = kept.blocks(channel.name)
        values = np.concatenate([block.values for block in blocks])
        assert values.tolist() == (np.arange(begin, begin + count) + 1000.0 * row).tolist()
        assert [block.first_sample for block in blocks] == list(range(0, count, 2 * COUNT))
        start_ns = sample_time_ns(acquiring.base.start_ns, begin, RATE)
        assert [block.time_ns for block in blocks] == [
            sample_time_ns(start_ns, block.first_sample, RATE) for block in blocks
        ]


def test_a_record_that_starts_while_a_block_is_being_taken_has_no_hole() -> None:
    """Whoever starts it gets the index from which on every block is recorded, however the threads run."""
    begun: list[int] = []

    def begin_within(reading: CardReading) -> None:
        if reading.first_sample == COUNT:
            begun.append(acquiring.start_record(2 * COUNT))

    card, kept = SteppedCard(CHANNELS), Kept()
    acquiring = acquisition(card, kept, (), begin_within)
    with acquiring:
        advance(acquiring, card, 5)
        card.let()
    blocks = kept.blocks("a")
    assert begun == [2 * COUNT]
    assert [(block.first_sample, len(block)) for block in blocks] == [(0, 2 * COUNT)]
    assert blocks[0].values[0] == 2 * COUNT


def test_a_flag_is_told_when_it_rises_and_kept_with_its_blocks() -> None:
    card = SteppedCard(CHANNELS, flags=lambda block: Flag.OVERLOAD if block in {2, 3, 5} else Flag.GOOD)
    kept = Kept()
    with acquisition(card, kept) as acquiring:
        advance(acquiring, card, 1)
        acquiring.start_record(6 * COUNT)
        advance(acquiring, card, 6)
        card.let()
    assert kept.codes() == ["sensor.overload"] * 4
    flags = [(block.flags, len(block) // COUNT) for block in kept.blocks("a")]
    good, overload = Flag.GOOD, Flag.OVERLOAD
    assert flags == [(good, 1), (overload, 2), (good, 1), (overload, 1), (good, 1)]
    assert acquiring.overloads == {"a": 3, "b": 3}


@pytest.mark.parametrize("begins", [np.nan, np.inf, -np.inf, -0.0, 1e-40])
def test_odd_values_are_recorded_as_they_are_to_the_bit(begins: float) -> None:
    odd = np.array([begins, np.nan, np.inf, -np.inf, -0.0, 1e-40, -1e-45, 2.5], np.float32)
    names = (Channel("pin.force", "N"), Channel("crank.angle", "rad"))
    card, kept = SteppedCard(names, lambda n, _: odd[n % 8].astype(np.float64)), Kept()
    with acquisition(card, kept) as acquiring:
        acquiring.start_record(2 * COUNT)
        advance(acquiring, card, 2)
        card.let()
    expected = odd[np.arange(2 * COUNT) % 8]
    for name, dtype in (("pin.force", np.float32), ("crank.angle", np.float64)):
        values = np.concatenate([block.values for block in kept.blocks(name)])
        assert values.tobytes() == expected.astype(dtype).tobytes()


def test_an_abort_limit_trips_and_a_warning_only_tells() -> None:
    kept, card = Kept(), SteppedCard(CHANNELS)
    limits = (Limit("a", "N", 1.5 * COUNT, None, 0.0), Limit("b", "N", None, 3.5 * COUNT, 0.0))
    with acquisition(card, kept, limits) as acquiring:
        advance(acquiring, card, 2)
        assert kept.codes() == ["limit.warning"]
        assert acquiring.tripped is None
        advance(acquiring, card, 2)
        assert acquiring.tripped is not None
        assert acquiring.tripped.channel == "b"
        card.let()
    assert kept.codes() == ["limit.warning", "limit.abort"]


def test_a_person_hears_of_the_first_warning_of_each_channel_and_the_log_of_all() -> None:
    kept, said = Kept(), list[str]()
    card = SteppedCard((Channel("a", "N"),), lambda n, _: np.where(n // COUNT % 2, 9.0, 0.0))
    with acquisition(card, kept, (Limit("a", "N", 5.0, None, 0.0),), warn=said.append) as acquiring:
        advance(acquiring, card, 4)
        card.let()
    assert kept.codes() == ["limit.warning"] * 2  # it had come back between
    assert said == ["a = 9 N, warning at 5 N"]


def test_a_card_that_fails_ends_it_with_the_cards_own_words() -> None:
    class BrokenCard(SteppedCard):
        def read(self, count: int) -> CardReading:
            raise InstrumentSilent("card", "fake", "no answer")

    with acquisition(BrokenCard(CHANNELS), Kept()) as acquiring, acquiring.changed:
        assert acquiring.changed.wait_for(lambda: acquiring.error, 10)
    assert isinstance(acquiring.error, InstrumentSilent)


def test_a_reading_that_waited_for_a_second_one_is_recorded_where_the_card_fails_before() -> None:
    class FailingCard(SteppedCard):
        def read(self, count: int) -> CardReading:
            reading = super().read(count)
            if self._block > 2:
                raise InstrumentSilent("card", "fake", "no answer")
            return reading

    card, kept = FailingCard(CHANNELS), Kept()
    with acquisition(card, kept) as acquiring:
        advance(acquiring, card, 1)
        acquiring.start_record(10 * COUNT)
        advance(acquiring, card, 1)
        assert not kept.blocks("a")
        card.let()
        with acquiring.changed:
            assert acquiring.changed.wait_for(lambda: acquiring.error, 10)
    for name in ("a", "b"):
        assert [(block.first_sample, len(block)) for block in kept.blocks(name)] == [(0, COUNT)]


def test_a_fault_in_a_consumer_is_an_error_of_the_acquisition(capfd: pytest.CaptureFixture[str]) -> None:
    card, kept = SteppedCard(CHANNELS), Kept(fails_on=Block)
    with acquisition(card, kept) as acquiring:
        acquiring.start_record(COUNT)
        advance(acquiring, card, 1)
    with pytest.raises(AcquisitionFault, match="acquisition stopped by ZeroDivisionError: a fault"):
        raise acquiring.error or AssertionError
    assert "Traceback" in capfd.readouterr().err


def test_an_angle_stays_64_bits_wide_and_begins_within_a_turn() -> None:
    card = SteppedCard((Channel("crank.angle", "rad"), Channel("b", "N")), lambda n, k: 1e4 + 1e-6 * n)
    kept = Kept()
    with acquisition(card, kept) as acquiring:
        advance(acquiring, card, 1)
        begin = acquiring.start_record(2 * COUNT)
        advance(acquiring, card, 2)
        card.let()
    angle = np.concatenate([block.values for block in kept.blocks("crank.angle")])
    assert angle.dtype == np.float64
    assert kept.blocks("b")[0].values.dtype == np.float32
    whole = 2 * np.pi * np.floor((1e4 + 1e-6 * begin) / (2 * np.pi))
    assert acquiring.turned_off == {"crank.angle": whole}
    expected = 1e4 + 1e-6 * (begin + np.arange(2 * COUNT)) - whole
    assert angle == pytest.approx(expected, abs=1e-9)
    assert 0 <= angle[0] < 2 * np.pi


def test_a_record_ends_with_the_reading_that_was_enough() -> None:
    seen: list[int] = []

    def end(reading: CardReading) -> None:
        seen.append(sum(len(block) for block in kept.blocks("b")))
        if len(seen) == 4:
            acquiring.end_record(reading)

    card, kept = SteppedCard(CHANNELS), Kept()
    acquiring = acquisition(card, kept, (), end)
    with acquiring:
        advance(acquiring, card, 1)
        acquiring.start_record(10 * COUNT)
        advance(acquiring, card, 5)
        assert acquiring.record_until == 4 * COUNT
        card.let()
    assert seen[:5] == [0, 0, 2 * COUNT, 2 * COUNT, 3 * COUNT]  # every second reading makes a block
    assert sum(len(block) for block in kept.blocks("a")) == 3 * COUNT


def test_what_a_card_finds_is_told() -> None:
    class FindingCard(SteppedCard):
        def read(self, count: int) -> CardReading:
            reading = super().read(count)
            found = (Finding("a", "supply", "its supply is overloaded"),) if reading.first_sample == 0 else ()
            return CardReading(reading.first_sample, reading.values, reading.flags, reading.arrived_s, found)

    card = FindingCard(CHANNELS, flags=lambda block: Flag.CLOCK_NOT_LOCKED if block else Flag.GOOD)
    kept = Kept()
    with acquisition(card, kept) as acquiring:
        advance(acquiring, card, 2)
        card.let()
    assert kept.codes() == ["sensor.supply", "sensor.clock_not_locked", "sensor.clock_not_locked"]


class Stalled(io.StringIO):
    """A terminal that takes nothing more."""

    def __init__(self) -> None:
        super().__init__()
        self.reads_on = threading.Event()

    def write(self, text: str) -> int:
        self.reads_on.wait()
        return len(text)


class Full(io.StringIO):
    def write(self, text: str) -> int:
        raise OSError(28, "No space left on device")


@pytest.mark.parametrize("how", ["stalled", "full", "closed"])
def test_a_fault_is_there_for_the_guard_whatever_the_terminal_does(
    monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    card, kept, terminal = SteppedCard(CHANNELS), Kept(fails_on=Block), Stalled()
    shown = {"stalled": terminal, "full": Full(), "closed": io.StringIO()}[how]
    if how == "closed":
        shown.close()
    uncaught = list[object]()
    monkeypatch.setattr(threading, "excepthook", uncaught.append)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", shown)
        with acquisition(card, kept) as acquiring:
            acquiring.start_record(COUNT)
            advance(acquiring, card, 1)
            with pytest.raises(AcquisitionFault, match="acquisition stopped by ZeroDivisionError"):
                acquiring.check()
            terminal.reads_on.set()
    assert uncaught == []
