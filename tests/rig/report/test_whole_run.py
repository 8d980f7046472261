"""The whole run over time, what of it is not compared, and units as people write them."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from daq.channel import Channel
from daq.log.records import LIMIT_WARNING, Event, Gap
from rig.commands.logs import show
from rig.pages.content import BigNumbers, Figure, Lead, Sentence, Table
from rig.pages.words import number, spread
from rig.report.page import render
from rig.report.record import RunRecord, Verdict, read_run
from rig.report.sections import log as log_sections
from rig.report.sections import overlays, spectra, summary, whole_run
from rig.session.progress import Screen, Terminal
from tests.rig.synthetic_run import DRIVE_HZ, PEAK_N, SCENARIO, START_NS, write_log

LIMITED = (
    SCENARIO
    + '[acquisition]\nsample_rate = "51.2 kHz"\nduration = "2 s"\n'
    + '[limits."contact.force_upper"]\nwarning = "60 N"\nabort = "400 N"\n'
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunRecord:
    return read_run(write_log(tmp_path_factory.mktemp("run") / "run.mcap", 2.0, scenario=LIMITED))


def drawn(run: RunRecord) -> tuple[list[str], Figure]:
    *told, figure = whole_run.parts(run)
    assert isinstance(figure, Figure)
    return [part.text for part in told if isinstance(part, Sentence)], figure


def values(trace: dict[str, dict[str, str]], axis: str = "y") -> np.ndarray:
    return np.frombuffer(base64.b64decode(trace[axis]["bdata"]), "<f4")


def test_a_lone_peak_of_a_run_is_seen_in_its_waveform(run: RunRecord) -> None:
    trace = run.traces["measured", "contact.force_upper"]
    struck = trace.values.copy()
    struck[70_001] = 99.0
    key = ("measured", "contact.force_upper")
    _, figure = drawn(replace(run, traces={**run.traces, key: replace(trace, values=struck)}))
    line = next(
        each
        for each in figure.traces
        if each["name"] == "measured" and each.get("meta") == "contact.force_upper"
    )
    at = int(np.argmax(values(line)))
    assert values(line)[at] == 99.0
    assert values(line, "x")[at] == pytest.approx(70_001 / 51_200, abs=1e-4)


def test_events_and_limits_are_marked_where_they_lie(run: RunRecord) -> None:
    event = Event(START_NS + 1_250_000_000, "warning", "rig", "limit.warning", "too much")
    told, figure = drawn(replace(run, events=[event]))
    marks = [each for each in figure.traces if each["name"] == "event"]
    assert len(marks) == len(run.channels)
    assert values(marks[0], "x") == pytest.approx([1.25, 1.25, np.nan], nan_ok=True)
    assert marks[0]["text"] == ["limit.warning: too much"] * 2 + [""]
    # 60 N and -60 N about peaks of 40 N; 400 N would leave nothing else to be seen
    limits = [float(values(each)[0]) for each in figure.traces if each["name"] == "limit"]
    assert limits == [60.0, -60.0]
    assert told == ["Limits of this run: contact.force_upper 60 N, contact.force_upper 400 N."]


@pytest.mark.parametrize("more", [0, 59])
def test_of_more_events_than_a_page_can_mark_the_worst_are_marked_and_the_rest_told(
    run: RunRecord, more: int
) -> None:
    """Of 64 channels, say; one line each, whatever the number of events."""
    channels = {**run.channels, **{f"extra_{at}": run.channels["yoke.force"] for at in range(more)}}
    traces = {("measured", name): run.traces["measured", "yoke.force"] for name in channels}
    codes = ["warning" if at == 2000 else "info" for at in range(3000)]
    events = [Event(START_NS + (at + 1) * 500_000, code, "rig", "x.y", code) for at, code in enumerate(codes)]
    tallies = dict.fromkeys(traces, run.tallies["measured", "yoke.force"])
    told, figure = drawn(replace(run, channels=channels, traces=traces, tallies=tallies, events=events))
    marks = [each for each in figure.traces if each["name"] == "event"]
    assert len(marks) == len(channels)
    (said,) = (each for each in told if "events" in each)
    marked = len(values(marks[0], "x")) // 3
    assert said.startswith(f"Marked are {marked} of 3000 events, the worst first")
    assert 10 < marked <= 500
    assert len(marks) * marked <= 5 * 500
    assert "x.y: warning" in marks[0]["text"]


def test_a_zoom_says_what_it_cannot_resolve(run: RunRecord) -> None:
    _, figure = drawn(run)
    most = max(len(values(each)) for each in figure.traces if each["name"] == "measured")
    (stretch_ms,) = re.findall(r"in stretches of ([\d.]+) ms", figure.caption)
    assert float(stretch_ms) == pytest.approx(1e3 * 2.0 / (most / 2), rel=0.1)
    few = {key: replace(trace, values=trace.values[:1000]) for key, trace in run.traces.items()}
    _, figure = drawn(replace(run, traces=few))
    assert "every sample" in figure.caption


@pytest.mark.parametrize("unit", ["m/s2", "rad/s"])
def test_what_an_instrument_beside_the_card_measured_is_drawn_where_it_lies_in_time(
    run: RunRecord, unit: str
) -> None:
    name, key = "base.acceleration", ("measured", "base.acceleration")
    late = replace(run.traces[key], begins_s=0.25)
    beside = replace(
        run, channels={**run.channels, name: Channel(name, unit)}, traces={**run.traces, key: late}
    )
    for section in (whole_run, overlays):
        lines = {
            whose: next(
                each
                for each in drawn_by(section, whole)
                if (each.get("meta"), each["name"]) == (name, "measured")
            )
            for whose, whole in (("late", beside), ("plain", run))
        }
        if section is whole_run:
            assert values(lines["late"], "x")[0] == pytest.approx(0.25, abs=2e-3)
        else:  # another stretch of it lies below the same time
            assert values(lines["late"], "x") == pytest.approx(values(lines["plain"], "x"), abs=0.03)
            assert not np.allclose(values(lines["late"]), values(lines["plain"]))


def drawn_by(section: ModuleType, run: RunRecord) -> list[dict[str, Any]]:
    *_, figure = section.parts(run)
    assert isinstance(figure, Figure)
    return figure.traces


def test_gaps_are_told_in_seconds_of_the_record_like_events(run: RunRecord) -> None:
    gap = Gap(START_NS + 1_250_000_000, "measured", "yoke.force", 64_000, 10, "card")
    *_, table = log_sections.events(replace(run, gaps=[gap]))
    assert isinstance(table, Table)
    assert dict(zip(table.headings, table.rows[0], strict=True))["s of the record"] == "1.250"


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"scenario": "no toml ["}, "the scenario in this log cannot be read"),
        ({"traces": ()}, "drive.force was not measured"),
        ({"traces": ("drive.force",)}, "drive.force does not show it"),
    ],
)
def test_first_impacts_of_a_run_whose_drive_cannot_be_followed_come_with_a_word_why(
    run: RunRecord, changed: dict[str, Any], why: str
) -> None:
    if "traces" in changed:
        still = {
            key: replace(trace, values=0 * trace.values)
            for key, trace in run.traces.items()
            if key[1] in changed["traces"]
        }
        kept = {key: trace for key, trace in run.traces.items() if key[1] != "drive.force"}
        changed = {"traces": kept | still}
    told, *_ = overlays.parts(replace(run, **changed))
    assert isinstance(told, Sentence)
    assert why in told.text
    assert "may not be compared wave by wave" in told.text


def test_events_are_told_in_seconds_of_the_record_too(run: RunRecord) -> None:
    table = next(part for part in log_sections.events(run) if isinstance(part, Table))
    assert table.rows[0][1] == "0.000"


def test_the_verdict_comes_before_any_percentage(run: RunRecord) -> None:
    verdict = Verdict(False, ("Not what healthy rigs do.", "Most in yoke.force."))
    first, *_ = summary.parts(replace(run, verdict=verdict))
    assert isinstance(first, Lead)
    assert first.sentences == verdict.sentences


def test_the_terminal_ends_with_the_verdict(run: RunRecord) -> None:
    told = StringIO()
    verdict = Verdict(False, ("Not what healthy rigs do.", "Most in yoke.force."))
    show(replace(run, verdict=verdict), Screen(Terminal(file=told, width=120)))
    *_, first, second = told.getvalue().splitlines()
    assert first == "verdict    Not what healthy rigs do."
    assert second == "           Most in yoke.force."


def test_the_tile_shows_the_channel_that_is_worst(run: RunRecord) -> None:
    numbers = next(part for part in summary.parts(run) if isinstance(part, BigNumbers)).numbers
    tile = next(each for each in numbers if each.label == "Largest difference")
    # every channel is a tenth too small, base.acceleration has the same noise
    assert tile.text == "\N{MINUS SIGN}10.0 %" == f"\N{MINUS SIGN}{100 * (1 - 36 / PEAK_N['measured']):.1f} %"
    assert "base.acceleration" not in tile.remark


def test_what_the_twin_says_nothing_of_is_not_compared(run: RunRecord) -> None:
    key = ("predicted", "base.acceleration")
    still = replace(run.tallies[key], square_sum=0.0, largest=0.0)
    quiet = replace(run, tallies={**run.tallies, key: still})
    assert quiet.still == {"base.acceleration"}
    table = next(part for part in summary.parts(quiet) if isinstance(part, Table))
    row = next(row for row in table.rows if row[0] == "base.acceleration")
    assert row[1] == "m/s²"
    assert row[4] == "not compared"
    assert "100.0 %" not in str(summary.parts(quiet))


@pytest.mark.parametrize(("times", "still"), [(5.0, True), (300.0, False)])
def test_what_is_struck_a_few_times_shows_more_than_noise(run: RunRecord, times: float, still: bool) -> None:
    """A guide's sensor, say, that two blows in ten seconds leave with the rms of its noise."""
    key = "base.acceleration"
    stands = replace(run.tallies["predicted", key], square_sum=0.0, largest=0.0)
    struck = replace(run.tallies["measured", key], largest=times * run.noise(key))
    seen = replace(run, tallies={**run.tallies, ("predicted", key): stands, ("measured", key): struck})
    assert (key in seen.still) == still


def test_what_moves_though_the_twin_says_it_stands_is_the_largest_difference(run: RunRecord) -> None:
    key = "base.acceleration"
    stands = replace(run.tallies["predicted", key], square_sum=0.0, largest=0.0)
    shaken = run.tallies["measured", key]
    shaken = replace(shaken, square_sum=400 * shaken.square_sum)  # 0.4 m/s2
    hidden = replace(run, tallies={**run.tallies, ("predicted", key): stands, ("measured", key): shaken})
    assert not hidden.still
    table = next(part for part in summary.parts(hidden) if isinstance(part, Table))
    row = next(row for row in table.rows if row[0] == key)
    assert row[4] == "\N{MINUS SIGN}100.0 %"
    numbers = next(part for part in summary.parts(hidden) if isinstance(part, BigNumbers)).numbers
    tile = next(each for each in numbers if each.label == "Largest difference")
    assert key in tile.remark


def test_a_run_that_was_going_shows_its_mean_cycle_and_says_why(run: RunRecord) -> None:
    told, figure = overlays.parts(run)
    assert isinstance(told, Sentence)
    assert "running before this run" in told.text
    assert isinstance(figure, Figure)
    titles = [each["text"] for each in figure.layout["annotations"][:2]]
    assert "one drive cycle" in titles[0]
    assert "mean of all cycles" in titles[1]
    assert "scatter" in figure.key
    _, _, start_s, _ = figure.layout["xaxis"]["title"]["text"].split()  # ms after ... s
    cycles = float(start_s) * DRIVE_HZ
    assert cycles == pytest.approx(round(cycles), abs=2e-3)  # at a rising zero, where the mean begins


def test_units_are_as_people_write_them() -> None:
    assert number(9.81, "m/s2") == "9.81 m/s²"
    assert number(2 * np.pi, "rad/s") == "60 rpm"
    assert spread(2 * np.pi, np.pi, "rad/s") == "60.0 ± 30.0 rpm"


def test_what_turns_is_in_rpm_wherever_its_axis_says_so(run: RunRecord) -> None:
    name = "base.acceleration"
    turning = replace(run, channels={**run.channels, name: Channel(name, "rad/s")})
    rpm = 60 / (2 * np.pi)
    for section, factor in ((overlays, rpm), (spectra, rpm**2), (whole_run, rpm)):
        before, after = (list(section.parts(each))[-1] for each in (run, turning))
        assert isinstance(before, Figure)
        assert isinstance(after, Figure)
        lines = [
            [values(line) for line in figure.traces if (line.get("meta"), line["name"]) == (name, "measured")]
            for figure in (before, after)
        ]
        assert lines[0]
        for ours, theirs in zip(*lines, strict=True):
            assert theirs == pytest.approx(factor * ours, rel=1e-4)


def test_the_terminal_says_what_the_report_does(run: RunRecord) -> None:
    told = StringIO()
    name = "base.acceleration"
    for unit in ("m/s2", "rad/s"):
        show(replace(run, channels={name: Channel(name, unit)}), Screen(Terminal(file=told, width=120)))
    acceleration, turning = (line.split() for line in told.getvalue().splitlines() if line.startswith(name))
    assert (acceleration[-1], turning[-1]) == ("m/s²", "rpm")
    assert float(turning[1]) == pytest.approx(60 / (2 * np.pi) * float(acceleration[1]), rel=1e-3)


def test_passed_warnings_are_told_on_the_terminal_and_in_the_summary(run: RunRecord) -> None:
    texts = "a = 41 N, warning at 40 N", "a = 45 N, warning at 40 N"
    warned = replace(run, events=[Event(START_NS, "warning", "acquisition", LIMIT_WARNING, t) for t in texts])
    said = f"Warnings of limits: 2, the first {texts[0]}"
    told = StringIO()
    show(warned, Screen(Terminal(file=told, width=120)))
    assert f"! {said}\n" in told.getvalue()
    assert f"{said}." in render(warned)
    assert "Warnings of limits" not in render(run)


def test_an_autospectrum_is_drawn_ten_decades_deep(run: RunRecord) -> None:
    [figure] = [part for part in spectra.parts(run) if isinstance(part, Figure)]
    axes = [axis for name, axis in figure.layout.items() if name.startswith("yaxis")]
    assert axes
    assert max(high - low for low, high in (axis["range"] for axis in axes)) <= 10.0 + 1e-9


def test_each_sensor_is_told_with_its_sensitivity_and_calibration(run: RunRecord, tmp_path: Path) -> None:
    channels = {
        "contact.force_upper": Channel("contact.force_upper", "N", scale=100.0, raw_unit="V"),
        "base.acceleration": Channel("base.acceleration", "m/s2"),
        "crank.angle": Channel("crank.angle", "rad", scale=2 * np.pi / 4096, raw_unit="count"),
    }
    known = {
        "calibrated.contact.force_upper": "2026-01-02, valid until 2027-01-02",
        "sensitivity.base.acceleration": "0.0102",
        "range.contact.force_upper": "200.0",
        "range.base.acceleration": "490.3325",
        "range.crank.angle": "inf",
        "chain.crank.angle": '{"kind": "encoder", "pulses": {"per_revolution": 1024, "index": true}}',
        "chain.yoke.force_x": '{"corner_hz": 0.5}',
        "actuator": "Mitsubishi FR, station 1",
        "chain.torn": "[" * 100_000,
        "chain.deep": "[" * 500 + "]" * 500,
    }
    parts = log_sections.provenance(replace(run, channels=channels, metadata={"run": known}))
    facts, sensors = (part for part in parts if isinstance(part, Table))
    assert [row[3:6] for row in sensors.rows] == [
        ["10 mV/N", "200 N", "2026-01-02, valid until 2027-01-02"],
        ["100 mV/g", "490.3 m/s²", "\N{EN DASH}"],
        ["651.9 count/rad", "\N{EN DASH}", "\N{EN DASH}"],
    ]
    told = dict(facts.rows)
    assert told["run: chain.crank.angle"] == "kind: encoder, pulses: (per revolution: 1024, index: True)"
    assert told["run: actuator"] == known["actuator"]
    assert told["run: chain.yoke.force_x"] == "corner hz: 0.5"
    assert [told[f"run: chain.{name}"] for name in ("torn", "deep")] == [
        known["chain.torn"],
        known["chain.deep"],
    ]
    assert not any(part in row[0] for row in facts.rows for part in ("calibrated", "sensitivity", "range"))
