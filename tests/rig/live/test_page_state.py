"""What the operator's page is told: the newest cycle, the slow trend, levels; and how often."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from multiprocessing import Pipe
from typing import Any

import numpy as np
import pytest

from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.log.records import RECORD_END, RECORD_START, STOPPING, Event, Impact
from rig.bounds import Bounds
from rig.live.page_process import records
from rig.live.page_state import PERIOD_S, PageState
from rig.live.picture import layout_of
from rig.live.rigs.impact_beam import BeamPicture
from rig.live.rigs.planar_slider_crank import PlanarCrankPicture
from rig.live.view import Levels, Progress, Swept
from rig.stream import Block, Shape

RATE, START_NS, CYCLE_S = 10_000.0, 1_790_000_000_000_000_000, 0.05
FORCE, ANGLE = Channel("contact.force_upper", "N"), Channel("crank.angle", "rad")
BEAM = BeamPicture(length_m=0.28, width_m=0.019, clearance_m=0.127e-3)
PLANAR = PlanarCrankPicture(0.150, 0.564, 1e-3, 1e-3, 20.0)


class Told:
    """A state's page, and what it was told."""

    def __init__(self) -> None:
        self.texts: list[bytes] = []
        self.state = PageState(self.texts.append)

    def newest(self) -> dict[str, Any]:
        self.state.end()
        told: dict[str, Any] = json.loads(self.texts[-1], parse_constant=lambda name: pytest.fail(name))
        return told


@pytest.fixture
def told() -> Told:
    found = Told()
    channels = [FORCE]
    found.state.take(
        layout_of("run", channels, channels, bounds={FORCE.name: Bounds(100.0, 40.0)}, cycle_s=CYCLE_S)
    )
    return found


def block(values: np.ndarray, first: int = 0, channel: str = FORCE.name, rate: float = RATE) -> SampleBlock:
    time_ns = START_NS + round(first / rate * NS_PER_S)
    return SampleBlock(channel, first, time_ns, rate, values.astype(np.float32))


def in_units(told: dict[str, Any], part: int, whose: str = "measured") -> np.ndarray:
    """Least and largest of a part (cycle, band, trend), in the channel's unit; NaN where nothing is."""
    channel = told["channels"][0]
    low, high = (float(text.split()[0]) for text in channel["edges"])
    steps = np.array(channel["traces"][whose][part], dtype=float)
    found: np.ndarray = low + steps * (high - low) / 1000
    return found


def test_the_newest_whole_cycle_is_shown_and_those_before_it_as_a_band(told: Told) -> None:
    times = np.arange(round(4.5 * CYCLE_S * RATE)) / RATE
    number = np.floor(times / CYCLE_S)
    values = (10 + number) * (times % CYCLE_S > 0.6 * CYCLE_S)
    told.state.take(Block("measured", block(values)))
    least, most = in_units(told.newest(), 0)
    columns = len(most)
    assert np.flatnonzero(most > 1)[0] == pytest.approx(0.6 * columns, abs=1)
    assert most.max() == pytest.approx(13.0, abs=0.05)  # cycle 3: number 4 is under way
    assert least[: columns // 2].max() == pytest.approx(0.0, abs=0.05)
    lowest, highest = in_units(told.newest(), 1)
    assert highest.max() == pytest.approx(13.0, abs=0.05)
    assert lowest[-1] == pytest.approx(10.0, abs=0.05)


@pytest.mark.parametrize(("cycle_s", "shown"), [(0.05, 8), (0.3, 8), (1.0, 4)])
def test_the_band_is_of_so_many_cycles_as_is_said(cycle_s: float, shown: int) -> None:
    told, ten = Told(), 10 * cycle_s
    told.state.take(layout_of("run", [FORCE], [], cycle_s=cycle_s))
    times = np.arange(round(ten * RATE)) / RATE
    number = np.floor(times / cycle_s + 1e-9)
    for first in range(0, len(times), 1000):  # as a card gives them
        told.state.take(Block("measured", block(number[first : first + 1000], first)))
    state = told.newest()
    assert state["cycles"] == shown
    lowest, highest = in_units(state, 1)
    assert (lowest.min(), highest.max()) == pytest.approx((10 - shown, 9), abs=0.05)


def test_cycles_begin_where_those_of_the_log_do(told: Told) -> None:
    """Derived series say it, anew with every block; here 20 ms after the record's begin."""
    times = np.arange(round(RATE)) / RATE
    told.state.take(Block("measured", block(np.where((times - 0.02) % CYCLE_S < 0.005, 5.0, 0.0))))
    peaks = block(np.full(15, 5.0), channel=f"{FORCE.name}.cycle_peak", rate=1 / CYCLE_S)
    at_20_ms = SampleBlock(peaks.channel, 0, START_NS + 20_000_000, peaks.sample_rate, peaks.values)
    told.state.take(Block("derived", at_20_ms))
    _, most = in_units(told.newest(), 0)
    seen = np.flatnonzero(most > 1)
    assert seen[0] == 0
    assert seen[-1] == pytest.approx(0.1 * len(most), abs=1)


def test_a_trend_keeps_every_peak_and_the_last_half_minute(told: Told) -> None:
    for second in range(40):
        values = np.zeros(round(RATE))
        values[700] = second
        told.state.take(Block("measured", block(values, round(second * RATE))))
    state = told.newest()
    begin_s, end_s = state["trend_s"]
    assert (begin_s, end_s) == (10.0, 40.0)
    _, most = in_units(state, 2)
    assert most[:: round(1 / state["bin_s"])] == pytest.approx(np.arange(10, 40), abs=0.1)


def test_what_is_no_number_is_left_out_and_a_gap_stays_one(told: Told) -> None:
    times = np.arange(round(0.5 * RATE)) / RATE
    values = np.sin(times)
    values[: round(0.25 * RATE)] = math.nan
    told.state.take(Block("measured", block(values)))
    told.state.take(Block("measured", block(values, round(0.75 * RATE))))
    told.state.take(Levels(START_NS, [math.nan]))
    state = told.newest()
    trend = in_units(state, 2)[1]
    assert [bool(np.isfinite(each)) for each in trend[:5]] == [False, True, False, False, True]
    assert state["channels"][0]["level"] == pytest.approx(math.sin(0.5), rel=1e-3)


@pytest.mark.parametrize("value", [0.0, 5.0, -3e-7, 2e30, 1e-40])
def test_a_channel_that_shows_one_value_only_is_a_line_in_the_middle(told: Told, value: float) -> None:
    told.state.take(Block("measured", block(np.full(2000, value))))
    (channel,) = told.newest()["channels"]
    cycle = np.array(channel["traces"]["measured"][0])
    assert 300 < cycle.min() == cycle.max() < 700


def test_levels_are_shown_before_anything_is_recorded_and_the_highest_stays(told: Told) -> None:
    told.state.take(Levels(START_NS + NS_PER_S, [60.0]))
    told.state.take(Levels(START_NS + 2 * NS_PER_S, [4.0]))
    state = told.newest()
    (channel,) = state["channels"]
    assert (channel["level"], channel["most"], channel["peak"]) == (4.0, 60.0, "4 N")
    assert channel["bounds"] == [100.0, 40.0, None]
    assert state["newest"] == [START_NS / NS_PER_S + 2, None]


def test_what_is_newest_is_what_is_drawn_not_what_else_is_heard(told: Told) -> None:
    """Levels go on though no block comes any more; once the record is over nothing is behind."""
    for origin, count in (("measured", 2000), ("predicted", 1000)):
        told.state.take(Block(origin, block(np.ones(count))))  # type: ignore[arg-type]
    told.state.take(Levels(START_NS + 9 * NS_PER_S, [4.0]))
    start_s = START_NS / NS_PER_S
    assert told.newest()["newest"] == pytest.approx([start_s + 0.2, start_s + 0.1], abs=1e-6)
    told.state.take(Event(START_NS, "info", "rig", RECORD_END, "recorded"))
    assert told.newest()["newest"] == [None, None]


def test_an_angle_is_shown_as_part_of_a_turn_without_a_level_and_turns_the_crank() -> None:
    told = Told()
    told.state.take(
        layout_of("run", [ANGLE], [ANGLE], PLANAR, bounds={ANGLE.name: Bounds(math.inf)}, cycle_s=0.3)
    )
    angle = 2 * math.pi * np.arange(round(RATE)) / RATE / 0.3
    for origin in ("measured", "predicted"):
        told.state.take(Block(origin, block(angle, channel=ANGLE.name)))  # type: ignore[arg-type]
    state = told.newest()
    (channel,) = state["channels"]
    assert channel["unit"] == "°"
    assert channel["level"] is None
    assert channel["bounds"] == [None, None, None]
    cycle = in_units(state, 0)[1]
    assert cycle == pytest.approx(np.linspace(0, 360, len(cycle)), abs=8)
    first, half = (dict(state["sketch"]["frames"][at]) for at in (0, 12))
    assert set(first) == {"measured", "predicted"}
    assert first != half


def test_a_beam_that_nobody_predicts_is_not_said_to_be_drawn() -> None:
    told = Told()
    told.state.take(layout_of("run", [FORCE], [], BEAM, cycle_s=CYCLE_S))
    told.state.take(Block("measured", block(np.ones(2000))))
    sketch = told.newest()["sketch"]
    assert sketch["caption"] == "stops, slowed; arrows: forces on them"
    assert not sketch["frames"]


def test_a_picture_that_does_not_move_yet_says_when_it_will() -> None:
    told = Told()
    told.state.take(layout_of("run", [FORCE], [FORCE], BEAM, cycle_s=CYCLE_S))
    assert told.newest()["sketch"]["caption"].endswith("forces on the stops, from the start of the record on")
    told.state.take(Shape(0.1, np.zeros(20)))
    sketch = told.newest()["sketch"]
    assert sketch["caption"] == "predicted beam, 265 x, slowed; arrows: forces on the stops"
    assert len(sketch["frames"]) == 24


def test_the_highest_level_is_of_the_record_and_none_of_its_start_or_end(told: Told) -> None:
    def most() -> float:
        return float(told.newest()["channels"][0]["most"])

    told.state.take(Levels(START_NS, [80.0]))
    assert most() == 80.0
    told.state.take(Event(START_NS, "info", "rig", RECORD_START, "recording"))
    told.state.take(Levels(START_NS, [30.0]))
    assert most() == 30.0
    told.state.take(Event(START_NS, "info", "rig", RECORD_END, "recorded"))
    told.state.take(Levels(START_NS, [50.0]))
    assert most() == 30.0
    assert told.newest()["channels"][0]["level"] == 50.0  # of a rig that comes to rest


def test_a_part_of_the_trend_that_is_under_way_is_shown_once_all_is_over(told: Told) -> None:
    """A peak that ended the run lies in it."""
    values = np.ones(11_000)
    values[10_500] = 99.0  # in the fifth quarter of a second, of which a tenth is there
    told.state.take(Block("measured", block(values)))

    def shown() -> list[float]:
        told.state.look()
        told.state._due_s, told.state._changed = 0.0, True
        told.state.look()
        _, most = json.loads(told.texts[-1])["channels"][0]["traces"]["measured"][2]
        return [each for each in most if each is not None]

    assert len(shown()) == 4
    told.state.take(Event(START_NS, "error", "rig", STOPPING, "too high"))
    assert len(shown()) == 5


def test_an_event_has_the_time_of_day(told: Told) -> None:
    told.state.take(Event(START_NS, "warning", "rig", "limit.warning", "too high"))
    told.state.take(Event(START_NS - NS_PER_S, "info", "rig", "drive.on", "the drive is on"))  # heard late
    [[_, _, first], [level, at, text]] = told.newest()["events"]
    assert (first, level, text) == ("the drive is on", "warning", "too high")
    assert re.fullmatch(r"\d\d:\d\d:\d\d", at)


def test_an_encoder_beside_the_card_does_not_turn_the_crank() -> None:
    """It shows where it is mounted, backwards maybe; the card's angle is the crank's."""
    angle, beside = 2 * math.pi * np.arange(round(RATE)) / RATE / 0.3, Channel("encoder.angle", "rad")
    drawn = []
    for shown in ([ANGLE], [ANGLE, beside]):
        told = Told()
        told.state.take(layout_of("run", shown, shown, PLANAR, cycle_s=0.3))
        for origin in ("measured", "predicted"):
            told.state.take(Block(origin, block(angle, channel=ANGLE.name)))  # type: ignore[arg-type]
            if beside in shown:
                told.state.take(Block(origin, block(2.0 - angle, channel=beside.name)))
        drawn.append(told.newest()["sketch"]["frames"])
    assert drawn[0] == drawn[1]


def test_a_cycle_that_a_mark_begins_is_drawn_from_the_angle_at_which_it_comes() -> None:
    mark, drawn = Channel("crank.marker", "V"), []
    for at_rad in (0.0, math.pi):
        told, picture = Told(), replace(PLANAR, marker_angle_rad=at_rad)
        told.state.take(layout_of("run", [mark], [mark], picture, cycle_s=0.3))
        told.state.take(Block("measured", block(np.zeros(round(RATE)), channel=mark.name)))
        drawn.append(told.newest()["sketch"]["frames"])
    assert drawn[1][0] == drawn[0][12] != drawn[0][0]


def test_what_a_sweep_came_to_so_far_is_told(told: Told) -> None:
    bars: dict[str, list[tuple[float, ...] | None]] = {
        "measured": [(26.0, 34.0, 30.0), None],
        "predicted": [(28.0, 34.0, 31.0), None],
    }
    assert told.newest()["swept"] is None
    told.state.take(Swept("drive.frequency", ("20 Hz", "21 Hz"), [0.0, 1.0], {"largest peak, N": bars}))
    told.state.take(layout_of("next point", [FORCE], [FORCE]))
    assert told.newest()["swept"]["plots"]["largest peak, N"]["predicted"] == [[28.0, 34.0, 31.0], None]


def test_impacts_are_counted_by_origin(told: Told) -> None:
    for origin, peak in (("measured", 30.0), ("measured", 50.0), ("predicted", 40.0)):
        told.state.take(Impact(START_NS, origin, FORCE.name, 0, 9, 4, peak, peak, 1e-3, 1e-3, 0, math.nan))
    assert told.newest()["figures"] == [
        ["", "measured", "predicted"],
        ["impacts", "2", "1"],
        ["largest", "50 N", "40 N"],
    ]


def test_a_state_is_made_a_few_times_a_second_at_once_for_a_new_stage_and_again_in_silence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 100.0
    monkeypatch.setattr("rig.live.page_state.time.monotonic", lambda: now)
    told = Told()
    for _ in range(100):
        told.state.take(Progress("recording", now - 100.0, 5.0))
        told.state.look()
        now += 0.01
    assert 1.0 / PERIOD_S - 1 <= len(told.texts) <= 1.0 / PERIOD_S + 2
    told.state.take(Progress("finishing"))
    told.state.look()
    assert json.loads(told.texts[-1])["stage"]["text"] == "finishing"
    count = len(told.texts)
    for _ in range(35):
        told.state.look()
        now += 0.1
    assert 2 <= len(told.texts) - count <= 3


def test_a_run_that_is_killed_is_said_to_have_gone() -> None:
    told = Told()
    ours, theirs = Pipe()
    theirs.send(Progress("recording"))
    theirs.close()
    assert [frame for _, frame in records(ours, told.state)] == [Progress("recording")]
    ours.close()
    assert told.newest()["stage"]["text"] == "the run has gone without a word"


def test_the_next_run_of_a_sweep_is_shown_anew(told: Told) -> None:
    """Its cycles begin where its own record does, and what happened before is not its."""
    told.state.take(Block("measured", block(np.full(2000, 7.0))))
    told.state.take(Event(START_NS, "warning", "rig", "limit.warning", "of the first"))
    told.state.take(layout_of("next", [FORCE], [FORCE], cycle_s=CYCLE_S))
    assert told.newest()["events"] == []
    assert told.newest()["channels"][0]["traces"] == {"measured": [None] * 3, "predicted": [None] * 3}
    late_ns = START_NS + 3 * NS_PER_S
    hit = np.arange(1000) / RATE % CYCLE_S > 0.6 * CYCLE_S
    told.state.take(Block("measured", SampleBlock(FORCE.name, 0, late_ns, RATE, hit.astype(np.float32))))
    peaks = SampleBlock(f"{FORCE.name}.cycle_peak", 0, late_ns, 1 / CYCLE_S, np.ones(2, np.float32))
    told.state.take(Block("derived", peaks))
    _, most = in_units(told.newest(), 0)
    assert np.flatnonzero(most > 0.5)[0] == pytest.approx(0.6 * len(most), abs=1)
