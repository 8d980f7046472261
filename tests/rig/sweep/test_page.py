"""What the points of a sweep came to: figures of each record, a row for a person, a page of branches."""

from __future__ import annotations

import base64
import csv
import dataclasses
import json
import re
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.block import NS_PER_S
from daq.log.reader import LogReader
from daq.log.records import Impact
from daq.log.writer import LogWriter
from rig.files.scenario import Scenario, parse_scenario
from rig.files.sweep import Sweep
from rig.live.view import Swept
from rig.sweep.figures import (
    A_CYCLE,
    FIRST_MEAN,
    FIRST_SD,
    HELD,
    IMPACTS,
    LARGEST,
    PEAK_MEAN,
    PEAK_SD,
    PREDICTED,
    RMS,
    SMALLEST,
    figure_of,
    outcome_of,
    smallest_peak,
)
from rig.sweep.results import headings_of, rows_of, swept_so_far, write_page, write_results
from rig.sweep.state import SCHEMA, PointState, SweepState
from tests.rig.browser import faults_of_report, needs_chromium
from tests.rig.derived.turning import BLOW_N
from tests.rig.report import crank_run
from tests.rig.sweep.swept import parsed
from tests.rig.synthetic_run import CHANNELS, START_NS, blocks

FREQUENCIES = '"drive.frequency" = ["9 Hz", "10 Hz", "11 Hz"]'
THERE_AND_BACK = 'up_and_down = ["drive.frequency"]'
UPPER, LOWER = "contact.force_upper", "contact.force_lower"


def impact(channel: str, peak: float, origin: str = "measured") -> Impact:
    first = 0.75 * peak
    return Impact(START_NS + NS_PER_S, origin, channel, 100, 150, 120, peak, first, 1.0, 1e-3, 0, 1.0)


def record(path: Path, impacts: list[Impact], looked_for: bool = True) -> Path:
    with LogWriter(path) as writer:
        for channel in CHANNELS:
            writer.declare("measured", channel)
        if looked_for:
            writer.add_metadata("derived", {})
        for block in blocks(CHANNELS, "measured", 0.5):
            writer.add_block("measured", block, block.time_ns)
        for each in impacts:
            writer.add_impact(each, each.time_ns)
    return path


def state_of(sweep: Sweep, peaks: list[float]) -> SweepState:
    points = {
        number: PointState(
            "done",
            f"point-{number}.mcap",
            figures={
                IMPACTS: 10,
                A_CYCLE: 2.0,
                FIRST_MEAN: 0.75 * peak,
                FIRST_SD: 0.5,
                PEAK_MEAN: peak,
                PEAK_SD: 1.0,
                HELD[0]: 20.0,
            },
        )
        for number, peak in enumerate(peaks, start=1)
    }
    return SweepState(SCHEMA, {}, 1, points=points)


def of_channel(
    channel: str, largest: float, smallest: float, rms: float, whose: str = ""
) -> dict[str, float]:
    values = {LARGEST: largest, SMALLEST: smallest, RMS: rms}
    return {whose + figure_of(channel, what, "N"): value for what, value in values.items()}


def with_more(state: SweepState, number: int, more: dict[str, float]) -> SweepState:
    point = state.points[number]
    return state.with_point(number, dataclasses.replace(point, figures=point.figures | more))


def traces(html: str, figure: str = "sweep") -> list[dict[str, Any]]:
    found = re.search(rf'data-plot="plot-{figure}">(.*?)</script>', html)
    assert found is not None
    return list(json.loads(found[1])["data"])


def unpacked(array: dict[str, str]) -> list[float]:
    return [float(each) for each in np.frombuffer(base64.b64decode(array["bdata"]), "<f4")]


def figures_of(log: Path, scenario: Scenario) -> dict[str, float]:
    return outcome_of(log, scenario)[1]


def test_a_record_comes_to_its_impacts_and_to_what_its_drive_was_held_to(tmp_path: Path) -> None:
    seen = [impact("contact.force_upper", 30.0), impact("contact.force_lower", 34.0)]
    other = [impact("yoke.force", 90.0), impact("contact.force_upper", 70.0, "predicted")]
    figures = figures_of(record(tmp_path / "run.mcap", [*seen, *other]), parsed().points[1].scenario)
    # 0.5 s at 20 Hz are 10 cycles
    assert figures[IMPACTS] == 2
    assert figures[A_CYCLE] == pytest.approx(0.2)
    assert (figures[PEAK_MEAN], figures[PEAK_SD]) == (32.0, 2.0)
    assert (figures[FIRST_MEAN], figures[FIRST_SD]) == (24.0, 1.5)
    # the made-up drive has 8 N in noise of 0.02 N
    assert figures[HELD[0]] == pytest.approx(20.0, rel=1e-5)


def test_a_log_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, read = record(tmp_path / "run.mcap", [impact("contact.force_upper", 30.0)]), list[LogReader]()
    enter = LogReader.__enter__
    monkeypatch.setattr(LogReader, "__enter__", lambda reader: (read.append(reader), enter(reader))[1])
    outcome_of(log, parsed().points[1].scenario)
    assert len(read) == 1


def test_a_record_in_which_nobody_looked_for_impacts_is_looked_through_when_it_is_read(
    tmp_path: Path,
) -> None:
    scenario = parsed().points[1].scenario
    late = figures_of(record(tmp_path / "run.mcap", [], looked_for=False), scenario)
    assert late[IMPACTS] == 20  # one on each side in each of ten cycles
    assert late[A_CYCLE] == pytest.approx(2.0)
    assert figures_of(record(tmp_path / "none.mcap", []), scenario)[IMPACTS] == 0


def test_a_crank_comes_to_its_mean_speed(tmp_path: Path) -> None:
    speed = dataclasses.replace(CHANNELS[0], name="crank.speed", unit="rpm")
    with LogWriter(tmp_path / "run.mcap") as writer:
        writer.declare("derived", speed)
        for block in blocks([CHANNELS[0]], "measured", 0.2):
            values = np.where(np.arange(len(block)) < 10, np.nan, 200.5).astype(np.float32)
            writer.add_block(
                "derived", dataclasses.replace(block, channel="crank.speed", values=values), block.time_ns
            )
    crank = '[scenario]\nrig = "planar_slider_crank"\n[scenario.drive]\nspeed = "200 rpm"\n'
    crank += '[scenario.acquisition]\nsample_rate = "25.6 kHz"\nduration = "1 s"\nsettle = "1 s"\n'
    swept = parsed('"drive.speed" = ["200 rpm"]', scenario=crank)
    assert figures_of(tmp_path / "run.mcap", swept.points[0].scenario)[HELD[1]] == pytest.approx(200.5)


def test_a_row_says_what_was_driven_counted_held_and_where_it_lies() -> None:
    swept = parsed(FREQUENCIES)
    peaks = ["initial peak / predicted", "largest peak / predicted"]
    assert headings_of(swept) == [
        "point", "drive.frequency", "outcome", "impacts", *peaks, "drive held", "log"
    ]  # fmt: skip
    state = state_of(swept, [30.0, 40.0])
    twins = {PREDICTED + PEAK_MEAN: 41.0, PREDICTED + PEAK_SD: 2.0}
    state = state.with_point(1, dataclasses.replace(state.points[1], figures=state.points[1].figures | twins))
    rows = list(rows_of(swept, state))
    told = ["30.0 ± 0.5 N", "40.0 ± 1.0 N"]
    assert rows[1] == ["2", "10 Hz", "done", "10", *told, "20 Hz", "point-2.mcap"]
    assert rows[0][5] == "30.0 ± 1.0 / 41.0 ± 2.0 N"
    assert len(rows) == 2


def test_table_and_page_tell_the_impacts_of_the_record_and_not_those_that_ended_it(tmp_path: Path) -> None:
    """The record ends a moment after the ninth is over, when the tenth has begun."""
    swept = parsed(FREQUENCIES)
    state = state_of(swept, [30.0])
    state = state.with_point(1, dataclasses.replace(state.points[1], impacts=9))
    state = state.with_point(2, PointState("done", "point-2.mcap", impacts=9))
    (told, unknown) = csv.DictReader(write_results(tmp_path, swept, state).read_text().splitlines())
    assert [told["impacts"], unknown["impacts"]] == ["10", ""]
    assert "impacts recorded" not in told
    column = headings_of(swept).index("impacts")
    assert [row[column] for row in rows_of(swept, state)] == ["10", ""]


def test_the_way_back_is_drawn_apart_from_the_way_there(tmp_path: Path) -> None:
    swept = parsed(FREQUENCIES, THERE_AND_BACK)
    page = write_page(tmp_path, swept, state_of(swept, [10.0, 20.0, 30.0, 60.0, 10.0]))
    _, first, peaks = traces(page.read_text())
    assert unpacked(first["y"]) == [7.5, 15.0, 22.5, 45.0, 7.5]
    assert unpacked(peaks["x"]) == [9.0, 10.0, 11.0, 10.0, 9.0]
    assert unpacked(peaks["y"]) == [10.0, 20.0, 30.0, 60.0, 10.0]
    assert peaks["marker"]["symbol"] == ["circle"] * 3 + ["circle-open"] * 2


def test_each_setting_of_the_other_axes_has_a_row_and_a_point_to_come_leaves_a_hole(tmp_path: Path) -> None:
    swept = parsed(f'"model.beam" = ["steel", "aluminium"]\n{FREQUENCIES}')
    page = write_page(tmp_path, swept, state_of(swept, [10.0, 20.0, 30.0, 40.0]))
    text = page.read_text()
    assert "largest peak, N  model.beam aluminium" in text
    last = unpacked(traces(text)[5]["y"])
    assert last[0] == 40.0
    assert np.isnan(last[1:]).all()


def test_what_the_twin_predicted_lies_over_what_was_measured_and_each_log_is_linked(tmp_path: Path) -> None:
    swept = parsed(FREQUENCIES)
    state = state_of(swept, [10.0, 20.0])
    twins = {PREDICTED + A_CYCLE: 2.1, PREDICTED + PEAK_MEAN: 21.0, PREDICTED + PEAK_SD: 2.0}
    twins |= {PREDICTED + FIRST_MEAN: 16.0, PREDICTED + FIRST_SD: 1.0}
    figures = {**state.points[2].figures, **twins}
    state = state.with_point(2, dataclasses.replace(state.points[2], figures=figures))
    text = write_page(tmp_path, swept, state).read_text()
    drawn = traces(text)
    assert [each["name"] for each in drawn] == ["measured", "predicted"] * 3
    assert [unpacked(drawn[at]["y"])[1] for at in (3, 5)] == [16.0, 21.0]
    assert '<a href="point-2.mcap">point-2.mcap</a>' in text
    rows = list(csv.DictReader(write_results(tmp_path, swept, state).read_text().splitlines()))
    assert [row["predicted impacts a cycle"] for row in rows] == ["", "2.1"]


@pytest.mark.parametrize("both_ways", [False, True])
def test_a_caption_tells_only_of_what_is_there(both_ways: bool, tmp_path: Path) -> None:
    swept = parsed(FREQUENCIES, THERE_AND_BACK if both_ways else "")
    there = write_page(tmp_path, swept, state_of(swept, [10.0, 20.0, 30.0])).read_text()
    assert "Hollow: on the way back" not in there
    assert "Bars: standard deviation" in there
    if both_ways:
        back = write_page(tmp_path, swept, state_of(swept, [10.0, 20.0, 30.0, 20.0])).read_text()
        assert "Hollow: on the way back" in back


@pytest.mark.browser
@needs_chromium
def test_no_text_of_a_sweeps_page_is_cut_or_lies_on_another(tmp_path: Path) -> None:
    swept = parsed(f'"model.beam" = ["steel", "aluminium"]\n{FREQUENCIES}', THERE_AND_BACK)
    state = state_of(swept, [10.0, 20.0, 30.0, 60.0, 10.0, 20.0])
    for number in state.points:
        for channel in (UPPER, LOWER, "yoke.force"):
            state = with_more(state, number, of_channel(channel, 50.0, 30.0, 4.0))
    assert faults_of_report(write_page(tmp_path, swept, state)) == []


def test_words_stand_side_by_side(tmp_path: Path) -> None:
    swept = parsed('"model.beam" = ["steel", "aluminium"]')
    text = write_page(tmp_path, swept, state_of(swept, [10.0, 20.0])).read_text()
    assert unpacked(traces(text)[0]["x"]) == [0.0, 1.0]
    assert '"ticktext": ["steel", "aluminium"]' in text


def test_a_sweep_without_any_impact_figure_says_so(tmp_path: Path) -> None:
    swept = parsed(FREQUENCIES)
    done = SweepState(SCHEMA, {}, 1, points={1: PointState("done", "a.mcap")})
    assert "No record of this sweep" in write_page(tmp_path, swept, done).read_text()


def test_a_live_view_is_told_what_the_points_of_its_row_came_to_so_far() -> None:
    swept = parsed(f'"model.beam" = ["steel", "aluminium"]\n{FREQUENCIES}')
    assert swept_so_far(swept, SweepState(SCHEMA, {}, 1), swept.points[0]) is None
    state = state_of(swept, [10.0, 20.0, 30.0, 40.0])
    more = {PREDICTED + PEAK_MEAN: 41.0, PREDICTED + PEAK_SD: 2.0, **of_channel(LOWER, 20.0, 15.0, 2.0)}
    more |= of_channel(UPPER, 50.0, 30.0, 4.0) | of_channel(UPPER, 52.0, 25.0, 4.5, PREDICTED)
    state = with_more(state, 4, more)
    plots: dict[str, dict[str, list[tuple[float, ...] | None]]] = {
        "initial peak, N": {"measured": [(29.5, 30.5, 30.0), None, None], "predicted": [None, None, None]},
        "largest peak, N": {
            "measured": [(39.0, 41.0, 40.0), None, None],
            "predicted": [(39.0, 43.0, 41.0), None, None],
        },
        f"{UPPER} peaks, N": {
            "measured": [(30.0, 50.0, 50.0, 30.0), None, None],
            "predicted": [(25.0, 52.0, 52.0, 25.0), None, None],
        },
        f"{UPPER} rms, N": {
            "measured": [(4.0, 4.0, 4.0), None, None],
            "predicted": [(4.5, 4.5, 4.5), None, None],
        },
    }
    told = swept_so_far(swept, state, swept.points[4])
    assert told == Swept("drive.frequency", ("9 Hz", "11 Hz"), [0.0, 0.5, 1.0], plots)


def test_each_channel_has_its_peaks_at_one_angle_and_its_rms_measured_and_predicted(tmp_path: Path) -> None:
    swept = parsed(FREQUENCIES)
    more = of_channel(UPPER, 50.0, 30.0, 4.0) | of_channel(UPPER, 52.0, 25.0, 4.5, PREDICTED)
    more |= {figure_of("crank.angle", RMS, "rad"): 3.0, figure_of("motor.tachometer", RMS, "rad/s"): tau}
    state = with_more(state_of(swept, [10.0, 20.0]), 2, more)
    text = write_page(tmp_path, swept, state).read_text()
    drawn = traces(text, "channels")
    assert [(each["name"], each["line"].get("dash")) for each in drawn] == [
        ("measured", None),
        ("predicted", None),
        ("measured", "dash"),
        ("predicted", "dash"),
        ("measured", None),
        ("predicted", None),
        ("measured", None),  # the tachometer, in rpm; an angle has no rms
    ]
    at_10_hz = [unpacked(each["y"])[1] for each in drawn]
    assert at_10_hz == pytest.approx([50.0, 52.0, 30.0, 25.0, 4.0, 4.5, 60.0], rel=1e-6)  # as float32
    assert "dashed, the smallest of the others within 15 degrees" in text
    none = write_page(tmp_path, swept, state_of(swept, [10.0])).read_text()
    assert "Channels over the swept value" not in none


def test_the_smallest_peak_is_of_another_cycle_at_about_the_angle_of_the_largest() -> None:
    turns = np.arange(4 * 360) / 360
    values = np.zeros(len(turns))
    peaks = {0.30: 10.0, 1.30: 50.0, 2.32: 40.0, 2.80: 5.0, 3.29: 20.0}
    for at, peak in peaks.items():
        values[round(360 * at)] = peak
    assert smallest_peak(values, turns) == 10.0
    far = values.copy()
    far[[round(360 * 3.29), round(360 * 3.36)]] = 0.0, 20.0  # 22 degrees away
    assert smallest_peak(far, turns) == 0.0
    assert smallest_peak(values[100:], turns[100:]) == 20.0  # the first begins within it
    hole = values.copy()
    hole[round(360 * 3.31)] = np.nan
    assert smallest_peak(hole[100:], turns[100:]) == 40.0
    assert np.isnan(smallest_peak(values[:360], turns[:360]))
    assert np.isnan(smallest_peak(values, np.full(len(turns), np.nan)))


def test_a_crank_comes_to_the_smallest_peak_and_the_rms_of_its_blows_measured_and_predicted(
    tmp_path: Path,
) -> None:
    """Blows of half a sine of 1 ms, another in each turn; a marker tells the angle from turn 1 to turn 20."""
    log = crank_run.write_log(tmp_path / "run.mcap", "spatial_slider_crank", 6.0)
    figures = figures_of(log, parse_scenario(crank_run.scenario("spatial_slider_crank"), "test"))
    # what is predicted turns 0.3 % faster, and strikes once more; a peak between two samples is 0.2 % less
    for whose, size, count in (("", BLOW_N, 20), (PREDICTED, 0.4 * BLOW_N, 21)):
        blows = size * (1 + 0.4 * np.sin(1.7 * np.arange(count)))
        told = [figures[f"{whose}slider.force_3 {what} [N]"] for what in (SMALLEST, LARGEST, RMS)]
        rms = np.sqrt(np.sum(blows**2) * 1e-3 / 2 / 6.0)
        assert told == pytest.approx([blows[1:20].min(), blows.max(), rms], rel=5e-3)
