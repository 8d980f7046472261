"""`rattle.open`: a log as arrays, frames and figures; and what is said where something is not there."""

from __future__ import annotations

import resource
import subprocess
import sys
from base64 import b64decode
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import rattle
from daq.block import NS_PER_S, SampleBlock
from daq.channel import Channel
from daq.log.reader import LogReader
from daq.log.writer import LogWriter
from rig.derived.settings import RECORD, RULE
from rig.report.record import read_run
from tests.daq.formats import runs
from tests.daq.log.logs import write_ramp
from tests.rig.synthetic_run import START_NS, write_log


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Three rates, a gap, a prediction, impacts, an event."""
    return runs.write_run(tmp_path / "run.mcap", {RECORD: {"rule": RULE}})


def test_the_public_names_are_these() -> None:
    assert dir(rattle) == sorted(rattle.__all__)
    assert all(getattr(rattle, name) is not None for name in rattle.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'opne'"):
        rattle.opne  # noqa: B018


def test_importing_it_takes_no_time() -> None:
    """0.3 s are promised; nothing that takes long is loaded before it is used."""
    code = "import sys, rattle; print(*sys.modules)"
    begun = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    loaded = subprocess.check_output([sys.executable, "-c", code], text=True)  # noqa: S603
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begun < 0.3
    assert not {"numpy", "pandas", "plotly", "rig", "daq"} & set(loaded.split())


def test_a_channel_is_an_array_with_time_and_unit(path: Path) -> None:
    log = rattle.open(str(path))
    with LogReader(path) as reader:
        whole = reader.series("measured", "contact.force_upper")
    force = log["contact.force_upper"]
    assert (force.origin, force.unit, force.sample_rate, len(force)) == ("measured", "N", 51_200.0, 51_200)
    assert np.array_equal(np.asarray(force), whole.values, equal_nan=True)
    assert np.asarray(force, np.float64).dtype == np.float64
    assert np.array(force, copy=True).flags.owndata
    assert force.values.dtype == np.float32
    assert np.array_equal(force.time, np.arange(51_200) / 51_200.0)
    assert force.start == np.datetime64(runs.START_NS, "ns")
    assert np.isnan(force.values[4 * 5120 : 5 * 5120]).all()
    assert log.predicted["contact.force_upper"].origin == "predicted"
    assert list(log.measured) == [
        "contact.force_upper",
        "base.acceleration",
        "crank.angle",
        "drive.force",
    ]
    assert "base.acceleration" in log
    assert "gone" not in log


def test_a_log_to_a_frame_takes_three_lines(path: Path) -> None:
    log = rattle.open(path)
    part = log.to_pandas(["contact.force_upper"], start=0.1, end=0.2)
    assert list(part.columns) == ["contact.force_upper"]
    assert part.index.name == "time"
    assert (part.index[0], len(part)) == (0.1, 5120)
    assert part.attrs["units"] == {"contact.force_upper": "N"}
    single = log["base.acceleration"].to_pandas()
    assert (single.name, single.attrs["unit"], len(single)) == ("base.acceleration", "m/s2", 1000)
    with pytest.raises(
        rattle.RattleError, match=r"several: contact\.force_upper 51200 Hz .*, base\.acc.* 1000 Hz"
    ):
        log.to_pandas(["contact.force_upper", "base.acceleration"])


def test_what_is_not_installed_is_named(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = rattle.open(path)
    for package in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(rattle.RattleError, match=f"takes {package}, .* pip install {package}"):
            getattr(log, f"to_{package}")(["base.acceleration"])


def test_a_log_to_xarray_has_a_time_for_each_rate(path: Path) -> None:
    found = rattle.open(path).to_xarray()
    assert set(found.data_vars) == {"contact.force_upper", "base.acceleration", "crank.angle"}
    assert found["contact.force_upper"].dims == ("time",)
    assert {found[name].dims for name in ("base.acceleration", "crank.angle")} == {("time_2",), ("time_3",)}
    assert found["base.acceleration"].attrs["units"] == "m/s2"
    assert found["crank.angle"].dtype == np.float64
    assert float(found["crank.angle"]["time_3"][0]) == pytest.approx(300 / runs.ODD)


@pytest.mark.parametrize("late_s", [0.035, 0.024, -0.01])
def test_what_starts_at_another_time_is_shown_there(tmp_path: Path, late_s: float) -> None:
    """A channel with a rate of its own: its sample 0 is not that of the card."""
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        for origin, name, rate, off_s in (
            ("measured", "yoke.force", 1000.0, 0.0),
            ("derived", "yoke.force.cycle_peak", 20.0, late_s),
        ):
            log.declare(origin, Channel(name, "N"))
            at_ns = runs.START_NS + round(off_s * NS_PER_S)
            values = np.ones(10, np.float32)
            log.add_block(origin, SampleBlock(name, 0, at_ns, rate, values), at_ns)
    log = rattle.open(path)
    peaks = log.derived["yoke.force.cycle_peak"]
    times = late_s + np.arange(10) / 20.0
    assert peaks.time == pytest.approx(times, abs=1e-9)
    assert log.derived.to_pandas().index.to_numpy() == pytest.approx(times, abs=1e-9)
    # from the sample next to a time
    part = log.derived.to_pandas(start=0.1, end=0.3)
    assert part.index.to_numpy() == pytest.approx([at for at in times if 0.075 < at < 0.275], abs=1e-9)


def test_a_frame_refuses_channels_of_one_rate_and_two_starts(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        for name, late_ns in (("a", 0), ("b", 0), ("c", 10_000_000)):
            log.declare("measured", Channel(name, "N"))
            at_ns = runs.START_NS + late_ns
            log.add_block("measured", SampleBlock(name, 0, at_ns, 20.0, np.ones(10, np.float32)), at_ns)
    assert list(rattle.open(path).to_pandas().columns) == ["a", "b"]
    with pytest.raises(
        rattle.RattleError, match=r"start, these have several: b 20 Hz from 0 s, c 20 Hz from 0\.01"
    ):
        rattle.open(path).to_pandas(["b", "c"])


def test_events_and_impacts_are_tables_also_where_there_are_none(path: Path, tmp_path: Path) -> None:
    log = rattle.open(path)
    assert [each.peak for each in log.impacts] == [each.peak for each in runs.IMPACTS]
    frame = log.impacts.to_pandas()
    assert frame["time"].tolist() == pytest.approx([7e-9, 9e-9], abs=1e-12)
    assert frame["peak"].tolist() == [each.peak for each in runs.IMPACTS]
    assert [str(each) for each in frame["utc"].dt.year] == ["2026", "2026"]
    assert log.events[0] == runs.EVENT
    assert (4 * 5120, 5120) in [(gap.first_sample, gap.count) for gap in log.gaps]
    with LogWriter(tmp_path / "empty.mcap") as writer:
        writer.declare("measured", runs.FORCE)
    none = rattle.open(tmp_path / "empty.mcap").impacts.to_pandas()
    assert len(none) == 0
    assert "peak" in none


@pytest.mark.parametrize("said", [{}, {RECORD: {"rule": "1"}}], ids=["foreign", "older rule"])
def test_impacts_go_by_the_rule_of_this_version_whatever_the_log_counted(
    tmp_path: Path, said: dict[str, dict[str, str]]
) -> None:
    """Those of a log that has none, and of one that has some by an earlier rule, are those of its report."""
    path = write_log(tmp_path / "run.mcap", 2.0, metadata=said)
    impacts = rattle.open(path).impacts
    assert Counter(each.origin for each in impacts) == {"measured": 80, "predicted": 80}
    assert list(impacts) == read_run(path).impacts


def test_a_channel_that_is_not_there_is_told_with_what_is_meant(path: Path) -> None:
    log = rattle.open(path)
    with pytest.raises(
        rattle.RattleError,
        match=r"no channel 'base\.aceleration' is in it; did you mean base\.acc",
    ):
        log["base.aceleration"]
    with pytest.raises(
        rattle.RattleError, match=r"no channel 'x' was predicted; there are contact\.force_upper"
    ):
        log.predicted["x"]
    with pytest.raises(rattle.RattleError, match="no channel 'x' was derived; there are none"):
        log.derived["x"]
    with pytest.raises(rattle.RattleError, match="none in the asked time"):
        log.measured.series(["base.acceleration"], start=7.0)


def test_a_cut_log_is_read_as_far_as_it_goes_and_says_so(tmp_path: Path) -> None:
    path = write_ramp(tmp_path / "run.mcap")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    log = rattle.open(path)
    assert not log.complete
    assert "ends in the middle" in log.damage
    assert 0 < len(log["a"]) < 3000
    assert len(log.to_pandas()) == len(log["a"])
    assert "cut short" in repr(log)
    assert "cut short: it ends in the middle" in log._repr_html_()


@pytest.mark.parametrize("content", [b"", b"hello"])
def test_what_is_no_log_is_told(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(rattle.RattleError, match=r"a\.mcap: not a log"):
        rattle.open(tmp_path / "a.mcap")
    with pytest.raises(rattle.RattleError, match="No such file"):
        rattle.open(tmp_path / "gone.mcap")


def test_a_notebook_shows_each_and_believes_no_name(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    odd = "<script>alert(1)</script>"
    with LogWriter(path) as writer:
        writer.declare("measured", Channel(odd, odd))
        block = SampleBlock(odd, 0, runs.START_NS, 1000.0, np.ones(10, np.float32))
        writer.add_block("measured", block, runs.START_NS)
        writer.add_event(runs.EVENT)
    log = rattle.open(path)
    for shown in (log, log.measured, log[odd], log.events):
        assert "<table>" in shown._repr_html_()
        assert "<script>" not in shown._repr_html_()
    assert repr(log[odd]) == f"<Series measured/{odd} [{odd}]: 10 samples at 1000 Hz>"


def test_a_figure_has_measured_over_predicted_and_units(tmp_path: Path) -> None:
    log = rattle.open(write_log(tmp_path / "run.mcap"))
    figure = log.plot("contact.force_upper", "yoke.force")
    assert [trace.name for trace in figure.data] == ["measured", "predicted"] * 2
    assert figure.layout.yaxis.title.text == "N"
    assert figure.layout.xaxis2.title.text == "time / s"
    assert max(len(trace.x) for trace in figure.data) <= 4001
    assert len(log.plot().data) == 10
    assert len(log["yoke.force"].plot().data) == 1
    assert log["base.acceleration"].plot().layout.yaxis.title.text == "m/s²"
    with LogWriter(tmp_path / "turning.mcap") as turning:
        turning.declare("derived", Channel("crank.speed", "rad/s"))
        turns = np.full(9, 2 * np.pi, np.float32)
        turning.add_block("derived", SampleBlock("crank.speed", 0, START_NS, 50.0, turns), START_NS)
    speed = rattle.open(tmp_path / "turning.mcap").plot()
    assert speed.layout.yaxis.title.text == "rpm"
    packed = speed.data[0].y
    assert np.frombuffer(b64decode(packed["bdata"]), packed["dtype"]) == pytest.approx(60.0)
    with pytest.raises(rattle.RattleError, match=r"did you mean yoke\.force"):
        log.plot("yoke.forc")


def test_a_log_has_its_verdict_and_its_page_with_it(tmp_path: Path) -> None:
    log = rattle.open(write_log(tmp_path / "run.mcap"))
    assert log.verdict.well is None
    assert log.verdict.sentences == ("Not judged: RATTLE_HEALTHY_RIGS is 0.",)
    assert log.report() == tmp_path / "run.html"
    page = (tmp_path / "run.html").read_text()
    assert len(page) > 100_000
    assert log.verdict.sentences[0] in page
    with pytest.raises(rattle.RattleError, match=r"cannot write .*gone.*No such file"):
        log.report(tmp_path / "gone" / "run.html")


def test_a_figure_leaves_out_what_has_no_sample(path: Path) -> None:
    figure = rattle.open(path).plot()
    assert [title.text for title in figure.layout.annotations] == [
        "<b>contact.force_upper</b>",
        "<b>base.acceleration</b>",
        "<b>crank.angle</b>",
    ]


def test_what_a_run_was_is_at_hand(path: Path, tmp_path: Path) -> None:
    assert rattle.open(path).notes == {}
    noted = write_log(
        tmp_path / "noted.mcap", 0.1, scenario='name = "a"\n[notes]\noperator = "Ada"\nheat = 21\n'
    )
    assert rattle.open(noted).notes == {"operator": "Ada", "heat": "21"}
    deep = f"notes = {'[' * 100_000}"
    for number, odd in enumerate(("[notes", deep, f"notes = {'9' * 10_000}", f"a = '{'x' * (5 << 20)}'")):
        assert rattle.open(write_log(tmp_path / f"{number}.mcap", 0.1, scenario=odd)).notes == {}
