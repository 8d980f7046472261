"""The CANopen driver and its emulator, over socketcand."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import can
import numpy as np
import pytest

from daq.block import Flag
from daq.clock import SystemClock
from daq.errors import (
    DeviceLost,
    InstrumentError,
    InstrumentRefused,
    InstrumentSilent,
)
from drivers.canopen_cia406.emulator.process import EncoderSetup
from drivers.canopen_cia406.encoder import CanopenEncoder
from drivers.canopen_cia406.link import SocketcandBus
from drivers.protocols.encoder import PositionBlock, PositionStatistics
from drivers.rehearsal import Rehearsed
from tests.drivers.encoders import PATIENCE_S, emulated, opened, slow_shaft, socketcand, turning

COUNTS = 4096


def read_all(encoder: CanopenEncoder, upto: int) -> PositionBlock:
    """Return every position with a number below `upto` or a little more, as one block."""
    blocks = [encoder.read(100)]
    while blocks[-1].number[-1] < upto - 1:
        blocks.append(encoder.read(100))
    return together(blocks)


def together(blocks: list[PositionBlock]) -> PositionBlock:
    return PositionBlock(
        np.concatenate([block.number for block in blocks]),
        np.concatenate([block.arrival_s for block in blocks]),
        np.concatenate([block.timestamp_s for block in blocks]),
        np.concatenate([block.counts for block in blocks]),
        tuple(gap for block in blocks for gap in block.gaps),
        Flag(max(block.flags for block in blocks)),
    )


def read_until_lost(encoder: CanopenEncoder) -> tuple[PositionBlock, InstrumentError]:
    blocks: list[PositionBlock] = []
    while True:
        try:
            blocks.append(encoder.read(50))
        except InstrumentError as error:
            return together(blocks), error


def unwrapped(block: PositionBlock, total_range: int = COUNTS) -> np.ndarray[Any, Any]:
    return np.unwrap(block.counts, period=total_range)


def test_a_second_of_positions_at_1_khz() -> None:
    rev_per_s = 1.7
    setup = EncoderSetup(clock_offset_s=-3.25, jitter_s=50e-6)
    clock = SystemClock()
    with emulated(setup, turning(rev_per_s)) as address, opened(socketcand(address)) as encoder:
        origin_s = clock.unix_ns() * 1e-9 - clock.monotonic_s() - 3.25
        encoder.start()
        block = read_all(encoder, 1000)
        statistics = encoder.statistics
    assert np.array_equal(block.number, np.arange(len(block.number)))
    assert (block.gaps, block.flags, statistics.missing) == ((), Flag.GOOD, 0)
    # Each position is the shaft's at the timestamp, by the sender's own clock; a count is 0.14 ms.
    # One count for rounding, one for jitter, one for the two readings of the clocks above.
    turns = (block.timestamp_s - origin_s) * rev_per_s
    apart = (block.counts - turns * COUNTS + COUNTS / 2) % COUNTS - COUNTS / 2
    assert np.max(np.abs(apart)) < 3.0
    assert np.all(np.diff(block.arrival_s) >= 0.0)


def at_frame(kind: str, frame: int, value: float | None = None) -> Rehearsed:
    """A fault of the table at a position frame, from 0, counted since the node was started."""
    return Rehearsed(f"encoder.{kind}", (frame - 0.5) * 1e-3, {} if value is None else {"value": value})


def random_faults(frames: int, rate: float, seed: int) -> dict[int, Rehearsed]:
    """Faults for a share `rate` of the first frames, 8 apart so that each can be told from the next."""
    kinds: tuple[str, ...] = ("duplicate", "reorder", "missing", "wrong_length")
    generator = np.random.default_rng(seed)
    faults: dict[int, Rehearsed] = {}
    for frame in np.flatnonzero(generator.random(frames) < rate).tolist():
        if frame >= max(faults, default=0) + 8:
            faults[frame] = at_frame(kinds[int(generator.integers(len(kinds)))], frame)
    return faults


def test_random_faults_are_all_found_and_nothing_else() -> None:
    faults = random_faults(1500, 0.05, seed=5)
    kinds = [fault.kind for fault in faults.values()]
    assert {kinds.count(kind) > 5 for kind in ("duplicate", "reorder", "missing", "wrong_length")} == {True}
    # 7 counts a frame: no two frames within reach of each other have the same position.
    shaft = turning(7.0 / COUNTS / 1e-3)
    with (
        emulated(EncoderSetup(faults=tuple(faults.values())), shaft) as address,
        opened(socketcand(address)) as encoder,
    ):
        encoder.start()
        block = read_all(encoder, 1520)
        statistics = encoder.statistics
    lost = [frame for frame, fault in faults.items() if fault.kind in ("missing", "wrong_length")]
    assert sorted(set(range(block.number[-1] + 1)) - set(block.number.tolist())) == lost
    assert [gap.first_frame for gap in block.gaps] == lost
    assert {gap.count for gap in block.gaps} == {1}
    assert statistics == replace(
        PositionStatistics(),
        frames=statistics.frames,
        missing=len(lost),
        duplicates=kinds.count("duplicate"),
        reordered=kinds.count("reorder"),
        wrong_length=kinds.count("wrong_length"),
        period_ppm=statistics.period_ppm,
    )
    moved = unwrapped(block) - block.counts[0]
    assert np.max(np.abs(moved - 7 * (block.number - block.number[0]))) <= 1  # rounding down to a count


@pytest.mark.parametrize(
    ("kind", "match"),
    [
        ("bus_off", "connection is lost: the bus is off"),
        ("hang_up", r"connection is lost: receiving failed \(.*it closed the connection"),
        ("garbage", r"connection is lost: receiving failed \(Failed to receive: invalid literal"),
        ("heartbeat_stops", r"connection is lost: no heartbeat for 0\.\d+ s, more than 3 periods \(0\.9 s\)"),
        ("pre_operational", "fell back to pre-operational; its settings are no longer certain"),
        ("restart", "fell back to (boot-up|pre-operational)"),
    ],
)
def test_lost_within_a_second_naming_the_last_good_position(kind: str, match: str) -> None:
    setup = EncoderSetup(faults=(at_frame(kind, 800),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        block, error = read_until_lost(encoder)
        assert isinstance(error, DeviceLost)
        with pytest.raises(DeviceLost, match=match):
            encoder.read(1)
    last = f"frame {block.number[-1]}, {block.counts[-1]} counts at {block.timestamp_s[-1]:.6f} s"
    assert f"last good position: {last}" in error.what
    assert "open it again" in error.check
    # Everything up to the fault was handed out first, and what came within the second after it at most.
    assert np.array_equal(block.number, np.arange(len(block.number)))
    # python-can gives up up to 1 KiB with a line that it cannot read, of 44 bytes each.
    assert 799 - (1024 // 44 if kind == "garbage" else 0) <= block.number[-1] <= 800 + 1000


def test_a_heartbeat_is_required_and_set_where_there_is_none_or_too_slow_a_one() -> None:
    # 5 s would be noticed after 15; the driver asks for 0.1 s instead, which the emulator then must keep.
    setup = EncoderSetup(heartbeat_ms=5000, faults=(at_frame("heartbeat_stops", 400),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        _, error = read_until_lost(encoder)
        assert "more than 3 periods (0.6 s)" in error.what


def test_no_position_although_it_lives() -> None:
    setup = EncoderSetup(faults=(at_frame("positions_stop", 100),))
    with emulated(setup) as address, opened(socketcand(address, timeout_s=1.0)) as encoder:
        encoder.start()
        assert len(encoder.read(90).number) == 90
        with pytest.raises(
            InstrumentSilent, match=r"10 of 50 positions within 1\.\d+ s; last good.*frame 99"
        ):
            encoder.read(50)
        assert len(encoder.read(10).number) == 10


def test_an_overrun_of_the_interface_is_a_gap_and_an_event() -> None:
    setup = EncoderSetup(faults=(at_frame("receive_overrun", 150),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        block = read_all(encoder, 300)
        notices = encoder.take_notices()
        assert encoder.statistics.receiver_overruns == 1
    assert [(gap.first_frame, gap.count) for gap in block.gaps] == [(150, 1)]
    assert block.gaps[0].cause == "receive buffer of the interface overran"
    assert block.flags == Flag.SAMPLES_MISSING_BEFORE
    assert [(notice.level, notice.code) for notice in notices] == [("error", "encoder.receiver_overrun")]


def test_an_error_frame_is_counted_and_told() -> None:
    setup = EncoderSetup(faults=(at_frame("error_frame", 50),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        block = read_all(encoder, 100)
        assert [notice.text for notice in encoder.take_notices()] == ["error frame, class 080h"]
        assert encoder.take_notices() == ()
        assert (encoder.statistics.error_frames, block.gaps) == (1, ())


def test_an_emergency_is_there_for_an_interlock() -> None:
    setup = EncoderSetup(faults=(at_frame("emergency", 50, 0x5000),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        assert encoder.emergencies == ()
        encoder.start()
        read_all(encoder, 200)
        assert [(found.code, found.register) for found in encoder.emergencies] == [(0x5000, 1)]


def test_an_emergency_that_is_over() -> None:
    setup = EncoderSetup(faults=(at_frame("emergency", 50, 0x5000), at_frame("emergency", 100, 0)))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        block = read_all(encoder, 300)
        assert encoder.emergencies == ()
        codes = [(notice.level, notice.code, notice.text) for notice in encoder.take_notices()]
    assert codes == [
        ("error", "encoder.emergency", "emergency 5000h (Device Hardware), register 01h"),
        ("info", "encoder.emergency_over", "Error Reset / No Error"),
    ]
    assert block.gaps == ()


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_a_clock_that_is_set_is_told_and_nothing_is_lost(step_s: float) -> None:
    setup = EncoderSetup(faults=(at_frame("clock_jump", 200, step_s),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        block = read_all(encoder, 500)
        notices = [notice.code for notice in encoder.take_notices()]
    assert np.array_equal(block.number, np.arange(len(block.number)))
    assert block.flags == Flag.GOOD
    assert notices == ["encoder.clock_step"]
    assert np.diff(block.timestamp_s) == pytest.approx(1e-3, abs=1e-4)  # jitter is 20 us


@pytest.mark.parametrize(("ppm", "clock_ppm"), [(100.0, 0.0), (-100.0, 0.0), (0.0, 100.0)])
def test_drift_is_measured_and_left_in_the_data(ppm: float, clock_ppm: float) -> None:
    setup = EncoderSetup(period_ppm=ppm, clock_ppm=clock_ppm)
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        block = read_all(encoder, 1000)
        measured = encoder.statistics.period_ppm
    # Jitter is uniform over 20 us, sd 5.8 us: sd of the slope over 1000 frames is 0.64 ppm.
    assert measured == pytest.approx(ppm + clock_ppm, abs=5 * 0.64)
    slope = np.polyfit(block.number, block.timestamp_s - block.timestamp_s[0], 1)[0]
    assert (slope / 1e-3 - 1) * 1e6 == pytest.approx(ppm + clock_ppm, abs=5 * 0.64)


def test_positions_that_nobody_reads_are_a_gap_of_exact_length() -> None:
    with emulated(EncoderSetup()) as address, opened(socketcand(address, buffer_s=0.1)) as encoder:
        encoder.start()
        until(lambda: encoder.statistics.queue_overruns >= 50)
        block = read_all(encoder, 400)
        statistics = encoder.statistics
        assert "encoder.overrun" in [notice.code for notice in encoder.take_notices()]
    lost = block.number[-1] + 1 - len(block.number)
    assert sum(gap.count for gap in block.gaps) == lost >= 50
    assert block.gaps[0].first_frame == 100
    assert {gap.cause for gap in block.gaps} == {"not read in time"}
    assert block.flags == Flag.SAMPLES_MISSING_BEFORE
    assert statistics.missing == statistics.queue_overruns


def until(happened: Callable[[], bool]) -> None:
    clock = SystemClock()
    deadline_s = clock.monotonic_s() + 20.0
    while not happened():
        assert clock.monotonic_s() < deadline_s
        clock.sleep(0.005)


@pytest.mark.parametrize(("revolutions", "rev_per_s"), [(1, 3.0), (1, -3.0), (16, 3.0), (16, -3.0)])
def test_rollover(revolutions: int, rev_per_s: float) -> None:
    # It starts at either end of its range whatever the shaft's angle is, by preset.
    setup = EncoderSetup(revolutions=revolutions)
    with emulated(setup, turning(rev_per_s)) as address, opened(socketcand(address)) as encoder:
        encoder.preset(COUNTS * revolutions - 1 if rev_per_s > 0 else 0)
        encoder.start()
        block = read_all(encoder, 300)
    total = COUNTS * revolutions
    assert np.all((block.counts >= 0) & (block.counts < total))
    step = np.diff(unwrapped(block, total))
    assert np.max(np.abs(step - rev_per_s * COUNTS * 1e-3)) <= 1.5  # rounding down, and jitter of 20 us


def test_preset_out_of_range_is_not_sent() -> None:
    with emulated(EncoderSetup()) as address, opened(socketcand(address)) as encoder:
        with pytest.raises(InstrumentRefused, match="preset 4096 is outside 0 to 4095 counts"):
            encoder.preset(COUNTS)
        encoder.preset(COUNTS - 1)


def test_synchronous_positions_of_tpdo_2_are_none_of_ours() -> None:
    with emulated(EncoderSetup()) as address, opened(socketcand(address)) as encoder:
        host, port = address.split(":")
        encoder.start()
        with SocketcandBus("can0", host, int(port), timeout_s=PATIENCE_S) as other:
            for _ in range(20):
                other.send(can.Message(arbitration_id=0x80, is_extended_id=False))
            seen: set[int] = set()
            while 0x287 not in seen:
                message = other.recv(5.0)
                assert message is not None
                seen.add(message.arbitration_id)
        block = read_all(encoder, 200)
        assert np.array_equal(block.number, np.arange(len(block.number)))
        assert encoder.statistics.duplicates == 0


def test_again_after_stopping_and_after_opening_anew() -> None:
    with emulated(EncoderSetup()) as address, opened(socketcand(address)) as encoder:
        for _ in range(2):
            for _ in range(2):
                encoder.start()
                assert encoder.read(20).number[0] == 0
                encoder.stop()
            encoder.close()
            encoder.close()
            with pytest.raises(DeviceLost, match="is not open"):
                encoder.read(1)
            encoder.open()
        with pytest.raises(DeviceLost, match="it was not started"):
            encoder.read(1)


def test_opening_it_twice_hangs_up_first() -> None:
    with emulated(EncoderSetup()) as address, opened(socketcand(address)) as encoder:
        encoder.open()
        assert [thread.name for thread in threading.enumerate()].count("encoder") == 1
        encoder.start()
        assert encoder.read(20).number[0] == 0
        assert encoder.statistics.duplicates == 0


def test_a_lost_encoder_does_not_resume_by_itself() -> None:
    setup = EncoderSetup(faults=(at_frame("pre_operational", 600),))
    with emulated(setup) as address, opened(socketcand(address)) as encoder:
        encoder.start()
        read_until_lost(encoder)
        with opened(socketcand(address)) as other:  # whoever starts it
            other.start()
            other.read(20)
            with pytest.raises(DeviceLost, match="fell back to pre-operational"):
                encoder.read(1)
        encoder.close()
        encoder.open()
        encoder.start()
        assert encoder.read(20).number[0] == 0


def test_shafts_are_in_radians() -> None:
    assert slow_shaft()(1.0) == pytest.approx(1.7 * math.tau)


def test_an_encoder_that_is_stuck_sends_on_and_only_its_position_shows_it() -> None:
    with (
        emulated(EncoderSetup(faults=(at_frame("stuck", 100),))) as address,
        opened(socketcand(address)) as encoder,
    ):
        encoder.start()
        block = read_all(encoder, 300)
        assert encoder.take_notices() == ()
    moves = np.flatnonzero(np.diff(block.counts))
    assert 95 <= moves[-1] < 100  # 7 counts a frame up to there
