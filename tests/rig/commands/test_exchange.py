"""`rattle export` and `rattle import`: there and back, files of others, and everything that is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from nptdms import ChannelObject, TdmsWriter

from daq.block import Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.log.front import CUT
from daq.log.reader import SURROGATE, LogReader
from daq.log.records import Event, Impact
from daq.log.recover import verify_log
from daq.log.writer import LogWriter
from rig.derived.settings import RECORD, RULE
from tests.daq.formats.test_foreign_files import dataset, pyuff_file
from tests.rig.commands.cli import Answer, Call
from tests.rig.synthetic_run import SCENARIO, START_NS, write_log

FORCE = Channel("contact.force_upper", "N", "force", "contact", "piezo", "SN1", 41.7, "V")
BASE = Channel("base.acceleration", "m/s2")
RUN = f'{SCENARIO}\n[acquisition]\nsample_rate = "51.2 kHz"\nduration = "1 s"\n'
SAMPLES = Path(__file__).parents[3].parent / "shared" / "samples"
SUFFIX = {"uff": ".uff", "tdms": ".tdms", "mat": ".mat", "csv": ".csv", "parquet": ".parquet"}
COUNT = 1000
HIT = Impact(START_NS + 15_000_000, "measured", FORCE.name, 760, 790, 770, 40.0, 39.0, 0.1, 5e-4, 0, 0.3)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "scenario.toml"
    path.write_text(RUN, encoding="utf-8")
    return path


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two rates, a prediction, a gap and an overload."""
    rng = np.random.default_rng(1)
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": RUN})
        log.add_metadata("run", {"id": "run-7", "started": "2026-09-21T14:13:20Z"})
        log.add_event(Event(START_NS, "info", "sequencer", "recording", "recording started"))
        log.add_metadata(RECORD, {"rule": RULE})
        log.add_impact(HIT, HIT.time_ns)
        for origin, channel, rate in (
            ("measured", FORCE, 51_200.0),
            ("predicted", FORCE, 51_200.0),
            (SURROGATE, FORCE, 51_200.0),
            ("measured", BASE, 1000.0),
        ):
            log.declare(origin, channel)
            for number in (0, 1, 3):
                flags = Flag.OVERLOAD if number == 1 else Flag.GOOD
                values = rng.normal(size=COUNT).astype(np.float32)
                first = number * COUNT
                block = SampleBlock(
                    channel.name, first, sample_time_ns(START_NS, first, rate), rate, values, flags
                )
                log.add_block(origin, block, block.time_ns)
    return path


@pytest.mark.parametrize("name", list(SUFFIX))
def test_a_log_comes_back_from_every_format(
    call: Call, run: Path, scenario: Path, tmp_path: Path, name: str
) -> None:
    answer = call("export", run, "--to", name, "--all-rates")
    assert answer.code == 0, answer.err
    files = sorted(tmp_path.glob(f"run*{SUFFIX[name]}"))
    told = [line.split()[1] for line in answer.out.splitlines() if line.startswith("file ")]
    assert sorted(told) == sorted(map(str, files))
    plain = ["", ".1000Hz", ".impacts"] if name in ("csv", "parquet") else [""]
    assert told == [str(tmp_path / f"run{each}{SUFFIX[name]}") for each in plain]
    answer = call("import", *files, "--scenario", scenario, "-o", tmp_path / "back.mcap")
    assert answer.code == 0, answer.err
    assert "!" not in answer.out
    assert verify_log(tmp_path / "back.mcap").sound
    with LogReader(run) as log, LogReader(tmp_path / "back.mcap") as back:
        assert back.scenario == RUN
        assert back.metadata["run"]["id"] == ("run" if name == "uff" else "run-7")
        for origin in ("measured", "predicted", SURROGATE):
            assert back.channels(origin) == log.channels(origin)
            for channel, whole in log.table(origin).items():
                found = back.series(origin, channel)
                assert found.values.tobytes() == whole.values.tobytes()
                assert dataclasses.replace(found, values=whole.values) == whole
        assert {(gap.channel, gap.first_sample, gap.count) for gap in back.gaps()} == {
            (gap.channel, gap.first_sample, gap.count) for gap in log.gaps()
        }
        assert back.events() == ([] if name == "uff" else log.events())
        assert back.impacts() == ([] if name == "uff" else [HIT])


def test_impacts_that_a_log_has_not_counted_by_this_rule_are_exported_all_the_same(
    call: Call, tmp_path: Path
) -> None:
    run = write_log(tmp_path / "run.mcap", 2.0, origins=["measured"])
    asked = ("--channels", "contact.force_upper", "--from", "1 s", "--all-rates")
    assert call("export", run, "--to", "csv", *asked).code == 0
    found = pd.read_csv(tmp_path / "run.impacts.csv")
    assert len(found) == 20
    assert set(found["channel"]) == {"contact.force_upper"}


@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_one_plain_file_of_what_is_asked_for(call: Call, run: Path, tmp_path: Path, name: str) -> None:
    """The first table is in exactly the file that was named; what is left out is said."""
    file = tmp_path / "plain" / f"p.{name}"
    file.parent.mkdir()
    answer = call("export", run, "--to", name, "-o", file)
    assert answer.code == 0, answer.err
    assert "left out   measured/base.acceleration: other rates (--all-rates)" in answer.out
    assert list(file.parent.iterdir()) == [file]
    found = table(file)
    force = f"contact.force_upper{' [N]' if name == 'csv' else ''}"
    assert {f"measured/{force}", f"predicted/{force}"} < set(found.columns)
    with LogReader(run) as log:
        whole = log.series("measured", FORCE.name).values
        base = log.series("measured", BASE.name, 0.25, 0.75).values
    assert np.array_equal(found[f"measured/{force}"].astype("f4"), whole, equal_nan=True)
    # another rate alone, by its name
    file.unlink()
    asked = ("--channels", "base.*", "--from", "250 ms", "--to-time", "0.75")
    assert call("export", run, "--to", name, "-o", file, *asked).code == 0
    assert list(file.parent.iterdir()) == [file]
    found = table(file)
    column = f"measured/base.acceleration{' [m/s2]' if name == 'csv' else ''}"
    assert np.array_equal(found[column].astype("f4"), base)
    if name == "csv":
        assert np.array_equal(found["time [s]"], np.arange(250, 750) / 1000)
    answer = call("import", file, "-o", tmp_path / "back.mcap")
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "back.mcap") as back, LogReader(run) as log:
        found_base = back.series("measured", BASE.name, 0.25)
        wanted = log.series("measured", BASE.name, 0.25, 0.75)
        assert (found_base.first_sample, found_base.time_ns) == (250, wanted.time_ns)
        assert found_base.values.tobytes() == base.tobytes()
    assert verify_log(tmp_path / "back.mcap").sound


def test_a_file_that_is_there_is_refused_before_anything_is_read(
    call: Call, run: Path, tmp_path: Path
) -> None:
    (tmp_path / "there.csv").write_text("mine")
    answer = call("export", run, "--to", "csv", "-o", tmp_path / "there.csv")
    assert answer.code == 1
    assert "there.csv exists already" in answer.err
    assert "reading" not in answer.out
    assert (tmp_path / "there.csv").read_text() == "mine"


def table(path: Path) -> pd.DataFrame:
    return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)


def test_what_is_left_out_is_named_and_counted(call: Call, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap") as log:
        for number in range(6):
            channel = Channel(f"c{number}", "N")
            log.declare("derived" if number else "measured", channel)
            values, rate = np.ones(100, np.float32), 1000.0 if number == 0 else 20.0
            block = SampleBlock(channel.name, 0, START_NS, rate, values)
            log.add_block("derived" if number else "measured", block, START_NS)
        log.add_impact(HIT, START_NS)
    answer = call("export", tmp_path / "run.mcap", "--to", "csv", "--channels", "c*,c5")  # one by its name
    assert "left out   impacts (--all-rates)" in answer.out
    assert "left out   derived/c1, derived/c2, derived/c3 and 1 more: other rates (--all-rates)" in answer.out
    assert list(table(tmp_path / "run.20Hz.csv").columns) == ["time [s]", "derived/c5 [N]", "rattle"]
    answer = call("export", tmp_path / "run.mcap", "--to", "parquet")
    assert "left out   derived/c1, derived/c2, derived/c3 and 2 more: other rates (--all-rates)" in answer.out


def test_channels_of_several_rates_lie_beside_the_first(call: Call, run: Path, tmp_path: Path) -> None:
    asked = ("--channels", "contact.force_upper, base.acceleration", "--origin", "measured")
    assert call("export", run, "--to", "csv", "-o", tmp_path / "p.csv", *asked).code == 0
    assert sorted(path.name for path in tmp_path.glob("p*")) == ["p.1000Hz.csv", "p.csv"]
    assert list(table(tmp_path / "p.csv").columns) == [
        "time [s]",
        "measured/contact.force_upper [N]",
        "rattle",
    ]


@pytest.mark.parametrize("name", list(SUFFIX))
def test_every_format_takes_a_part_of_a_run(call: Call, run: Path, tmp_path: Path, name: str) -> None:
    file = tmp_path / f"part{SUFFIX[name]}"
    asked = ("--channels", FORCE.name, "--origin", "predicted", "--from", "0.01", "--to-time", "0.03 s")
    answer = call("export", run, "--to", name, "-o", file, *asked)
    assert answer.code == 0, answer.err
    scenario = tmp_path / "s.toml"
    scenario.write_text(RUN, encoding="utf-8")
    answer = call("import", file, "--scenario", scenario, "-o", tmp_path / "back.mcap")
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "back.mcap") as back, LogReader(run) as log:
        assert not back.channels("measured")
        found = back.series("predicted", FORCE.name, 0.01)
        wanted = log.series("predicted", FORCE.name, 0.01, 0.03)
        assert found.values.tobytes() == wanted.values.tobytes()
        assert (found.first_sample, found.time_ns) == (512, wanted.time_ns)


def test_the_scenario_that_a_file_carries_is_enough(call: Call, run: Path, tmp_path: Path) -> None:
    assert call("export", run, "--to", "mat", "-o", tmp_path / "a.mat").code == 0
    answer = call("import", tmp_path / "a.mat")
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "a.mcap") as log:
        assert log.scenario == RUN
        assert log.metadata["run"]["imported_from"] == "a.mat"


def test_an_export_says_what_the_format_cannot_hold(call: Call, run: Path) -> None:
    out = call("export", run, "--to", "uff").out
    assert "! uff holds no events, clock records" in out
    assert "! measured/contact.force_upper: uff flags a whole unbroken part" in out


def test_a_cut_log_is_exported_as_far_as_it_goes(call: Call, run: Path, tmp_path: Path) -> None:
    run.write_bytes(run.read_bytes()[:-200])
    answer = call("export", run, "--to", "parquet", "-o", tmp_path / "cut.parquet")
    assert answer.code == 0, answer.err
    assert "cut short: exported as far as it goes" in answer.out
    assert call("import", tmp_path / "cut.parquet").code == 0
    back = verify_log(tmp_path / "cut.mcap")
    assert (back.recovered_from, back.size_bytes) == (CUT, run.stat().st_size)


# --- files of other programs


def csv_file(path: Path, *columns: tuple[str, str, np.ndarray], time: bool = True) -> Path:
    names, units, rows = zip(*columns, strict=True)
    table = np.column_stack(rows)
    lines = [",".join(names), ",".join(units)] if any(units) else [",".join(names)]
    if time:
        lines = [f"time,{lines[0]}", *(f"s,{line}" for line in lines[1:])]
    for index, row in enumerate(table):
        cells = [repr(float(value)) for value in row]
        lines.append(",".join([repr(index / 51_200), *cells] if time else cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def bring(call: Call, path: Path, scenario: Path, *more: object) -> Answer:
    return call("import", path, "--scenario", scenario, *more)


def test_a_csv_by_hand_becomes_a_valid_log(call: Call, scenario: Path, tmp_path: Path) -> None:
    values = np.linspace(-1, 1, COUNT)
    path = csv_file(
        tmp_path / "hand.csv", ("contact.force_upper", "kN", values), ("beam.acceleration_50", "g", values)
    )
    answer = bring(call, path, scenario, "--started", "2026-09-21T14:13:20.123456789Z")
    assert answer.code == 0, answer.err
    assert "contact.force_upper: kN -> N, times 1000" in answer.out
    assert verify_log(tmp_path / "hand.mcap").sound
    with LogReader(tmp_path / "hand.mcap") as log:
        force, beam = (log.series("measured", name) for name in log.channels("measured"))
        assert log.metadata["run"]["started"] == "2026-09-21T14:13:20.123456789Z"
        assert log.channels("measured")["beam.acceleration_50"].unit == "m/s2"
    assert np.array_equal(force.values, values * 1000)
    assert np.array_equal(beam.values, values * 9.80665)
    assert force.values.dtype == np.float64
    # the scenario's rate, which the times allow, and not their own 51 199.99...
    assert (force.sample_rate, force.time_ns) == (51_200.0, START_NS + 123_456_789)


def test_what_a_file_does_not_say_is_taken_from_the_scenario_aloud(
    call: Call, scenario: Path, tmp_path: Path
) -> None:
    path = csv_file(tmp_path / "bare.csv", ("contact_force_upper", "", np.ones(10)), time=False)
    answer = bring(call, path, scenario)
    assert answer.code == 0, answer.err
    for words in (
        "! contact_force_upper is taken for contact.force_upper",
        "! contact.force_upper: the file has no unit; taken to be in N, the rig's",
        "! contact_force_upper: the file has no rate; taken to be the scenario's 51200 Hz",
        "! the file has no date: its first sample is put at 1970-01-01",
    ):
        assert words in answer.out
    with LogReader(tmp_path / "bare.mcap") as log:
        assert (log.series("measured", "contact.force_upper").time_ns) == 0


def test_every_name_and_unit_that_does_not_fit_is_listed_at_once(
    call: Call, scenario: Path, tmp_path: Path
) -> None:
    ones = np.ones(10)
    path = csv_file(
        tmp_path / "bad.csv",
        ("contact.force_uper", "N", ones),
        ("yoke.force", "mm", ones),
        ("../../etc/passwd", "N", ones),
        ("drive.force", "N", ones),
    )
    answer = bring(call, path, scenario, "--skip", "laser", "--unit", "gone=N")
    assert answer.code == 2
    for words in (
        'channel = "contact.force_uper": a channel of the impact_beam',
        "--rename 'contact.force_uper'=contact.force_upper, or --skip 'contact.force_uper'",
        'yoke.force.unit = "mm": N or a multiple of it',
        'channel = "../../etc/passwd"',
        '--skip = "laser": a channel of the file',
        '--unit = "gone": a channel of the file',
    ):
        assert words in answer.err
    assert not (tmp_path / "bad.mcap").exists()
    answer = bring(
        call,
        path,
        scenario,
        *("--rename", "contact.force_uper=contact.force_upper", "--unit", "yoke.force=N"),
        *("--skip", "../../etc/passwd"),
    )
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "bad.mcap") as log:
        assert list(log.channels("measured")) == ["contact.force_upper", "yoke.force", "drive.force"]


def test_two_columns_cannot_be_one_channel(call: Call, scenario: Path, tmp_path: Path) -> None:
    path = csv_file(tmp_path / "two.csv", ("yoke.force", "N", np.ones(5)), ("yoke_force", "N", np.ones(5)))
    answer = bring(call, path, scenario)
    assert answer.code == 2
    assert 'measured/yoke.force = "yoke.force, yoke_force": one channel, not 2' in answer.err


def test_a_universal_file_of_another_program_needs_a_rate_in_full(
    call: Call, tmp_path: Path, scenario: Path
) -> None:
    path = pyuff_file(tmp_path / "theirs.uff", dataset(binary=1))
    answer = bring(call, path, scenario)
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "theirs.mcap") as log:
        assert log.series("measured", "base.acceleration").sample_rate == 51_200.0
    other = tmp_path / "other.toml"
    other.write_text(RUN.replace("51.2 kHz", "25.6 kHz"), encoding="utf-8")
    long = pyuff_file(
        tmp_path / "long.uff", dataset(binary=1, x=np.arange(250_000) / 51_200, data=np.ones(250_000))
    )
    answer = bring(call, long, other)
    assert answer.code == 2
    assert "base.acceleration.sample_rate = (missing): between 51199.7" in answer.err
    assert "tell it with --sample-rate" in answer.err
    assert "as the file says" in bring(call, long, other, "--sample-rate", "48 kHz").err
    answer = bring(call, long, other, "--sample-rate", "51.2 kHz")
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "long.mcap") as log:
        assert log.series("measured", "base.acceleration").sample_rate == 51_200.0


def test_a_tdms_file_keeps_its_own_rate_and_start(call: Call, scenario: Path, tmp_path: Path) -> None:
    times = {
        "wf_start_time": np.datetime64(START_NS // 1000, "us"),
        "wf_increment": 1 / 48_000,
        "unit_string": "N",
    }
    with TdmsWriter(str(tmp_path / "a.tdms")) as tdms:
        tdms.write_segment([ChannelObject("Log", "yoke.force", np.ones(50, np.float32), times)])
    answer = bring(call, tmp_path / "a.tdms", scenario)
    assert answer.code == 0, answer.err
    assert "!" not in answer.out
    with LogReader(tmp_path / "a.mcap") as log:
        series = log.series("measured", "yoke.force")
    assert (series.sample_rate, series.time_ns) == (48_000.0, START_NS)
    assert series.values.dtype == np.float32


def test_channels_of_unequal_length_are_refused(call: Call, scenario: Path, tmp_path: Path) -> None:
    with TdmsWriter(str(tmp_path / "a.tdms")) as tdms:
        tdms.write_segment(
            [
                ChannelObject("Log", name, np.ones(count))
                for name, count in (("yoke.force", 50), ("drive.force", 49))
            ]
        )
    answer = bring(call, tmp_path / "a.tdms", scenario)
    assert answer.code == 2
    assert 'samples = "yoke.force 50, drive.force 49": as many samples of each channel' in answer.err


def test_what_is_no_number_is_flagged_where_it_is(call: Call, scenario: Path, tmp_path: Path) -> None:
    values = np.ones(12_000)
    values[6000] = np.nan
    path = csv_file(tmp_path / "nan.csv", ("yoke.force", "N", values))
    assert bring(call, path, scenario).code == 0
    with LogReader(tmp_path / "nan.mcap") as log:
        flags = [block.flags for _, block in log.blocks()]
    assert flags == [Flag.GOOD, Flag.NOT_FINITE, Flag.GOOD]


def test_an_array_with_a_rate_is_a_run(call: Call, scenario: Path, tmp_path: Path) -> None:
    values = np.linspace(0, 1, 100, dtype=np.float32)
    np.savez(tmp_path / "a.npz", force=values, sample_rate=1000.0)
    answer = bring(call, tmp_path / "a.npz", scenario, "--rename", "force=yoke.force", "--unit", "force=N")
    assert answer.code == 0, answer.err
    with LogReader(tmp_path / "a.mcap") as log:
        series = log.series("measured", "yoke.force")
    assert series.sample_rate == 1000.0
    assert series.values.tobytes() == values.tobytes()


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["export", "run.mcap", "--to", "xlsx"], 2, "--to xlsx: one of uff, tdms, mat, csv, parquet"),
        (["export", "run.mcap", "--to", "numpy"], 2, "--to numpy: one of uff"),
        (["export", "gone.mcap", "--to", "csv"], 1, "gone.mcap: No such file"),
        (
            ["export", "run.mcap", "--to", "csv", "--channels", "contact.force_uper,yoke"],
            2,
            '"contact.force_uper": unknown channel of this log; did you mean contact.force_upper?',
        ),
        (["export", "run.mcap", "--to", "csv", "--origin", "nominal"], 2, "known here: measured, predicted"),
        (["export", "run.mcap", "--to", "csv", "--from", "7"], 1, "no sample in it between 7 s and the end"),
        (["export", "run.mcap", "--to", "tdms", "--from", "7", "--to-time", "8"], 1, "between 7 s and 8 s"),
        (["export", "run.mcap", "--to", "csv", "--from", "soon"], 2, "--from soon: a time such as"),
        (["export", "run.mcap", "--to", "csv", "--to-time", "1 N"], 2, "--to-time 1 N: a time such as"),
        (["export", "run.mcap", "--to", "csv", "--from", "-1"], 2, "--from -1: not before the start"),
        (["export", "run.mcap", "--to", "mat", "-o", "run.mcap"], 1, "exists already"),
        (["export", "run.mcap", "--to", "mat", "-o", "no/a.mat"], 1, "cannot write to"),
        (["import", "a.xlsx", "--scenario", "s.toml"], 1, "cannot be told from its ending"),
        (["import", "gone.csv", "--scenario", "s.toml"], 1, "gone.csv: No such file"),
        (["import", "a.csv", "--scenario", "gone.toml"], 2, "gone.toml"),
        (["import", "a.csv"], 2, "--scenario = (missing): the file carries none"),
        (["import", "a.csv", "--scenario", "s.toml", "--rename", "x"], 2, "--rename x: two texts with ="),
        (["import", "a.csv", "--scenario", "s.toml", "--sample-rate", "fast"], 2, "--sample-rate fast"),
        (
            ["import", "a.csv", "--scenario", "s.toml", "--started", "noon"],
            2,
            "--started noon: a time such as",
        ),
        (["import", "a.csv", "--scenario", "s.toml", "-o", "run.mcap"], 1, "exists already"),
        (
            ["import", "a.csv", "--scenario", "s.toml", "--skip", "yoke.force"],
            2,
            "at least one row of samples",
        ),
        (["import", "a.csv", "b.csv", "--scenario", "s.toml"], 2, "one channel, not 2"),
    ],
)
def test_what_is_refused_leaves_nothing_behind(
    call: Call,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.toml").write_text(RUN, encoding="utf-8")
    for name in ("a.csv", "b.csv"):
        csv_file(Path(name), ("yoke.force", "N", np.ones(5)))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    answer = call(*arguments)
    assert answer.code == code, answer.err
    assert answer.err.startswith("rattle: ")
    assert words in answer.err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.skipif(not SAMPLES.is_dir(), reason="no recordings of other programs beside here")
def test_a_recording_of_another_program_comes_back(call: Call, tmp_path: Path) -> None:
    """The crank's angle is `wide`; its impacts, of which the recording says none, are those of our rule."""
    run = SAMPLES / "crank_healthy.mcap"
    assert call("export", run, "--to", "tdms", "-o", tmp_path / "a.tdms").code == 0
    answer = call("import", tmp_path / "a.tdms")
    assert answer.code == 0, answer.err
    with LogReader(run) as log, LogReader(tmp_path / "a.mcap") as back:
        assert back.topic_metadata() == {**log.topic_metadata(), "/impact": {}}
        for channel, whole in log.table("measured").items():
            found = back.series("measured", channel)
            assert found.values.tobytes() == whole.values.tobytes()
            assert (found.time_ns, found.sample_rate) == (whole.time_ns, whole.sample_rate)
        assert back.scenario == log.scenario


@pytest.mark.parametrize("name", list(SUFFIX))
def test_an_encoder_and_what_was_derived_come_back(call: Call, tmp_path: Path, name: str) -> None:
    """Channels that no rig has of its own: one on a clock of its own, one with a value each cycle."""
    encoder = Channel("encoder.angle", "rad", "angle", "encoder", "CiA 406", scale=1.5e-3, raw_unit="count")
    peak = Channel("contact.force_upper.cycle_peak", "N", "force")
    rng, run = np.random.default_rng(2), tmp_path / "run.mcap"
    with LogWriter(run) as log:
        log.add_metadata("scenario", {"toml": RUN})
        for origin, channel, rate, off_ns in (
            ("measured", FORCE, 51_200.0, 0),
            ("measured", encoder, 1000.0, 20_000),
            ("derived", peak, 20.0, 1_000_000),
        ):
            log.declare(origin, channel)
            for number in range(5):
                at_ns = sample_time_ns(START_NS, number * 100, rate) + number * off_ns
                values = rng.normal(size=100).astype(np.float64 if channel is encoder else np.float32)
                log.add_block(origin, SampleBlock(channel.name, number * 100, at_ns, rate, values), at_ns)
    exported = call("export", run, "--to", name, "--all-rates")
    assert exported.code == 0, exported.err
    assert "off the start and rate" not in exported.out  # by less than half a sample
    assert exported.out.count("too long for the ID lines") <= 1
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(RUN, encoding="utf-8")
    files = sorted(tmp_path.glob(f"run*{SUFFIX[name]}"))
    answer = call("import", *files, "--scenario", scenario, "-o", tmp_path / "back.mcap")
    assert answer.code == 0, answer.err
    with LogReader(run) as log, LogReader(tmp_path / "back.mcap") as back:
        for origin in ("measured", "derived"):
            assert set(back.channels(origin)) == set(log.channels(origin))
            for channel, whole in log.table(origin).items():
                assert back.series(origin, channel).values.tobytes() == whole.values.tobytes()
                assert back.channels(origin)[channel].unit == log.channels(origin)[channel].unit
