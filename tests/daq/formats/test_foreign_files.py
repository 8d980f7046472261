"""Files of other programs: pyuff, a TDMS writer like LabVIEW's, MATLAB's vectors, NumPy."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
import pyuff
import scipy.io
from nptdms import ChannelObject, TdmsFile, TdmsWriter

from daq.block import NS_PER_S
from daq.errors import LogError
from daq.formats import FORMATS
from daq.formats.contents import StatedRate
from daq.formats.samples import Scratch
from tests.daq.formats import runs
from tests.daq.formats.files import COUNT, RATE, SINE, export, only, read

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


def test_a_cut_tdms_file_and_a_channel_of_text_are_told(
    tmp_path: Path, scratch: Scratch, caplog: pytest.LogCaptureFixture
) -> None:
    path = labview_file(tmp_path / "a.tdms")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LogError, match=r"a\.tdms: its last segment is cut short"):
        read(path, scratch)
    assert not caplog.records
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


@pytest.mark.parametrize("kind", ["f8", "f4", "i1", "u2", "i8", "?"])
def test_numbers_of_matlab_keep_their_values(kind: str, tmp_path: Path, scratch: Scratch) -> None:
    """Savers keep whole numbers in fewer bytes than their class has; all but the last are near its ends."""
    values = np.array([0, 1, 1, 100, 7]).astype(kind)
    scipy.io.savemat(tmp_path / "a.mat", {"x": values, "c": np.ones(5) * 1j, "t": np.array(["ab", "cd"])})
    contents = read(tmp_path / "a.mat", scratch)
    assert runs.everything(contents.columns[0].samples).tolist() == values.astype(float).tolist()
    assert contents.notes == [
        "left out: c, a complex array of 1 x 5",
        "left out: t, which holds no real numbers",
    ]


def test_vectors_of_matlab_4_are_channels(tmp_path: Path, scratch: Scratch) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"x": SINE, "fs": RATE, "note": "first"}, format="4")
    contents = read(tmp_path / "a.mat", scratch)
    assert np.array_equal(runs.everything(contents.columns[0].samples), SINE)
    assert contents.columns[0].rate == StatedRate.exactly(RATE)


def test_a_file_of_a_big_endian_machine(tmp_path: Path, scratch: Scratch) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"xyzxyzxy": np.arange(5.0) + 0.5})
    little = (tmp_path / "a.mat").read_bytes()
    words = [np.frombuffer(little[at:end], "<u4").astype(">u4") for at, end in ((128, 176), (184, 192))]
    values = np.frombuffer(little[192:], "<f8").astype(">f8")
    parts = little[:124], b"\1\0MI", words[0].tobytes(), little[176:184], words[1].tobytes(), values.tobytes()
    (tmp_path / "a.mat").write_bytes(b"".join(parts))
    assert runs.everything(only(tmp_path / "a.mat", scratch).samples).tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]


@pytest.mark.parametrize("kind", [0, 8, 11, 19, 12_297, 0xFFFF])
def test_an_element_of_no_kind_is_told(kind: int, tmp_path: Path, scratch: Scratch) -> None:
    """Another reader took such a number for a place in memory."""
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.arange(5.0) + 0.5})
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(data.replace(struct.pack("<II", 9, 40), struct.pack("<II", kind, 40)))
    with pytest.raises(LogError, match=rf"a\.mat: an element of kind {kind}"):
        read(tmp_path / "a.mat", scratch)


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


# --- all


def test_a_missing_file_is_named(tmp_path: Path, scratch: Scratch) -> None:
    for each in FORMATS.values():
        path = tmp_path / f"gone{each.suffixes[0]}"
        with (
            warnings.catch_warnings(),
            pytest.raises(LogError, match=f"{path.name}: .*(No such file|cannot be read)"),
        ):
            each.read(path, scratch)
