"""Tables of other programs: CSV by hand, of spreadsheets and of rattle; Parquet."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from daq.block import SampleBlock
from daq.errors import LogError
from daq.formats.recording import read_log, within
from daq.formats.samples import Scratch
from daq.log.reader import LogReader
from daq.log.writer import LogWriter
from tests.daq.formats import runs
from tests.daq.formats.files import COUNT, SINE, export, only, read

PLAIN = "time,contact.force_upper,base.acceleration\ns,N,m/s2\n0,1.5,0.1\n0.001,2.5,nan\n0.002,-3e-3,1e3\n"


def written(text: str, path: Path, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def test_a_csv_made_by_hand(tmp_path: Path, scratch: Scratch) -> None:
    force, base = read(written(PLAIN, tmp_path / "a.csv"), scratch).columns
    assert (force.name, force.unit, base.unit) == ("contact.force_upper", "N", "m/s2")
    assert runs.everything(force.samples).tolist() == [1.5, 2.5, -0.003]
    assert np.array_equal(runs.everything(base.samples), [0.1, np.nan, 1e3], equal_nan=True)
    assert force.rate is not None
    assert force.rate.allows(1000.0)


@pytest.mark.parametrize(
    "text",
    [
        "\ufefftime;force\ns;kN\n0;1,5\n0,001;2,5\n",
        "t\tforce\r\ns\tkN\r\n0\t1.5\r\n0.001\t2.5\r\n",
        "time [ms],force (kN)\n0,1.5\n1,2.5\n\n",
        '# made by hand\n"time","force"\n"s","kN"\n"0","1.5"\n"0.001","2.5"\n',
    ],
    ids=["German Excel", "tabs", "units behind names", "comment and quotes"],
)
def test_csv_of_several_programs(tmp_path: Path, scratch: Scratch, text: str) -> None:
    column = only(written(text, tmp_path / "a.csv"), scratch)
    assert (column.name, column.unit) == ("force", "kN")
    assert runs.everything(column.samples).tolist() == [1.5, 2.5]
    assert column.rate is not None
    assert column.rate.likeliest == pytest.approx(1000.0, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no line of names"),
        ("# a comment\n", "no line of names"),
        ("1,2\n3,4\n", "no line of names above the numbers"),
        ("time,force\n", "no row of numbers"),
        ("time,force\ns,N\n", "no row of numbers"),
        ("time,force\ns,N,N\n0,1\n", "2 names and 3 units"),
        ("time,,force\n0,1,2\n", "column 2 has no name"),
        ("force,force\n0,1\n", "come twice: force"),
        ("time,force\n0,1\n1,2\n2\n", "cannot be read .*[Ee]xpected 2 columns"),
        ("time,force\n0,1\n1,\n2,3\n", "column force has an empty cell in row 2"),
        ("time,force\n0,1\n1,two\n2,3\n", "cannot be read .*two"),
        ("time,force\n0,1\n1,two\n2,3\n", "row 2 of its numbers, column force: 'two' is no number"),
        ("time,force\n0,1\n1,2\n2\n", "row 3 of its numbers: expected 2 columns, got 1"),
        ("time,force\n0,1\n1,1\n3,1\n4,1\n", "time column is not even: row 2"),
        ("time,force\n0,1\nnan,1\n2,1\n", "time column is not even: row 2"),
        ("time,force\nnan,1\n1,1\n", "begins or ends with what is no number"),
        ("time,force\nh,N\n0,1\n1,1\n", "time column is in 'h', not one of"),
        ("# rattle {}\ntime,force\n0,1\n1,1\n", "description is damaged"),
        ('# rattle {"rattle":2}\ntime,force\n0,1\n1,1\n', "version 2, not 1"),
    ],
)
def test_a_table_that_makes_no_sense_is_refused(
    tmp_path: Path, scratch: Scratch, text: str, words: str
) -> None:
    with pytest.raises(LogError, match=f"a.csv: .*{words}") as raised:
        read(written(text, tmp_path / "a.csv"), scratch)
    assert "Arrow" not in str(raised.value)


def test_a_text_in_another_encoding_is_refused_with_what_to_do(tmp_path: Path, scratch: Scratch) -> None:
    path = written("time,force\ns,µN\n0,1\n", tmp_path / "a.csv", "latin-1")
    with pytest.raises(LogError, match=r"no text in UTF-8 \(byte 13\); save it as such"):
        read(path, scratch)


def test_a_rounded_time_column_is_even_and_a_lost_sample_is_not(tmp_path: Path, scratch: Scratch) -> None:
    times = np.arange(200) / 1000.0 + 0.00001 * np.sin(np.arange(200))
    column = only(table(tmp_path / "a.csv", times), scratch)
    assert column.rate is not None
    assert column.rate.allows(1000.0)
    with pytest.raises(LogError, match=r"not even: row \d+ is -?0.1 intervals off"):
        read(table(tmp_path / "b.csv", np.delete(np.arange(1001), 500)[:900] / 1000.0), scratch)


def table(path: Path, times: np.ndarray) -> Path:
    rows = "".join(f"{time:.6f},{index}\n" for index, time in enumerate(times))
    return written(f"time,force\ns,N\n{rows}", path)


def test_a_csv_of_rattle_is_plain_text_with_units(tmp_path: Path, scratch: Scratch) -> None:
    export(runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch), tmp_path / "run.csv")
    lines = (tmp_path / "run.1000Hz.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "time [s],measured/base.acceleration [m/s2],rattle"
    assert len(lines) == 1 + 1000
    times, values = np.loadtxt(lines[1:], delimiter=",", usecols=(0, 1), unpack=True)
    assert np.array_equal(times, np.arange(1000) / 1000.0)
    base = runs.recorded(tmp_path / "run.mcap", scratch).tracks[1]
    assert np.array_equal(values.astype(np.float32), runs.everything(base.samples))
    gap = (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()[1 + 20_480]
    assert gap.split(",")[:2] == ["0.4", ""]


def test_the_documented_line_of_pandas_reads_numbers(tmp_path: Path, scratch: Scratch) -> None:
    recording = runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch)
    export(recording, tmp_path / "run.csv")
    found = pd.read_csv(tmp_path / "run.csv")
    assert [str(kind) for kind in found.dtypes] == [*["float64"] * (found.shape[1] - 1), "str"]
    assert found.columns[0] == "time [s]"
    force = recording.tracks[0]
    values = found[f"{force.name} [N]"].to_numpy(np.float32)
    assert np.array_equal(values, runs.everything(force.samples), equal_nan=True)
    impacts = pd.read_csv(tmp_path / "run.impacts.csv")
    assert impacts["peak"].tolist() == [each.peak for each in runs.IMPACTS]


@pytest.mark.parametrize(
    ("delimiter", "point"), [(",", "."), (";", ","), ("\t", ".")], ids=["plain", "German Excel", "tabs"]
)
def test_a_table_that_a_spreadsheet_saved_again_comes_back_whole(
    tmp_path: Path, scratch: Scratch, delimiter: str, point: str
) -> None:
    """Cells in quotes that need none, and the description in pieces that a cell of Excel holds."""
    recording = runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch)
    odd = dataclasses.replace(recording.tracks[1].channel, name='a [b], "c"', unit="m]")
    long = dataclasses.replace(recording.events[0], text='long, "quoted"\n' * 10_000)
    track = dataclasses.replace(recording.tracks[1], channel=odd)
    export(dataclasses.replace(recording, tracks=(track,), events=[long], impacts=()), tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert 3 < sum(row[-1] != "" for row in rows[1:]) < 9
    assert max(len(row[-1]) for row in rows) <= 32_767
    with (tmp_path / "again.csv").open("w", newline="", encoding="utf-8-sig") as file:
        again = csv.writer(file, delimiter=delimiter)
        again.writerow(rows[0])
        again.writerows([*(cell.replace(".", point) for cell in row[:-1]), row[-1]] for row in rows[1:])
    contents = read(tmp_path / "again.csv", scratch)
    (column,) = contents.columns
    assert (column.name, column.unit, column.stretches) == (odd.name, odd.unit, track.stretches)
    assert runs.everything(column.samples).tobytes() == runs.everything(track.samples).tobytes()
    assert contents.rest.events == [long]


def test_a_table_shorter_than_its_description_comes_back(tmp_path: Path, scratch: Scratch) -> None:
    recording = runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch)
    one = within(dataclasses.replace(recording, tracks=recording.tracks[1:2]), 0.0, 0.001)
    events = [dataclasses.replace(recording.events[0], text="x" * 3_000_000)]
    export(dataclasses.replace(one, events=events, impacts=()), tmp_path / "run.csv")
    contents = read(tmp_path / "run.csv", scratch)
    assert [len(column.samples) for column in contents.columns] == [1]
    assert contents.rest.events == events


def test_times_of_a_table_count_from_the_start_of_recording(tmp_path: Path, scratch: Scratch) -> None:
    """Also where its channel began later, alone or cut out by that same time."""
    with LogWriter(tmp_path / "run.mcap") as log:
        for origin, channel, rate, late_ns in (
            ("measured", runs.BASE, runs.SLOW, 0),
            ("derived", runs.YOKE, 20.0, 35_000_000),
        ):
            log.declare(origin, channel)
            at_ns = runs.START_NS + late_ns
            block = SampleBlock(channel.name, 0, at_ns, rate, np.arange(10, dtype=np.float32))
            log.add_block(origin, block, at_ns)
    with LogReader(tmp_path / "run.mcap") as reader:
        alone = read_log(reader, scratch, ("derived",))
    for start_s, first in ((0.0, 0), (0.1, 2)):
        path = tmp_path / f"{first}.csv"
        export(within(alone, start_s, 0.3), path)
        found = pd.read_csv(path)
        assert found["derived/yoke.force [N]"].tolist() == list(range(first, 6))
        assert found["time [s]"].tolist() == pytest.approx(0.035 + np.arange(first, 6) / 20.0, abs=1e-12)


def test_a_csv_that_a_spreadsheet_saved_again_keeps_names_and_units(tmp_path: Path, scratch: Scratch) -> None:
    text = '"# rattle {""rattle"":1","""tracks"":[]}"\ntime,predicted/yoke.force\ns,N\n0,1\n0.001,2\n'
    column = only(written(text, tmp_path / "a.csv"), scratch)
    assert (column.origin, column.name, column.unit, column.stretches) == (
        "predicted",
        "yoke.force",
        "N",
        None,
    )


def test_a_parquet_table_of_another_program(tmp_path: Path, scratch: Scratch) -> None:
    stamps = pa.array(runs.START_NS + np.arange(COUNT) * 1_000_000, pa.timestamp("ns"))
    force = pa.field("force", pa.float64(), metadata={"unit": "kN"})
    schema = pa.schema([pa.field("time", stamps.type), force, pa.field("note", pa.string())])
    pq.write_table(pa.table([stamps, SINE, ["x"] * COUNT], schema=schema), tmp_path / "a.parquet")
    contents = read(tmp_path / "a.parquet", scratch)
    (column,) = contents.columns
    assert (column.name, column.unit, column.start_ns) == ("force", "kN", runs.START_NS)
    assert np.array_equal(runs.everything(column.samples), SINE)
    assert column.rate is not None
    assert column.rate.allows(1000.0)
    assert contents.notes == ["left out: note, which holds no numbers"]


def test_a_parquet_table_of_rattle_has_times_and_units(tmp_path: Path, scratch: Scratch) -> None:
    export(runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch), tmp_path / "run.parquet")
    found = pq.read_table(tmp_path / "run.parquet")
    assert found.schema.field("measured/contact.force_upper").metadata[b"unit"] == b"N"
    assert found["sample"].to_numpy().tolist() == list(range(51_200))
    times = found["time"].cast(pa.int64()).to_numpy() - runs.START_NS
    # 19 531.25 ns a sample, rounded
    assert np.abs(times - np.arange(51_200) * 19_531.25).max() <= 1
    assert found["measured/contact.force_upper"].null_count == 5120
