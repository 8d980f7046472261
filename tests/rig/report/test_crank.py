"""The report of a rig with a crank: speed, impacts over the angle, one revolution, orders."""

import base64
import json
import re
from dataclasses import replace
from io import StringIO
from math import tau
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs

from daq.channel import Channel
from daq.log.reader import LogReader, Origin
from rig.commands.logs import show
from rig.derived.order_lines import TURNS
from rig.derived.settings import RECORD
from rig.pages.content import BigNumbers, Figure, Part, Sentence, Table
from rig.report import record
from rig.report.crank_figures import impacts_by_group, order_lines, speed_figures, speeds, turns_of
from rig.report.page import render
from rig.report.record import RunCollector, RunRecord, Trace, read_run
from rig.report.sections.impacts import parts as impact_parts
from rig.report.sections.overlays import revolution as revolution_parts
from rig.report.sections.spectra import orders as order_parts
from rig.report.sections.spectra import parts as spectrum_parts
from rig.report.sections.speed import parts as speed_parts
from rig.report.sections.summary import parts as summary_parts
from rig.rigs import RIGS
from rig.session.progress import Screen, Terminal
from rig.stream import Block
from tests.rig.browser import faults_of_report, needs_chromium
from tests.rig.derived.turning import BLOW_AT, CHANNELS, RATE, encoder_rad, turns
from tests.rig.report import crank_run
from tests.rig.report.test_page_in_browser import opened

CRANKS = [
    "Summary", "The whole run", "Speed of the crank", "Impacts over the crank angle", "One revolution",
    "Orders", "Autospectra", "Events and gaps", "Scenario", "Provenance",
]  # fmt: skip
ACCELERATION = "crank_frame.acceleration_y"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunRecord:
    return read_run(crank_run.write_log(tmp_path_factory.mktemp("planar") / "run.mcap"))


@pytest.fixture(scope="module")
def spatial(tmp_path_factory: pytest.TempPathFactory) -> RunRecord:
    folder = tmp_path_factory.mktemp("spatial")
    return read_run(crank_run.write_log(folder / "run.mcap", "spatial_slider_crank"))


def headings(run: RunRecord) -> list[str]:
    return re.findall("<h2>(.*)</h2>", render(run).replace(get_plotlyjs(), ""))


def table(parts: list[Part]) -> Table:
    return next(part for part in parts if isinstance(part, Table))


def traces(parts: list[Part]) -> list[dict[str, Any]]:
    return [trace for part in parts if isinstance(part, Figure) for trace in part.traces]


def drawn_values(trace: dict[str, Any]) -> NDArray[np.float32]:
    return np.frombuffer(base64.b64decode(trace["y"]["bdata"]), "<f4")


def showing(run: RunRecord, **measured: NDArray[np.floating]) -> RunRecord:
    """The run with other samples in some measured channels: `angle` and `acceleration`."""
    names = {"angle": "crank.angle", "acceleration": ACCELERATION}
    other: dict[tuple[Origin, str], Trace] = {
        ("measured", names[each]): Trace(values.astype(np.float32), RATE) for each, values in measured.items()
    }
    return replace(run, traces={**run.traces, **other})


def test_a_report_has_the_sections_that_its_rig_has_something_for(run: RunRecord, spatial: RunRecord) -> None:
    assert headings(run) == CRANKS
    assert headings(spatial) == CRANKS


@pytest.mark.parametrize("kind", [kind for kind in RIGS.values() if kind.turns], ids=lambda kind: kind.name)
def test_a_crank_speaks_of_channels_that_its_rig_has(kind: Any) -> None:
    crank = kind.crank
    named = {
        crank.marker,
        *crank.plain,
        *crank.ordered,
        *(name for each in crank.heard(kind.channels).values() for name in each),
    }
    beside = {"crank.angle", "encoder.angle"}  # an encoder may be there beside a marker
    assert named - beside <= set(kind.channels)
    assert crank.plain.isdisjoint(crank.ordered)


def test_speeds_are_those_at_which_the_crank_turned(run: RunRecord, spatial: RunRecord) -> None:
    for each in (run, spatial):
        figures = {whose: speed_figures(speed) for whose, speed in speeds(each).items()}
        # Over 6 s a count of 4096 is 4e-5 of the way, a sample of a marker no more.
        assert figures["measured"].mean == pytest.approx(200.0, rel=1e-4)
        assert figures["predicted"].mean == pytest.approx(200.6, rel=1e-4)
        assert figures["measured"].revolutions == pytest.approx(
            20.0, abs=1.5
        )  # a marker's first and last part
        assert figures["measured"].ripple < 0.1  # counts alone; docs/derived.md
    rows = {row[0]: row for row in table(speed_parts(run)).rows}
    assert rows["predicted"][1:4] == ["crank.angle", "200.60 rpm", "+0.3 %"]
    assert {row[1] for row in table(speed_parts(spatial)).rows} == {"flywheel.marker"}
    assert {trace["name"] for trace in traces(speed_parts(run))} == {"set", "measured", "predicted"}


def test_a_ripple_is_the_deviation_from_the_mean() -> None:
    rpm = 200 + 3 * np.sqrt(2) * np.sin(tau * np.arange(500) / 50)
    figures = speed_figures(Trace(np.append(rpm, np.nan).astype(np.float32), 50.0))
    assert (figures.mean, figures.ripple) == pytest.approx((200.0, 3.0), rel=2e-3)  # n - 1 of 500
    assert figures.highest == pytest.approx(204.24, abs=0.01)


def at_speed(run: RunRecord, rpm: float) -> RunRecord:
    """The run with this for its measured speed."""
    speed = run.speeds["measured"]
    return replace(
        run, speeds={**run.speeds, "measured": replace(speed, values=np.full_like(speed.values, rpm))}
    )


@pytest.mark.parametrize("unset", [False, True])
def test_a_crank_that_stood_is_reported(run: RunRecord, unset: bool) -> None:
    still = np.full(round(6.0 * RATE), 0.3)
    stood = at_speed(showing(run, angle=tau * still), 0.0)
    if unset:
        stood = replace(
            stood, speeds={"measured": stood.speeds["measured"]}, scenario=stood.scenario.split("[drive]")[0]
        )
    row = table(speed_parts(stood)).rows[0]
    assert (row[2], row[5]) == ("0.00 rpm", "–")
    low, high = next(part for part in speed_parts(stood) if isinstance(part, Figure)).layout["yaxis"]["range"]
    assert low < 0 < high
    assert table(impact_parts(stood)).rows[0][3] == "–"
    assert headings(stood) == CRANKS


def test_a_crank_that_turned_backwards_turned_as_often_and_is_told(run: RunRecord) -> None:
    back = at_speed(showing(run, angle=encoder_rad(-turns(6.0))), -200.0)
    figures = speed_figures(back.speeds["measured"])
    assert (figures.mean, figures.revolutions) == pytest.approx((-200.0, 20.0), rel=0.01)
    assert impacts_by_group(back)["crank y"]["measured"].a_revolution == pytest.approx(1.0, rel=0.1)
    bars = [trace for trace in traces(impact_parts(back)) if trace["type"] == "bar"]
    assert bars
    assert all(drawn_values(trace).min() >= 0 for trace in bars)
    low, high = next(part for part in speed_parts(back) if isinstance(part, Figure)).layout["yaxis"]["range"]
    assert low < -200 < 200.6 < high
    alone = replace(back, traces={key: trace for key, trace in back.traces.items() if key[0] == "measured"})
    for each in (back, alone):
        for parts in (order_parts(each), revolution_parts(each)):
            assert "The crank turned backwards (measured): " in str(parts)
    for parts in (order_parts(run), revolution_parts(run)):
        assert "backwards" not in str(parts)


def test_impacts_lie_at_the_angle_of_the_blow_one_a_revolution(run: RunRecord, spatial: RunRecord) -> None:
    for each, groups in ((run, ["crank y", "crank x", "piston y"]), (spatial, ["guide", "socket"])):
        found = impacts_by_group(each)
        assert list(found) == groups
        for group in groups:
            sensors = 8 if group == "guide" else 1
            measured, predicted = found[group]["measured"], found[group]["predicted"]
            placed = measured.angle_deg[np.isfinite(measured.angle_deg)]
            assert np.abs(placed - 360 * BLOW_AT).max() < 1.0  # the ten first samples of a blow are a degree
            assert measured.a_revolution == pytest.approx(sensors, rel=0.1)
            # the samples fall anywhere on a blow
            assert predicted.peak.max() == pytest.approx(0.4 * measured.peak.max(), rel=0.06)


def test_measured_and_predicted_impacts_count_from_one_level(run: RunRecord) -> None:
    """Of a twin that strikes 0.4 times as hard: 15 % of what is typically measured in both rows."""
    turn = round(RATE * 60 / 200)
    turns = run.traces["measured", ACCELERATION].values[: 10 * turn].reshape(10, turn)
    typical = float(np.median(np.abs(turns).max(axis=1)))
    rows = {row[0]: row for row in table(impact_parts(run)).rows}
    assert table(impact_parts(run)).headings[1] == "counts from"
    for whose in ("measured", "predicted"):
        level = float(rows[f"crank y, {whose}"][1].removesuffix(" m/s²"))
        assert level == pytest.approx(0.15 * typical, rel=0.01)
    assert impacts_by_group(run)["crank y"]["predicted"].a_revolution == pytest.approx(1.0, rel=0.1)


def test_the_terminal_tells_the_impacts_of_the_report(spatial: RunRecord) -> None:
    told = StringIO()
    show(spatial, Screen(Terminal(file=told, width=200)))
    rows = {row[0]: row for row in table(impact_parts(spatial)).rows}
    lines = {line.split(":")[0]: line for line in told.getvalue().splitlines() if " impacts, " in line}
    assert len(lines) == len(rows) == 4
    for key, line in lines.items():
        whose, group = key.split()
        _, _, count, _, mean, *_ = rows[f"{group}, {whose}"]
        assert f": {count} impacts, " in line
        assert f"mean peak {float(mean.removesuffix(' N')):.1f} +- " in line


def test_sensors_of_a_group_that_count_from_several_levels_say_so(spatial: RunRecord) -> None:
    settings = dict(spatial.metadata[RECORD])
    measured = json.loads(settings["measured"])
    measured["levels"]["slider.force_3"]["counts_from_n"] = 99.0
    other = replace(
        spatial, metadata={**spatial.metadata, RECORD: {**settings, "measured": json.dumps(measured)}}
    )
    levels = {row[0]: row[1] for row in table(impact_parts(other)).rows}
    assert re.fullmatch(r"\d+(\.\d+)? to 99 N", levels["guide, measured"])
    assert re.fullmatch(r"\d+(\.\d+)? N", levels["socket, measured"])


def test_impacts_are_drawn_measured_and_predicted_for_each_group(run: RunRecord) -> None:
    drawn = [(trace["type"], trace.get("mode"), trace["name"]) for trace in traces(impact_parts(run))]
    assert drawn.count(("scatter", "markers", "measured")) == 3
    assert drawn.count(("scatter", "markers", "predicted")) == 3
    assert drawn.count(("bar", None, "measured")) == 3
    assert table(impact_parts(run)).rows[0][0] == "crank y, measured"


def test_an_order_has_its_amplitude_though_the_speed_varies(run: RunRecord) -> None:
    way = turns(6.0, fluctuation=0.05)
    swinging = showing(run, acceleration=2.0 * np.cos(tau * 3 * way), angle=encoder_rad(way))
    lines = order_lines(swinging, "measured", [ACCELERATION])
    assert lines is not None
    assert lines.amplitude is not None
    # Half a count is 2e-3 rad of order 3: 1e-6 of its amplitude, what the smoothing leaves far less.
    assert lines.amplitude[0, 3 * TURNS] == pytest.approx(2.0, rel=1e-3)
    assert lines.amplitude[0, 5 * TURNS] < 0.01
    assert lines.blocks == 3  # of 8 turns that overlap by half: 20 turns, less the edges, hold three


def test_a_channel_that_was_never_heard_has_dashes_for_its_orders(run: RunRecord) -> None:
    deaf = showing(run, acceleration=np.full(round(6.0 * RATE), np.nan))
    rows = {row[0]: row for row in table(order_parts(deaf)).rows}
    assert set(rows[f"{ACCELERATION}, measured"][2:]) == {"–"}
    assert "–" not in rows[f"{ACCELERATION}, predicted"]


def test_a_hole_in_the_record_ends_a_block_of_turns_and_no_more(run: RunRecord) -> None:
    way = turns(20.0)
    angle, values = encoder_rad(way), np.cos(tau * 2 * way)
    hole = slice(round(9.3 * RATE), round(10.1 * RATE))
    angle[hole] = values[hole] = np.nan
    holed = showing(run, acceleration=values, angle=angle)
    lines = order_lines(holed, "measured", [ACCELERATION])
    assert lines is not None
    assert lines.amplitude is not None
    assert lines.amplitude[0, 2 * TURNS] == pytest.approx(1.0, rel=1e-3)
    mean = next(
        trace
        for trace in traces(revolution_parts(holed))
        if trace["meta"] == ACCELERATION and trace["name"] == "measured" and trace["xaxis"] == "x2"
    )
    # Filtered at 0.44 of 1440 orders, order 2 is as it was; what remains is the hole's edge of a count.
    assert np.abs(drawn_values(mean)).max() == pytest.approx(1.0, rel=3e-3)


@pytest.mark.long
@pytest.mark.parametrize("beside", [crank_run.ENCODER, Channel("bearing.temperature", "K")])
def test_what_has_another_rate_than_the_angle_takes_nothing_from_the_rest(
    run: RunRecord, tmp_path: Path, beside: Channel
) -> None:
    slow = read_run(crank_run.write_log(tmp_path / "run.mcap", beside=[beside]))
    assert ("measured", beside.name) in slow.traces
    assert table(order_parts(slow)).rows == table(order_parts(run)).rows
    assert traces(revolution_parts(slow)) == traces(revolution_parts(run))
    text = f"another rate than what tells the angle: {beside.name} (measured)."
    told = [text in str(parts) for parts in (order_parts(slow), revolution_parts(slow))]
    assert told == [beside is not crank_run.ENCODER] * 2  # nobody misses an encoder there
    spectra = {trace["meta"] for trace in traces(spectrum_parts(slow))}
    assert (beside.name in spectra) == (beside is not crank_run.ENCODER)
    assert headings(slow) == CRANKS


def test_a_long_run_says_what_is_of_its_beginning_only(
    run: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run.kept_s is None
    monkeypatch.setattr(record, "_KEPT_SAMPLES", round(10 * 4.0 * RATE))  # four seconds of ten traces
    long = read_run(run.path)
    assert long.kept_s == pytest.approx(4.0)
    for parts in (order_parts(long), revolution_parts(long)):
        assert "of the first 4 s" in str(parts[1])


def test_turns_are_those_of_the_crank(run: RunRecord, spatial: RunRecord) -> None:
    for each, off in ((run, 0), (spatial, 1)):
        found = turns_of(each, "measured")
        assert found is not None
        known = np.flatnonzero(np.isfinite(found))
        assert len(known) > 0.9 * len(found)
        error = found[known] - (turns(6.0)[known] - off)  # a marker's first revolution is its number 0
        assert np.abs(error).max() < 1e-3  # four counts: the edges of what is smoothed


def test_a_mean_revolution_is_what_all_share(run: RunRecord) -> None:
    way = turns(6.0)
    in_turn = np.where(np.floor(way) % 2 == 0, 0.5, -0.5)
    shown = showing(run, acceleration=np.sin(tau * 2 * way) + in_turn)
    drawn = [trace for trace in traces(revolution_parts(shown)) if trace["meta"] == ACCELERATION]
    one, mean = [trace for trace in drawn if trace["name"] == "measured"]
    assert np.abs(drawn_values(one)).max() == pytest.approx(1.5, rel=1e-3)
    # Of 19 whole turns one is not made up for by its neighbour: 0.5 / 19, and its jump rings on.
    assert np.abs(drawn_values(mean)).max() == pytest.approx(1.0, abs=0.06)
    low, high = (drawn_values(trace) for trace in drawn if trace["name"] == "scatter")
    # the jumps ring at the revolutions' ends
    np.testing.assert_allclose((high - low)[100:-100] / 2, 0.5, rtol=0.02)
    names = {trace["meta"] for trace in traces(revolution_parts(run))}
    assert names == {channel.name for channel in CHANNELS} - {"crank.angle", "crank.marker"}


@pytest.mark.parametrize("leap", [7.3, -7.3])
def test_what_lies_behind_a_leap_of_the_angle_is_in_the_mean(run: RunRecord, leap: float) -> None:
    way = turns(6.0)
    hole = slice(round(3.0 * RATE), round(4.0 * RATE))
    way[hole] = np.nan
    way[hole.stop :] += leap
    shown = showing(run, acceleration=np.sin(tau * 2 * way), angle=encoder_rad(way))
    # 0.25 to 10.25 turns, then from 20.88 or 6.28 on for 6.67: nine whole ones, and six or five.
    sentences = [each.text for each in revolution_parts(shown) if isinstance(each, Sentence)]
    told = next(text for text in sentences if text.startswith("Revolutions in the mean"))
    counts = re.findall(r"(\d+) (?:measured|predicted)", told)
    assert counts == ["15" if leap > 0 else "14", "19"]


def test_a_mean_says_of_how_many_revolutions_it_is(run: RunRecord) -> None:
    assert "Revolutions in the mean: 19 measured, 19 predicted." in str(revolution_parts(run))
    holed = np.sin(tau * 2 * turns(6.0))
    holed[round(3.0 * RATE)] = np.nan
    text = str(revolution_parts(showing(run, acceleration=holed)))
    assert "Revolutions in the mean: 18 to 19 measured, 19 predicted." in text


def test_the_summary_tells_speed_and_impacts_and_no_rms_of_an_angle(run: RunRecord) -> None:
    parts = summary_parts(run)
    labels = [each.label for part in parts if isinstance(part, BigNumbers) for each in part.numbers]
    assert labels == [
        "Recorded", "Samples", "Largest difference", "Crank speed", "Peak of an impact, crank y",
    ]  # fmt: skip
    rows = {row[0]: row for row in table(parts).rows}
    assert set(rows["crank.angle"][2:7]) == {"–"}
    assert "–" not in rows["crank.marker"]


def test_what_a_run_does_not_have_is_said_in_a_line(tmp_path: Path) -> None:
    log = crank_run.write_log(tmp_path / "run.mcap", channels=CHANNELS[:3])
    run = read_run(log)
    for parts, text in (
        (speed_parts(run), "holds no speed of the crank"),
        (order_parts(run), "nothing to count orders by"),
        (revolution_parts(run), "No whole revolution"),
    ):
        assert len(parts) == 1
        assert isinstance(parts[0], Sentence)
        assert text in parts[0].text
    assert "neither encoder nor marker" in str(impact_parts(run)[-1])
    assert headings(run) == CRANKS


def test_a_log_without_what_is_derived_is_reported(tmp_path: Path) -> None:
    run = read_run(crank_run.write_log(tmp_path / "run.mcap", seconds=1.0, derive=False))
    assert [str(part.kind) for part in speed_parts(run)] == ["sentence"]
    assert run.impacts  # which are found when it is read
    assert "Fewer than 8 whole revolutions" in str(order_parts(run)[0])
    assert headings(run) == CRANKS


def test_a_prediction_alone_is_named_as_such(tmp_path: Path) -> None:
    run = read_run(crank_run.write_log(tmp_path / "run.mcap", origins=("predicted",)))
    numbers = next(part for part in summary_parts(run) if isinstance(part, BigNumbers)).numbers
    speed = next(each for each in numbers if each.label == "Crank speed")
    assert (speed.text, speed.remark) == ("–", "set 200 rpm; predicted 200.60 rpm")
    assert headings(run) == CRANKS


def test_what_a_replay_hands_on_is_what_a_log_holds(run: RunRecord) -> None:
    with LogReader(run.path) as log:
        collector = RunCollector(log)
        for origin, block in log.blocks():
            collector(Block(origin, block))
        for impact in log.impacts():
            collector(impact)
        again = collector.record()
    assert again.impacts == run.impacts
    assert np.array_equal(again.speeds["measured"].values, run.speeds["measured"].values, equal_nan=True)
    assert len(again.speeds["measured"].values) == pytest.approx(6.0 * 50, abs=1)


@pytest.mark.browser
@needs_chromium
def test_every_plot_holds_both(run: RunRecord, spatial: RunRecord, tmp_path: Path) -> None:
    for each in (run, spatial):
        html = tmp_path / f"{each.roles.marker}.html"
        html.write_text(render(each), encoding="utf-8")
        drawn, complaints, fetched = opened(html)
        for plot in ("plot-speed", "plot-impacts", "plot-revolution", "plot-orders", "plot-spectra"):
            names = {line["name"] for line in drawn[plot] if line["count"] > 10}
            assert {"measured", "predicted"} <= names, plot
        assert complaints == []
        assert fetched == [html.as_uri()]


@pytest.mark.long
@pytest.mark.browser
@needs_chromium
def test_no_text_of_a_cranks_report_is_cut_or_lies_on_another(
    run: RunRecord, spatial: RunRecord, tmp_path: Path
) -> None:
    for each in (run, spatial):
        html = tmp_path / f"{each.roles.marker}.html"
        html.write_text(render(each), encoding="utf-8")
        assert faults_of_report(html) == []


def test_each_angle_tells_how_far_it_lies_from_where_it_is_predicted(run: RunRecord) -> None:
    """An encoder beside the card, 0.5 ms late, whose first position comes 0.7 ms after the card's first."""
    angle = tau * 200.0 / 60.0
    at_s = np.arange(6000) / 1000.0 + 0.7e-3
    seen = Trace((angle * (at_s - 0.5e-3)).astype(np.float32), 1000.0, 0.7e-3)
    twin = Trace((angle * np.arange(6 * RATE) / RATE + tau).astype(np.float32), RATE)
    channels = {**run.channels, "encoder.angle": crank_run.ENCODER}
    traces = {("measured", "encoder.angle"): seen, ("predicted", "encoder.angle"): twin}
    both = replace(run, channels=channels, traces={**run.traces, **traces})  # type: ignore[dict-item]
    tables = [part for part in speed_parts(both) if isinstance(part, Table)]
    (rows,) = (each.rows for each in tables if each.caption.startswith("Angles"))
    assert [row[0] for row in rows] == ["crank.angle", "encoder.angle"]
    assert rows[1][1:] == ["−0.60°", "0.00°"]
