"""An encoder beside the card: every position of the record, none twice, gaps and faults told."""

from __future__ import annotations

import io
import math
import sys
import threading
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.block import Flag
from daq.errors import DeviceLost, InterlockTripped
from daq.time_base.clocks import CardClock
from drivers.protocols.encoder import Emergency, PositionBlock, PositionGap, PositionStatistics
from drivers.protocols.instrument import Notice
from rig.session import encoder_record
from rig.session.acquisition import AcquisitionFault
from rig.session.encoder_record import ENCODER_CHANNEL, HANGS_S, EncoderRecord
from rig.session.interlock import guards_of_shaft
from rig.stream import Stream
from tests.rig.session.fakes import Kept
from tests.rig.session.shafts import SteppedClock

Array = NDArray[np.float64]
COUNTS, PERIOD_S, BLOCK = 4096, 1e-3, 100
OMEGA = 200.0 * math.tau / 60.0
DELAY_S = 2e-3


def steady(taken_s: Array) -> Array:
    return OMEGA * taken_s


class SteppedEncoder:
    """Sends the blocks that the test lets through; `missing` frames never come. `angle` is in rad over s."""

    name, address, identity = "encoder", "fake", "a fake"
    counts_per_revolution, total_range, period_s = COUNTS, COUNTS, PERIOD_S
    statistics = PositionStatistics()

    def __init__(self, missing: frozenset[int], angle: Callable[[Array], Array]) -> None:
        self._angle, self.stamp = angle, lambda taken_s: 5e5 + taken_s
        self.emergencies: tuple[Emergency, ...] = ()
        self.notices: list[Notice] = []
        self.lost = False
        self.stopped = False
        self._missing, self._next, self._zero_s = missing, 0, 0.0
        self._allowed = threading.Semaphore(0)

    def sends_from(self, zero_s: float) -> None:
        self._zero_s = zero_s

    def let(self, blocks: int) -> None:
        self._allowed.release(blocks)

    def start(self) -> None:
        self._next = 0

    def read(self, count: int) -> PositionBlock:
        assert self._allowed.acquire(timeout=10)
        if self.lost:
            raise DeviceLost(self.name, self.address, "the connection is lost; last good position: frame 42")
        number = np.arange(self._next, self._next + count)
        self._next += count
        kept = np.array([each not in self._missing for each in number])
        taken = number * PERIOD_S
        counts = np.floor(self._angle(taken) / math.tau * COUNTS).astype(np.int64) % self.total_range
        gaps = tuple(PositionGap(int(each), 1, "lost on the bus") for each in number[~kept])
        arrival = self._zero_s + taken + DELAY_S
        return PositionBlock(number[kept], arrival[kept], self.stamp(taken[kept]), counts[kept], gaps)

    def take_notices(self) -> tuple[Notice, ...]:
        notices, self.notices = tuple(self.notices), []
        return notices

    def stop(self) -> None:
        self.stopped = True


class Lab:
    """An encoder record that has begun, and what came of it."""

    def __init__(
        self,
        missing: frozenset[int] = frozenset(),
        angle: Callable[[Array], Array] = steady,
        turns: int = 1,
        encoder: SteppedEncoder | None = None,
    ) -> None:
        self.clock, self.kept = SteppedClock(), Kept()
        self.base = CardClock(self.clock, 25_600.0)
        self.base.start(lambda: None)
        zero_s = self.clock.now_s
        for number in range(1, 40):  # 4 s of blocks: the host's clock is known
            self.clock.now_s = zero_s + number * 0.1 + 1e-3
            self.base.arrived(number * 2560, self.clock.now_s)
        self.base.refit(at_last=True)
        self.encoder = encoder or SteppedEncoder(missing, angle)
        self.encoder.total_range = turns * COUNTS
        self.encoder.sends_from(zero_s)
        self.guard = guards_of_shaft(self.clock)[1]
        stream = Stream([self.kept])
        self.record = EncoderRecord(self.encoder, self.base, stream, 1.5 * OMEGA, self.guard)
        self._let = 0

    def advance(self, blocks: int) -> None:
        """Let blocks through and wait until they have been taken."""
        self._let += blocks
        self.encoder.let(blocks)
        self._await(lambda: self.record._next_number >= self._let * BLOCK)

    def end(self) -> None:
        self.encoder.let(2)

    def _await(self, holds: Callable[[], bool]) -> None:
        waiting = threading.Event()
        for _ in range(1000):
            if holds() or self.record.error is not None:
                return
            waiting.wait(0.01)
        raise AssertionError("never")

    def recorded(self, begin_s: float, end_s: float, blocks: int, before: int = 5) -> list[Any]:
        with self.record:
            self.advance(before)
            self.record.begin(begin_s)
            self.record.end(end_s)
            self.advance(blocks)
            self.end()
        return self.kept.blocks(ENCODER_CHANNEL)


def test_an_encoder_of_which_no_position_ever_comes_hangs() -> None:
    lab = Lab()
    with lab.record:
        assert not lab.record.hangs
        lab.clock.now_s += HANGS_S + 0.1
        assert lab.record.hangs
        lab.end()


def test_the_record_is_every_position_between_its_start_and_its_end() -> None:
    blocks = Lab().recorded(0.35, 1.25, 12)
    values = np.concatenate([block.values for block in blocks])
    assert values.dtype == np.float64
    assert [block.first_sample for block in blocks] == np.cumsum([0, *map(len, blocks)])[:-1].tolist()
    # What its frames are late, 2 ms, cannot be told from a skew: they are placed so much late.
    assert len(values) == pytest.approx(900, abs=2)
    begun = round(OMEGA * 0.348 / math.tau * COUNTS) / COUNTS * math.tau
    assert values[0] == pytest.approx(begun % math.tau, abs=OMEGA * 3e-3)
    assert np.diff(values) == pytest.approx(OMEGA * PERIOD_S, abs=math.tau / COUNTS * 1.01)


def test_it_begins_within_a_turn_and_says_where_each_block_lies() -> None:
    lab = Lab()
    blocks = lab.recorded(0.65, 1.25, 12, before=10)
    assert 0 <= blocks[0].values[0] < math.tau
    at_s = [(block.time_ns - lab.base.start_ns) / 1e9 for block in blocks]
    expected = [0.65 + block.first_sample * PERIOD_S for block in blocks]
    assert at_s == pytest.approx(expected, abs=2e-3)
    assert {block.sample_rate for block in blocks} == {1 / PERIOD_S}


def test_blocks_are_not_locked_until_its_clock_is_known() -> None:
    lab = Lab()
    with lab.record:
        lab.record.begin(0.0)
        lab.advance(5)
        assert lab.record.clocks(True)[0].device == "encoder"
        lab.advance(2)
        lab.end()
    flags = [block.flags for block in lab.kept.blocks(ENCODER_CHANNEL)]
    assert flags[:5] == [Flag.CLOCK_NOT_LOCKED] * 5
    assert flags[5:7] == [Flag.GOOD] * 2


def test_positions_that_are_missing_are_a_gap_with_its_cause_and_cost_no_turn() -> None:
    lab = Lab(missing=frozenset({*range(730, 760), 900}))
    blocks = lab.recorded(0.35, 1.25, 12)
    first = blocks[0]
    begin = round((first.time_ns - lab.base.start_ns) / 1e9 / PERIOD_S - 2)  # the frame at which it begins
    assert sum(gap.count for gap in lab.kept.gaps) == 31
    assert {gap.cause for gap in lab.kept.gaps} == {"lost on the bus"}
    assert lab.kept.gaps[0].first_sample == pytest.approx(730 - begin, abs=1)
    after = next(block for block in blocks if block.flags & Flag.SAMPLES_MISSING_BEFORE)
    passed = (after.first_sample - first.first_sample) * PERIOD_S
    assert after.values[0] - first.values[0] == pytest.approx(OMEGA * passed, abs=2 * math.tau / COUNTS)
    assert lab.kept.codes() == []


@pytest.mark.parametrize(
    ("missing", "begun", "told"),
    [
        (range(330, 380), 380 - 348, [(0, 380 - 348)]),  # all placed 2 ms late
        (range(1220, 1290), 0, [(1220 - 348, 1248 - 1220)]),
        ([*range(330, 390), *range(1210, 1290)], 390 - 348, [(0, 390 - 348), (1210 - 348, 1248 - 1210)]),
    ],
)
def test_positions_that_are_missing_at_either_end_of_the_record_are_a_gap_too(
    missing: Iterable[int], begun: int, told: list[tuple[int, int]]
) -> None:
    lab = Lab(frozenset(missing))
    blocks = lab.recorded(0.35, 1.25, 12)
    first = blocks[0].first_sample
    assert first == pytest.approx(begun, abs=2)
    gaps = np.concatenate([gap.first_sample + np.arange(gap.count) for gap in lab.kept.gaps])
    recorded = np.concatenate([block.first_sample + np.arange(len(block)) for block in blocks])
    every = np.sort(np.concatenate([gaps, recorded]))
    assert every.tolist() == list(range(len(every)))
    assert len(every) == pytest.approx(900, abs=2)
    assert len(gaps) == pytest.approx(sum(count for _, count in told), abs=2 * len(told))
    assert {gap.cause for gap in lab.kept.gaps} == {"lost on the bus"}
    at_s = (blocks[0].time_ns - lab.base.start_ns) / 1e9
    assert at_s == pytest.approx(0.35 + first * PERIOD_S, abs=2e-3)
    assert lab.record.due(math.inf) == len(every)


def test_a_gap_in_which_the_shaft_may_have_turned_either_way_is_told() -> None:
    lab = Lab(missing=frozenset(range(605, 795)))  # 0.19 s at 3.3 turns a second
    lab.recorded(0.35, 1.25, 12)
    assert "encoder.ambiguous" in lab.kept.codes()


def test_an_emergency_is_an_interlock_and_notices_are_events() -> None:
    lab = Lab()
    with lab.record:
        lab.advance(1)
        lab.record.check()
        lab.encoder.emergencies = (Emergency(0.0, 0x5000, 1, b"", "hardware"),)
        lab.encoder.notices.append(Notice(lab.clock.now_s, "error", "encoder.emergency", "emergency 5000h"))
        with pytest.raises(InterlockTripped, match=r"emergency 5000h of the encoder \(hardware\)"):
            lab.record.check()
        (event,) = lab.record.events()
        assert (event.code, event.level) == ("encoder.emergency", "error")
        assert event.time_ns - lab.base.start_ns == pytest.approx(3.9e9, abs=2e6)
        lab.end()
    assert lab.encoder.stopped


def test_a_lost_encoder_ends_the_run_in_its_own_words() -> None:
    lab = Lab()
    with lab.record:
        lab.advance(1)
        lab.encoder.lost = True
        lab.advance(1)
        with pytest.raises(DeviceLost, match="last good position: frame 42"):
            lab.record.check()


def guarded(lab: Lab, blocks: int, before: int = 10) -> list[str]:
    """Arm the guard once the encoder has been seen for a second; what is told from there on."""
    with lab.record:
        lab.advance(before)
        lab.guard.arm(OMEGA)
        lab.advance(blocks)
        lab.end()
    return [code for code in lab.kept.codes() if code.startswith("speed.")]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_encoder_that_turns_as_the_shaft_does_is_nothing_whichever_way_it_counts(way: float) -> None:
    # 2 % of ripple, losses of 1 % and of a burst that a shaft cannot have turned half way round in
    lost = frozenset({*range(1500, 1560), *np.random.default_rng(1).integers(0, 3000, 30).tolist()})
    lab = Lab(lost, lambda at: way * (steady(at) + 0.02 * np.sin(steady(at))))
    assert guarded(lab, 20) == []
    lab.guard.check()


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (0.0, "encoder shows 0 rpm, wanted 200 rpm for 0.5 s"),  # its coupling came off
        (0.8, "encoder shows 160 rpm, wanted 200 rpm for 0.5 s"),  # its belt slips
        (1.2, "encoder shows 240 rpm, wanted 200 rpm for 0.5 s"),  # it runs away
        (3.0, "the encoder shows no speed for 1.0 s"),  # faster than its turns can be counted
    ],
)
def test_an_encoder_that_contradicts_the_wanted_speed_is_an_interlock(after: float, said: str) -> None:
    lab = Lab(angle=lambda at: OMEGA * (np.minimum(at, 2.0) + after * np.maximum(at - 2.0, 0.0)))
    codes = guarded(lab, 27)
    assert codes[-1] == "speed.abort"
    with pytest.raises(InterlockTripped, match=f"interlock: {said}"):
        lab.guard.check()


def test_one_wrong_position_is_told_and_trips_nothing() -> None:
    def glitched(at: Array) -> Array:
        return steady(at) + np.where(np.round(at / PERIOD_S) == 2050, 2.0, 0.0)

    lab = Lab(angle=glitched)
    assert guarded(lab, 20) == ["speed.unknown"]
    assert "encoder.ambiguous" in lab.kept.codes()
    lab.guard.check()


def rocking(at: Array) -> Array:
    return 0.4 * math.tau / COUNTS * np.sin(700.0 * at)  # to and fro over the end of its range


@pytest.mark.parametrize("turns", [1, 16, 4096])
@pytest.mark.parametrize("angle", [steady, lambda at: -steady(at), rocking])
def test_the_end_of_its_range_leaves_no_trace(turns: int, angle: Callable[[Array], Array]) -> None:
    # It passes the end half a second after the record has begun.
    lab = Lab(angle=lambda at: angle(at - 0.85), turns=turns)
    values = np.concatenate([block.values for block in lab.recorded(0.35, 1.25, 12)])
    counts = np.rint(values / math.tau * COUNTS)
    begun = round((lab.kept.blocks(ENCODER_CHANNEL)[0].time_ns - lab.base.start_ns) / 1e6) - 2
    taken = (begun + np.arange(len(values))) * PERIOD_S
    expected = np.floor(angle(taken - 0.85) / math.tau * COUNTS)
    assert counts - counts[0] == pytest.approx(
        expected - expected[0], abs=14
    )  # begun to a frame: 13.7 counts
    steps, moves = np.diff(counts), np.diff(expected)
    assert (steps.min(), steps.max()) == (moves.min(), moves.max())
    assert "encoder.ambiguous" not in lab.kept.codes()


def test_what_was_wrong_with_its_frames_is_told_at_the_end() -> None:
    lab = Lab()
    lab.encoder.statistics = PositionStatistics(frames=1700, duplicates=2, wrong_length=1, period_ppm=12.5)
    lab.recorded(0.35, 1.25, 12)
    (event,) = [each for each in lab.kept.events if each.code == "encoder.frames"]
    assert (event.level, event.text) == ("warning", "of 1700 positions: duplicates 2, wrong length 1")


@pytest.mark.parametrize(("ppm", "step_s"), [(100.0, 0.0), (-100.0, 0.0), (0.0, 3600.0), (0.0, -3600.0)])
def test_a_clock_that_drifts_or_is_set_is_said_and_moves_no_sample(ppm: float, step_s: float) -> None:
    # Drift is counted from the record's beginning, so that its first sample is that of a clock that is right.
    def stamp(taken_s: Array) -> Array:
        return 5e5 + taken_s + (taken_s - 10.0) * ppm * 1e-6 + np.where(taken_s > 12.0, step_s, 0.0)

    kept = []
    for each in (stamp, lambda taken_s: 5e5 + taken_s):
        lab = Lab()
        lab.encoder.stamp = each
        with lab.record:
            lab.advance(100)
            (clock,) = lab.record.clocks(True)
            lab.record.begin(10.0)
            lab.record.end(19.0)
            lab.advance(100)
            lab.record.clocks(True)
            lab.end()
        kept.append(np.concatenate([block.values for block in lab.kept.blocks(ENCODER_CHANNEL)]))
        # No jitter: its rate is as good as known; the host's own is uncertain by a crystal's 50 ppm.
        if each is stamp:
            assert clock.rate_ppm == pytest.approx(-ppm, abs=5.0)
            assert lab.kept.codes() == (["clock.step"] if step_s else [])
    drifted, right = kept
    shared = min(len(drifted), len(right))
    assert abs(len(drifted) - len(right)) <= 2  # where the record ends is by its clock
    assert np.array_equal(drifted[:shared], right[:shared])


def test_a_fault_of_ours_that_waits_to_be_told_is_not_late_besides(monkeypatch: pytest.MonkeyPatch) -> None:
    def angle(taken_s: Array) -> Array:
        if taken_s[0] > 0.0:
            raise ZeroDivisionError("a fault")
        return steady(taken_s)

    due_s, lab = list[float](), Lab(angle=angle)
    monkeypatch.setattr(encoder_record, "show_fault", lambda error: due_s.append(lab.record._due_s))
    with lab.record:
        lab.advance(2)
    assert due_s == [math.inf]


def test_a_fault_of_ours_is_told_though_the_terminal_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    def angle(taken_s: Array) -> Array:
        raise ZeroDivisionError("a fault")

    uncaught, terminal, lab = list[object](), io.StringIO(), Lab(angle=angle)
    terminal.close()
    monkeypatch.setattr(threading, "excepthook", uncaught.append)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", terminal)
        with lab.record:
            lab.advance(1)
    with pytest.raises(AcquisitionFault, match="encoder stopped by ZeroDivisionError"):
        lab.record.check()
    assert uncaught == []
