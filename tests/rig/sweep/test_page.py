"""What the points of a sweep came to: figures of each record, a row for a person, a page of branches."""

from __future__ import annotations

import base64
import csv
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.block import NS_PER_S
from daq.log.reader import LogReader
from daq.log.records import Impact
from daq.log.writer import LogWriter
from rig.files.scenario import Scenario
from rig.files.sweep import Sweep
from rig.live.view import Swept
from rig.sweep.results import (
    A_CYCLE,
    FIRST_MEAN,
    FIRST_SD,
    HELD,
    IMPACTS,
    PEAK_MEAN,
    PEAK_SD,
    PREDICTED,
    headings_of,
    outcome_of,
    rows_of,
    swept_so_far,
    write_page,
    write_results,
)
from rig.sweep.state import SCHEMA, PointState, SweepState
from tests.rig.browser import faults_of_report, needs_chromium
from tests.rig.sweep.swept import parsed
from tests.rig.synthetic_run import CHANNELS, START_NS, blocks

FREQUENCIES = '"drive.frequency" = ["9 Hz", "10 Hz", "11 Hz"]'
THERE_AND_BACK = 'up_and_down = ["drive.frequency"]'


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


def traces(html: str) -> list[dict[str, Any]]:
    found = re.search(r'data-plot="plot-sweep">(.*?)</script>', html)
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
    page_of = write_page(tmp_path, swept, state_of(swept, [10.0, 20.0, 30.0, 60.0, 10.0, 20.0]))
    assert faults_of_report(page_of) == []


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
    twins = {PREDICTED + PEAK_MEAN: 41.0, PREDICTED + PEAK_SD: 2.0}
    state = state.with_point(4, dataclasses.replace(state.points[4], figures=state.points[4].figures | twins))
    plots = {
        "initial peak, N": {"measured": [(30.0, 0.5), None, None], "predicted": [None, None, None]},
        "largest peak, N": {"measured": [(40.0, 1.0), None, None], "predicted": [(41.0, 2.0), None, None]},
    }
    told = swept_so_far(swept, state, swept.points[4])
    assert told == Swept("drive.frequency", ("9 Hz", "11 Hz"), [0.0, 0.5, 1.0], plots)  # type: ignore[arg-type]
