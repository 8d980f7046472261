"""A log through the path of a live run: every block in order, at the pace that was asked for."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from daq.block import NS_PER_S, SampleBlock, sample_time_ns
from daq.errors import LogError
from daq.log.reader import LogReader
from daq.log.records import Event
from daq.log.writer import LogWriter
from rig.bounds import Bounds
from rig.derived.settings import RECORD
from rig.live.picture import Layout
from rig.live.view import LiveView
from rig.session.overlay import overlay_run
from rig.session.replay import ShapeFollower, replay_log
from rig.session.signals import Stopped
from rig.stream import Block, Record, Shape
from rig.twin.logged import predicting_twin, scenario_of
from tests.hostile import bounded
from tests.rig.session.fakes import Kept, silent_screen
from tests.rig.synthetic_run import CHANNELS, RATE, SCENARIO, START_NS, write_log

SAMPLES = Path(__file__).parents[3].parent / "shared" / "samples"


class SteppedClock:
    """Time passes only while somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def unix_ns(self) -> int:
        return round(self.now_s * NS_PER_S)

    def monotonic_s(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class Timed(Kept):
    """Notes when each block came."""

    def __init__(self, clock: SteppedClock) -> None:
        super().__init__()
        self._clock = clock
        self.at_s: list[tuple[float, float]] = []

    def __call__(self, record: Record) -> None:
        super().__call__(record)
        match record:
            case Block("measured" | "predicted" | "nominal", samples):
                self.at_s.append((self._clock.now_s - 100.0, samples.end_sample / samples.sample_rate))


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(tmp_path / "log.mcap", seconds=1.0, origins=("measured", "predicted", "nominal"))


@pytest.mark.parametrize("cut", [False, True])
def test_every_block_and_event_comes_once_and_in_order(log: Path, tmp_path: Path, cut: bool) -> None:
    if cut:
        content = log.read_bytes()
        log = tmp_path / "cut.mcap"
        log.write_bytes(content[: len(content) * 9 // 10])
    with LogReader(log) as reader:
        assert reader.complete != cut
        expected = {(o, b.channel, b.first_sample): b.values.tobytes() for o, b in reader.blocks()}
        events = reader.events()
    kept = Kept()
    assert replay_log(log, 0, None, silent_screen(), SteppedClock(), (kept,)) == len(expected)
    played = [each for each in kept.records if isinstance(each, Block) and each.origin != "derived"]
    blocks = [(each.origin, each.samples) for each in played]
    assert {(o, b.channel, b.first_sample): b.values.tobytes() for o, b in blocks} == expected
    assert len(blocks) == len(expected)
    ends = [block.end_sample for _, block in blocks]
    assert ends == sorted(ends)
    assert kept.events == events


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_it_keeps_the_pace_of_the_record(log: Path, speed: float) -> None:
    clock = SteppedClock()
    kept = Timed(clock)
    replay_log(log, speed, None, silent_screen(), clock, (kept,))
    for at_s, end_s in kept.at_s:
        # its event at the start of the record is the first to come, and blocks come when they end
        assert at_s == pytest.approx(end_s / speed, abs=1e-6)


def test_what_happened_before_and_after_the_samples_takes_no_time(tmp_path: Path) -> None:
    """A motor that came up, say, and stood again."""
    path, long_ns = tmp_path / "log.mcap", 60 * NS_PER_S
    write_log(path, seconds=1.0)
    with LogReader(path) as read, LogWriter(tmp_path / "longer.mcap") as log:
        for time_ns in (START_NS - long_ns, START_NS + long_ns):
            log.add_event(Event(time_ns, "info", "motor", "motor", "stands"))
        log.add_metadata("scenario", {"toml": read.scenario})
        for channel in read.channels("measured").values():
            log.declare("measured", channel)
        for origin, block in read.blocks(("measured",)):
            log.add_block(origin, block, block.time_ns)
    clock = SteppedClock()
    kept = Kept()
    replay_log(tmp_path / "longer.mcap", 1.0, None, silent_screen(), clock, (kept,))
    assert clock.now_s - 100.0 == pytest.approx(1.0, abs=0.06)


def test_as_fast_as_possible_waits_for_nothing(log: Path) -> None:
    clock = SteppedClock()
    replay_log(log, 0, None, silent_screen(), clock)
    assert clock.now_s == 100.0


def test_a_stop_is_heard_between_blocks(log: Path) -> None:
    class Stopping(Kept):
        def __call__(self, record: Record) -> None:
            super().__call__(record)
            if isinstance(record, Block):
                os.kill(os.getpid(), signal.SIGINT)

    kept = Stopping()
    with pytest.raises(Stopped, match="stopped by a person"):
        replay_log(log, 1.0, None, silent_screen(), SteppedClock(), (kept,))
    assert len(kept.of("measured", "predicted", "nominal")) == 1


def test_a_log_without_channels_is_refused(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "empty.mcap") as writer:
        writer.add_metadata("scenario", {"toml": "x = 1"})
    with pytest.raises(LogError, match="no channels in it"):
        replay_log(tmp_path / "empty.mcap", 0, None, silent_screen(), SteppedClock())


ACQUISITION = '[acquisition]\nsample_rate = "51.2 kHz"\nduration = "1 s"\n'


def test_the_picture_of_an_overlay_with_effects_is_moved_by_the_twin_that_has_them(tmp_path: Path) -> None:
    run = write_log(tmp_path / "run.mcap", seconds=0.2, origins=["measured"], scenario=SCENARIO + ACQUISITION)
    effects = tmp_path / "effects.json"
    effects.write_text('[{"name": "clearance", "parameters": {"scale": 1.6}}]')
    farthest: list[float] = []
    for given in (None, effects):
        target = tmp_path / f"overlay{len(farthest)}.mcap"
        overlay_run(run, target, given)
        shapes: list[Shape] = []
        with LogReader(target) as log:
            played = scenario_of(log)
            twin = predicting_twin(log, played)
            follow = ShapeFollower(log, twin, played.acquisition, shapes.append)
            for step in range(1, 41):
                until = np.zeros(round(step * 0.005 * RATE))
                follow(Block("predicted", SampleBlock("yoke.force", 0, 0, RATE, until)))
        farthest.append(max(abs(shape.points_m[-1]) for shape in shapes))
    # a stop of 1.5e7 N/m gives way by some micrometres
    assert farthest == pytest.approx([0.127e-3, 1.6 * 0.127e-3], abs=0.01e-3)


def test_ranges_and_limits_stand_beside_the_levels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limited = f'{SCENARIO}{ACQUISITION}[limits."contact.force_upper"]\nwarning = "30 N"\nabort = "50 N"\n'
    full_scales = {"contact.force_upper": "200.0", "yoke.force": "150.0", "base.acceleration": "?"}
    bench = {f"range.{name}": text for name, text in full_scales.items()}
    run = write_log(tmp_path / "run.mcap", 0.1, origins=["measured"], scenario=limited, bench=bench)
    shown: list[Layout] = []
    view = cast(LiveView, SimpleNamespace(offer=lambda record: None))
    monkeypatch.setattr("rig.session.replay.show", lambda view, layout, screen: shown.append(layout))
    replay_log(run, 0, view, silent_screen(), SteppedClock())
    known = {name: bounds for name, bounds in shown[0].bounds.items() if bounds != Bounds()}
    assert known == {"contact.force_upper": Bounds(200.0, 30.0, 50.0), "yoke.force": Bounds(150.0)}


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="no recordings of other programs beside here")
@pytest.mark.parametrize("name", ["beam_healthy", "beam_base_flexibility"])
def test_recordings_of_another_program_are_played(name: str) -> None:
    path = SAMPLES / f"{name}.mcap"
    kept = Kept()
    with LogReader(path) as reader:
        samples = {channel: row.end_sample for channel, row in reader.table("measured").items()}
    replay_log(path, 0, None, silent_screen(), SteppedClock(), (kept,))
    played = {channel: sum(len(block) for block in kept.blocks(channel)) for channel in samples}
    assert played == samples
    assert set(played) >= {channel.name for channel in CHANNELS}
    assert kept.blocks("drive.force")[0].sample_rate == RATE


SETTLED: dict[str, object] = {
    "settle_s": 1.0,
    "cycle_hz": 20.0,
    "phase_rad": 0.5,
    "levels": {"contact.force_upper": {"counts_from_n": 6.0, "released_below_n": 0.8}},
    "within_s": {"contact.force_upper": 0.0125},
}


def settled(tmp_path: Path, **other: object) -> Path:
    """A log that says this was settled of it; json writes NaN as a stranger may."""
    record = {"measured": json.dumps(SETTLED | other)}
    scenario = SCENARIO + ACQUISITION
    return write_log(
        tmp_path / "log.mcap", 0.2, origins=["measured"], scenario=scenario, metadata={RECORD: record}
    )


def test_what_a_log_says_was_settled_holds(tmp_path: Path) -> None:
    kept = Kept()
    replay_log(settled(tmp_path), 0, None, silent_screen(), SteppedClock(), (kept,))
    assert {each.channel for each in kept.impacts} == {"contact.force_upper"}


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"phase_rad": 1e300}, r"phase_rad = 1e\+300 \(at least -6.28319, at most 6.28319 rad\)"),
        ({"phase_rad": float("nan")}, "phase_rad = nan"),
        ({"cycle_hz": 0}, "cycle_hz = 0 "),
        ({"cycle_hz": float("inf")}, "cycle_hz = inf"),
        ({"cycle_hz": int("9" * 400)}, "cycle_hz = 9999"),
        ({"cycle_hz": "20"}, "cycle_hz = 20 "),
        ({"settle_s": None}, "settle_s = None"),
        ({"within_s": {}}, "contact.force_upper = None"),
        ({"within_s": {"contact.force_upper": 0}}, "contact.force_upper = 0 "),
        ({"within_s": []}, r"cannot be read: \[\]"),
        ({"levels": {"contact.force_upper": {"counts_from_n": "6", "released_below_n": 1}}}, "from_n = 6 "),
        ({"levels": {"contact.force_upper": [6.0, 1.0]}}, r"cannot be read: \[6"),
        ({"levels": [1]}, r"cannot be read: \[1\]"),
    ],
)
def test_what_cannot_have_been_settled_is_a_log_error(
    tmp_path: Path, other: dict[str, object], words: str
) -> None:
    path = settled(tmp_path, **other)
    with pytest.raises(LogError, match=f"settled of measured .*{words}"):
        replay_log(path, 0, None, silent_screen(), SteppedClock())
    with pytest.raises(LogError, match=words):
        overlay_run(path, tmp_path / "overlay.mcap")


@pytest.mark.parametrize("text", ["{", "[" * 100_000, "[" * 500 + "]" * 500, "null"])
def test_what_was_settled_in_no_table_is_a_log_error(tmp_path: Path, text: str) -> None:
    path = write_log(tmp_path / "log.mcap", 0.1, metadata={RECORD: {"measured": text}})
    with pytest.raises(LogError, match=r"settled of measured .* cannot be read"):
        replay_log(path, 0, None, silent_screen(), SteppedClock())


def of_drive(path: Path, rate: float, firsts: Iterable[int]) -> Path:
    """A log of nine samples of the drive from each of `firsts` on, which says what was settled."""
    drive = CHANNELS[0]
    with LogWriter(path) as log:
        log.declare("measured", drive)
        log.add_metadata("scenario", {"toml": SCENARIO + ACQUISITION})
        log.add_metadata(RECORD, {"measured": json.dumps(SETTLED)})
        for first in firsts:
            time_ns = sample_time_ns(START_NS, first, rate)
            log.add_block("measured", SampleBlock(drive.name, first, time_ns, rate, np.zeros(9)), time_ns)
    return path


def test_cycles_quicker_than_the_samples_are_not_counted(tmp_path: Path) -> None:
    path = of_drive(tmp_path / "log.mcap", 0.01, [0])
    assert replay_log(path, 0, None, silent_screen(), SteppedClock()) == 1


def test_blocks_without_end_do_not_wait_for_a_second_of_a_rate_out_of_this_world(tmp_path: Path) -> None:
    """500 MB of zeros in a file of a hundredth of that."""
    path, rate, values = tmp_path / "log.mcap", 1e17, np.zeros(1 << 20, np.float32)
    upper = CHANNELS[1]
    with LogWriter(path) as log:
        log.declare("measured", upper)
        for number in range(120):
            block = SampleBlock(upper.name, number * len(values), START_NS, rate, values)
            log.add_block("measured", block, START_NS)
    with bounded(), pytest.raises(LogError, match="more would come of it than of any honest recording"):
        replay_log(path, 0, None, silent_screen(), SteppedClock())


def test_a_hole_out_of_this_world_is_not_filled(tmp_path: Path) -> None:
    path, upper = tmp_path / "log.mcap", CHANNELS[1]
    with LogWriter(path) as log:
        log.declare("measured", upper)
        for first in (0, 10**12):
            block = SampleBlock(upper.name, first, START_NS, 1e17, np.zeros(9, np.float32))
            log.add_block("measured", block, START_NS)
    with bounded(), pytest.raises(LogError, match="more would come of it than of any honest recording"):
        replay_log(path, 0, None, silent_screen(), SteppedClock())


@pytest.mark.long
def test_hours_without_end_between_blocks_are_not_counted_through(tmp_path: Path) -> None:
    """720 000 cycles of the drive in ten blocks of nine samples, and a thousand more blocks."""
    path = of_drive(tmp_path / "log.mcap", RATE, (round(number * 3590 * RATE) for number in range(1000)))
    with pytest.raises(LogError, match="more would come of it than of any honest recording"):
        replay_log(path, 0, None, silent_screen(), SteppedClock())


@pytest.mark.long
def test_impacts_without_end_are_not_kept(tmp_path: Path) -> None:
    """One each 40 samples, the same again and again, in a file that takes a hundredth of them."""
    path, upper = tmp_path / "log.mcap", CHANNELS[1]
    blow = np.zeros(40, np.float32)
    blow[:3] = 10.0, 40.0, 10.0
    values = np.tile(blow, 5000)
    levels = {"within_s": {upper.name: 1e-4}}
    with LogWriter(path) as log:
        log.declare("measured", upper)
        log.add_metadata(RECORD, {"measured": json.dumps(SETTLED | levels)})
        for number in range(100):
            first = number * len(values)
            block = SampleBlock(upper.name, first, sample_time_ns(START_NS, first, RATE), RATE, values)
            log.add_block("measured", block, block.time_ns)
    with pytest.raises(LogError, match="more would come of it than of any honest recording"):
        replay_log(path, 0, None, silent_screen(), SteppedClock())
