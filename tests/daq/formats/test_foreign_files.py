"""Files of other programs: pyuff, a TDMS writer like LabVIEW's, MATLAB's vectors, CSV by hand, NumPy."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import pyuff
import scipy.io
from nptdms import ChannelObject, TdmsFile, TdmsWriter

from daq.block import NS_PER_S
from daq.errors import LogError
from daq.formats import FORMATS, format_of
from daq.formats.contents import Column, Contents, StatedRate
from daq.formats.recording import Recording
from daq.formats.samples import Scratch
from tests.daq.formats import runs

RATE, COUNT = 51_200.0, 4000
SINE = np.sin(2 * np.pi * 50 * np.arange(COUNT) / RATE)


@pytest.fixture
def scratch(tmp_path: Path) -> Iterator[Scratch]:
    with Scratch(tmp_path) as opened:
        yield opened


def read(path: Path, scratch: Scratch) -> Contents:
    return format_of(path).read(path, scratch)


def only(path: Path, scratch: Scratch) -> Column:
    (column,) = read(path, scratch).columns
    return column


def written(text: str, path: Path, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


# --- universal files


def dataset(**changes: object) -> dict[str, object]:
    return {
        "type": 58,
        "func_type": 1,
        "rsp_node": 3,
        "rsp_dir": 3,
        "ref_node": 0,
        "ref_dir": 0,
        "id1": "base.acceleration",
        "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 0,
        "ordinate_axis_units_lab": "m/s^2",
        "abscissa_spacing": 1,
        "x": np.arange(COUNT) / RATE,
        "data": SINE,
    } | changes


def pyuff_file(path: Path, *sets: dict[str, object]) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # pyuff loses a file where it writes binary
        pyuff.UFF(str(path)).write_sets(list(sets), "add")
    return path


@pytest.mark.parametrize("binary", [0, 1], ids=["text", "binary"])
def test_a_universal_file_of_pyuff_has_its_samples_and_a_rate_of_six_digits(
    tmp_path: Path, scratch: Scratch, binary: int
) -> None:
    column = only(pyuff_file(tmp_path / "a.uff", dataset(binary=binary)), scratch)
    assert (column.name, column.unit, column.start_ns) == ("base.acceleration", "m/s^2", None)
    # text has twelve digits
    assert np.allclose(runs.everything(column.samples), SINE, rtol=0, atol=0 if binary else 1e-11)
    assert column.rate is not None
    assert column.rate.allows(RATE)
    assert not column.rate.allows(51_201.0)
    assert column.rate.likeliest != RATE


def test_single_precision_in_text_and_an_abscissa_of_its_own(tmp_path: Path, scratch: Scratch) -> None:
    single = dataset(ord_data_type=2)
    pyuff.UFF(str(tmp_path / "a.uff")).write_sets([single], "add", force_double=False)
    # six digits
    assert np.allclose(runs.everything(only(tmp_path / "a.uff", scratch).samples), SINE, rtol=1e-5)
    uneven = dataset(abscissa_spacing=0, x=np.arange(COUNT) * 1e-3, data=SINE)
    column = only(pyuff_file(tmp_path / "b.uff", uneven), scratch)
    assert np.allclose(runs.everything(column.samples), SINE, rtol=0, atol=1e-11)
    assert column.rate is not None
    assert column.rate.allows(1000.0)


def test_what_is_no_time_record_is_left_out_and_named(tmp_path: Path, scratch: Scratch) -> None:
    response = dataset(func_type=4, id1="H1", data=SINE * (1 + 1j), x=np.arange(COUNT) * 1.0)
    path = pyuff_file(tmp_path / "a.uff", {"type": 164, **UNITS}, response, dataset())
    contents = read(path, scratch)
    assert [column.name for column in contents.columns] == ["base.acceleration"]
    assert contents.notes == [
        "left out: a dataset 164, which is no time record",
        "left out: H1, which is no real function of time",
    ]


UNITS = {
    "units_code": 1,
    "units_description": "SI",
    "temp_mode": 1,
    "length": 1.0,
    "force": 1.0,
    "temp": 1.0,
    "temp_offset": 0.0,
}


def test_functions_of_one_name_are_told_apart_by_number(tmp_path: Path, scratch: Scratch) -> None:
    path = pyuff_file(tmp_path / "a.uff", dataset(id1="NONE"), dataset(), dataset(id1="NONE"))
    names = [column.name for column in read(path, scratch).columns]
    assert names == ["NONE 1", "base.acceleration", "NONE 2"]


def test_pyuff_reads_what_rattle_writes(tmp_path: Path, scratch: Scratch) -> None:
    recording = runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch)
    export(recording, tmp_path / "run.uff")
    sets = pyuff.UFF(str(tmp_path / "run.uff")).read_sets()
    head, force, rest, base = sets[:4]
    assert (head["type"], head["model_name"], head["db_app"]) == (151, "run-7", "rattle")
    assert (force["id1"], force["ordinate_axis_units_lab"]) == ("contact.force_upper", "N")
    assert (force["id3"], force["func_type"]) == ("21-Sep-26 14:13:20", 1)
    values = runs.everything(recording.tracks[0].samples)
    assert np.array_equal(force["data"], values[:20_480], equal_nan=True)
    assert np.array_equal(rest["data"], values[25_600:], equal_nan=True)
    assert rest["abscissa_min"] == 0.5
    assert base["abscissa_inc"] == 1e-3


def export(recording: Recording, path: Path) -> None:
    write = format_of(path).write
    assert write is not None
    write(recording, path, lambda _: None)


# --- TDMS


def labview_file(path: Path, segments: int = 4) -> Path:
    """Channels interleaved by segment, properties with the first, as a LabVIEW program streams them."""
    start = np.datetime64("2026-09-21T14:13:20.500", "us")
    times = {"wf_start_time": start, "wf_increment": 1 / RATE, "wf_start_offset": 0.0}
    step = COUNT // segments
    with TdmsWriter(str(path)) as tdms:
        for at in range(0, COUNT, step):
            raw = np.rint(SINE * 30_000).astype(np.int16)[at : at + step]
            double = ChannelObject("Log", "force", SINE[at : at + step], {**times, "unit_string": "kN"})
            counts = ChannelObject("Log", "counts", raw, times)
            tdms.write_segment([double, counts])
    return path


def test_a_tdms_file_of_labview_has_rate_start_and_unit(tmp_path: Path, scratch: Scratch) -> None:
    force, counts = read(labview_file(tmp_path / "a.tdms"), scratch).columns
    assert (force.name, force.unit, counts.unit) == ("force", "kN", None)
    assert np.array_equal(runs.everything(force.samples), SINE)
    assert counts.samples.dtype == np.float32
    assert np.array_equal(runs.everything(counts.samples), np.rint(SINE * 30_000).astype(np.int16))
    assert np.array_equal(force.samples.read(900, 1100), SINE[900:1100])
    assert force.rate is not None
    assert force.rate.allows(RATE)
    assert force.rate.is_sure_over(10**12)
    assert force.start_ns == 1_790_000_000 * NS_PER_S + 500_000_000


def test_tdms_of_rattle_is_a_waveform_for_others_to_the_nanosecond(tmp_path: Path, scratch: Scratch) -> None:
    export(runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch), tmp_path / "run.tdms")
    with TdmsFile.open(tmp_path / "run.tdms", raw_timestamps=True) as tdms:
        channel = tdms["measured"]["base.acceleration"]
        assert channel.properties["unit_string"] == "m/s2"
        assert channel.properties["wf_increment"] == 1e-3
        stamp = channel.properties["wf_start_time"]
        assert int(stamp.as_datetime64("ns").astype(np.int64)) == runs.START_NS
        assert len(channel.read_data()) == 1000


def test_a_cut_tdms_file_and_a_channel_of_text_are_told(tmp_path: Path, scratch: Scratch) -> None:
    path = labview_file(tmp_path / "a.tdms")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match=r"a\.tdms: its last segment is cut short"):
        read(path, scratch)
    with TdmsWriter(str(tmp_path / "b.tdms")) as tdms:
        tdms.write_segment([ChannelObject("a", "x", SINE), ChannelObject("b", "x", np.array(["one", "two"]))])
    contents = read(tmp_path / "b.tdms", scratch)
    assert [column.name for column in contents.columns] == ["a/x"]
    assert contents.columns[0].rate is None
    assert contents.notes == ["left out: b/x, which holds no real numbers"]


# --- MAT and NumPy


@pytest.mark.parametrize("compressed", [False, True])
def test_vectors_of_matlab_are_channels(tmp_path: Path, scratch: Scratch, compressed: bool) -> None:
    values = {"contact_force_upper": SINE[:, None], "Fs": 51_200.0, "note": "first try", "k": 3.0}
    scipy.io.savemat(tmp_path / "a.mat", values, do_compression=compressed)
    contents = read(tmp_path / "a.mat", scratch)
    (column,) = contents.columns
    assert (column.name, column.unit) == ("contact_force_upper", None)
    assert column.rate == StatedRate.exactly(RATE)
    assert np.array_equal(runs.everything(column.samples), SINE)
    assert contents.notes == ["left out: note, which is a text", "left out: k, which holds 1 number"]


def test_a_mat_file_of_rattle_is_plain_to_matlab(tmp_path: Path, scratch: Scratch) -> None:
    recording = runs.recorded(runs.write_run(tmp_path / "run.mcap"), scratch)
    export(recording, tmp_path / "run.mat")
    found = scipy.io.loadmat(tmp_path / "run.mat", simplify_cells=True)
    force = found["measured_contact_force_upper"]
    assert (force["name"], force["unit"], force["sample_rate"]) == ("contact.force_upper", "N", 51_200.0)
    assert force["start_unix_ns"] == runs.START_NS
    assert force["gaps"].tolist() == [20_480, 5120]
    assert force["scale"] == runs.FORCE.scale
    assert force["values"].dtype == np.float32
    assert found["measured_crank_angle"]["values"].dtype == np.float64


def test_version_7_3_is_refused_with_what_to_do(tmp_path: Path, scratch: Scratch) -> None:
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(LogError, match=r"version 7\.3 is not read; save it with -v7"):
        read(tmp_path / "a.mat", scratch)


def test_arrays_of_numpy_with_a_rate_or_with_times(tmp_path: Path, scratch: Scratch) -> None:
    single = SINE.astype(np.float32)
    np.savez(tmp_path / "a.npz", force=single, sample_rate=RATE, **{"force.unit": "kN"})
    column = only(tmp_path / "a.npz", scratch)
    assert (column.name, column.unit, column.rate) == ("force", "kN", StatedRate.exactly(RATE))
    assert runs.everything(column.samples).tobytes() == single.tobytes()
    np.savez_compressed(tmp_path / "b.npz", force=SINE, time=2.5 + np.arange(COUNT) / RATE)
    column = only(tmp_path / "b.npz", scratch)
    assert column.rate is not None
    assert column.rate.allows(RATE)
    assert column.start_s == 2.5


def test_a_matrix_and_a_structured_array(tmp_path: Path, scratch: Scratch) -> None:
    np.save(tmp_path / "a.npy", np.stack([SINE, -SINE], axis=1))
    contents = read(tmp_path / "a.npy", scratch)
    assert [column.name for column in contents.columns] == ["array.1", "array.2"]
    assert np.array_equal(runs.everything(contents.columns[1].samples), -SINE)
    assert contents.notes == [
        "array: 4000 x 2 numbers are 2 channels of 4000 samples, named array.1 to array.2"
    ]
    table = np.zeros(COUNT, [("time", "f8"), ("force", "f4")])
    table["time"], table["force"] = np.arange(COUNT) / RATE, SINE
    np.save(tmp_path / "b.npy", table)
    assert only(tmp_path / "b.npy", scratch).name == "force"


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (
            {"force": SINE, "time": np.arange(COUNT - 1) / RATE},
            r"not as long as its 3999 times: force \(4000\)",
        ),
        ({"force": SINE, "time": np.arange(COUNT)[::-1] / RATE}, "not forward"),
        ({"force": SINE, "sample_rate": 0.0}, "0 is no sample rate"),
        ({"force": SINE, "sample_rate": np.nan}, "nan is no sample rate"),
        ({"force": np.zeros((2, 3, 4))}, "force is 2 x 3 x 4 numbers, no row of samples"),
        ({"force": np.array([{}, {}], object)}, "cannot be read .*allow_pickle"),
    ],
)
def test_arrays_that_make_no_sense_are_refused(
    tmp_path: Path, scratch: Scratch, arrays: dict[str, np.ndarray], words: str
) -> None:
    np.savez(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(LogError, match=f"a.npz: .*{words}"):
        read(tmp_path / "a.npz", scratch)


# --- tables


PLAIN = "time,contact.force_upper,base.acceleration\ns,N,m/s2\n0,1.5,0.1\n0.001,2.5,nan\n0.002,-3e-3,1e3\n"


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
    with pytest.raises(LogError, match=f"a.csv: .*{words}"):
        read(written(text, tmp_path / "a.csv"), scratch)


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
    assert lines[0].startswith("# rattle {")
    assert lines[1:3] == ["time,measured/base.acceleration", "s,m/s2"]
    assert len(lines) == 3 + 1000
    times, values = np.loadtxt(lines[3:], delimiter=",", unpack=True)
    assert np.array_equal(times, np.arange(1000) / 1000.0)
    base = runs.recorded(tmp_path / "run.mcap", scratch).tracks[1]
    assert np.array_equal(values.astype(np.float32), runs.everything(base.samples))
    gap = (tmp_path / "run.51200Hz.csv").read_text(encoding="utf-8").splitlines()[3 + 20_480]
    assert gap.split(",")[:2] == ["0.4", ""]


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
    found = pq.read_table(tmp_path / "run.51200Hz.parquet")
    assert found.schema.field("measured/contact.force_upper").metadata[b"unit"] == b"N"
    assert found["sample"].to_numpy().tolist() == list(range(51_200))
    times = found["time"].cast(pa.int64()).to_numpy() - runs.START_NS
    # 19 531.25 ns a sample, rounded
    assert np.abs(times - np.arange(51_200) * 19_531.25).max() <= 1
    assert found["measured/contact.force_upper"].null_count == 5120


def test_a_missing_file_is_named(tmp_path: Path, scratch: Scratch) -> None:
    for each in FORMATS.values():
        path = tmp_path / f"gone{each.suffixes[0]}"
        with (
            warnings.catch_warnings(),
            pytest.raises(LogError, match=f"{path.name}: .*(No such file|cannot be read)"),
        ):
            each.read(path, scratch)
