"""Files that unpack to far more than they are, or that ask for far more work: refused, with little memory."""

from __future__ import annotations

import io
import struct
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from daq.block import SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.errors import LogError
from daq.formats import FORMATS
from daq.formats.dataset_58 import TIME_RESPONSE, Function, end, header
from daq.formats.recording import Recording, TimeBase, read_log
from daq.formats.samples import Scratch
from daq.formats.tables import KINDS, other_rates, tables_of
from daq.log.reader import LogReader
from daq.log.writer import LogWriter
from tests.daq.formats.files import read
from tests.daq.log.logs import START_NS
from tests.hostile import bounded, slowness

ODD = "more would come of it than of any honest recording"
RATE = 1000.0
BOMB = 1 << 27
"""Bytes that a file of a thousandth of it unpacks to."""


def npy(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def npz_of_zeros(path: Path) -> None:
    np.savez_compressed(path, x=np.zeros(BOMB, np.uint8), fs=51_200.0)


def compressed_mat(path: Path, variable: object) -> None:
    scipy.io.savemat(path, {"x": variable}, do_compression=True)


def mat_of_zeros(path: Path) -> None:
    compressed_mat(path, np.zeros(BOMB // 8))


def mat_of_a_struct(path: Path) -> None:
    bomb = {"values": np.zeros(BOMB // 8), "name": "a", "origin": "measured"}
    scipy.io.savemat(path, {"x": bomb, "rattle": {"description": "", "version": "1"}}, do_compression=True)


def mat_that_says_it_is_small(path: Path) -> None:
    """Its header has one number, and its data 256 MB."""
    compressed_mat(path, np.zeros(BOMB // 8))
    whole = path.read_bytes()
    (length,) = struct.unpack_from("<I", whole, 132)
    data = zlib.decompress(whole[136 : 136 + length])
    dimensions = struct.pack("<iiii", 5, 8, 1, BOMB // 8), struct.pack("<iiii", 5, 8, 1, 1)
    small = zlib.compress(data.replace(dimensions[0], dimensions[1], 1))
    path.write_bytes(whole[:128] + struct.pack("<II", 15, len(small)) + small)


def parquet_of_zeros(path: Path) -> None:
    pq.write_table(pa.table({"x": np.zeros(BOMB // 2)}), path, row_group_size=1 << 27)


def parquet_in_one_page(path: Path) -> None:
    table = pa.table({"x": np.zeros(BOMB // 2)})
    one = {"data_page_size": 1 << 30, "row_group_size": BOMB // 2, "max_rows_per_page": BOMB // 2}
    pq.write_table(table, path, compression="zstd", use_dictionary=False, **one)


def parquet_whose_footer_lies(path: Path) -> None:
    """It says that its page unpacks to one byte; the page itself is as large."""
    parquet_in_one_page(path)
    size = pq.read_metadata(path).row_group(0).total_byte_size
    path.write_bytes(path.read_bytes().replace(varint(2 * size), varint(2, len(varint(2 * size)))))
    assert pq.read_metadata(path).row_group(0).total_byte_size == 1


def varint(number: int, length: int = 0) -> bytes:
    """As thrift writes it, in at least so many bytes."""
    if number < 128 and length <= 1:
        return bytes([number])
    return bytes([number & 127 | 128]) + varint(number >> 7, length - 1)


def parquet_whose_columns_share_a_header(path: Path) -> None:
    """One long list in it, to which all of them point."""
    structs = 1 << 18
    header = b"\x19\xfc" + varint(structs) + bytes(structs) + b"\x00"

    def number(value: int) -> bytes:
        return varint(2 * value)

    # in a ColumnChunk's field 3 a ColumnMetaData: all bytes of it (7), and where its pages are (9)
    column = b"\x3c" + b"\x76" + number(len(header)) + b"\x26" + number(4) + b"\x00" + b"\x00"
    columns = 20_000
    row_group = b"\x19\xfc" + varint(columns) + column * columns + b"\x00"
    footer = b"\x49\x1c" + row_group + b"\x00"
    path.write_bytes(b"PAR1" + header + footer + struct.pack("<I", len(footer)) + b"PAR1")


def tdms_of_empty_segments(path: Path) -> None:
    """After a segment of many objects, others that add none: each has all of them."""
    count = 2000
    names = (f"/'g'/'{number}'".encode() for number in range(count))
    objects = b"".join(
        struct.pack("<I", len(name)) + name + struct.pack("<II", 0xFFFFFFFF, 0) for name in names
    )
    metadata, new_list = 1 << 1, 1 << 2

    def segment(mask: int, content: bytes) -> bytes:
        return struct.pack("<4sIIQQ", b"TDSm", mask, 4713, len(content), len(content)) + content

    first = segment(metadata | new_list, struct.pack("<I", count) + objects)
    path.write_bytes(first + segment(metadata, struct.pack("<I", 0)) * 2000)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        ("tdms", tdms_of_empty_segments),
        ("npz", npz_of_zeros),
        ("mat", mat_of_zeros),
        ("mat", mat_of_a_struct),
        ("mat", mat_that_says_it_is_small),
        ("parquet", parquet_of_zeros),
        ("parquet", parquet_in_one_page),
        ("parquet", parquet_whose_footer_lies),
        ("parquet", parquet_whose_columns_share_a_header),
    ],
)
def test_a_bomb_is_refused_before_it_is_unpacked(
    suffix: str, write: object, tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / f"bomb.{suffix}"
    assert callable(write)
    write(path)
    before = pa.total_allocated_bytes()
    with bounded(), pytest.raises(LogError, match=rf"^{path}: {ODD}"):
        read(path, scratch)
    assert pa.total_allocated_bytes() <= before  # less where something older went meanwhile
    begun = time.process_time()  # not within `bounded`, which takes ten times as long to count
    with pytest.raises(LogError, match=ODD):
        read(path, scratch)
    assert time.process_time() - begun < 5.0 * slowness()


def claims() -> bytes:
    """The head of a .npy file of 8 TB."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (1_000_000_000_000,)}
    )
    return head.getvalue()


def npy_that_claims_more(path: Path) -> None:
    path.write_bytes(claims() + bytes(800))


def npz_that_claims_more(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("x.npy", claims() + bytes(800))


def uff_that_claims_more(path: Path) -> None:
    function = Function(("x",), TIME_RESPONSE, 1, 999_999_999, 0.0, 1e-3, 12, "acceleration", "m/s2")
    path.write_bytes(header(function, np.dtype(np.float32)) + bytes(800) + end())


def uff_of_empty_datasets(path: Path) -> None:
    function = Function(("x",), TIME_RESPONSE, 1, 0, 0.0, 1e-3, 12, "acceleration", "m/s2")
    path.write_bytes((header(function, np.dtype(np.float32)) + end()) * 4_000)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [("npy", npy_that_claims_more), ("npz", npz_that_claims_more), ("uff", uff_that_claims_more)],
)
def test_what_claims_more_than_it_holds_is_refused(
    suffix: str, write: Callable[[Path], None], tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / f"claims.{suffix}"
    write(path)
    with bounded(), pytest.raises(LogError, match=rf"^{path}: "):
        read(path, scratch)


def test_a_text_by_the_name_of_arrays_is_refused_without_advice_to_trust_it(
    tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / "text.npz"
    path.write_text("hello")
    with pytest.raises(LogError, match="neither an array of NumPy nor a"):
        read(path, scratch)


def test_universal_files_of_many_datasets_take_no_more_than_their_size(
    tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / "many.uff"
    uff_of_empty_datasets(path)
    with bounded():
        read(path, scratch)
    begun = time.process_time()
    read(path, scratch)
    assert time.process_time() - begun < slowness() * path.stat().st_size / (1 << 20)


@pytest.mark.parametrize("columns", [3000, 100_000])
def test_a_table_of_many_columns_takes_time_as_its_size_has_it(
    columns: int, tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / "wide.csv"
    names, row = ",".join(f"c{number}" for number in range(columns)), ",".join("1" * columns)
    path.write_text(f"{names}\n" + f"{row}\n" * 3)
    begun = time.process_time()
    if columns > 4096:
        with pytest.raises(LogError, match="4096"):
            read(path, scratch)
    else:
        assert len(read(path, scratch).columns) == columns
    assert time.process_time() - begun < 5.0 * slowness()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("(" * 100_000 + "\n1\n", "a cell of 100000 characters"),
        ("a,b\n" + "1" * 100_000 + ",2\n", "a cell of 100000 characters"),
        ("a,a\n1,2\n", "come twice: a"),
    ],
)
def test_a_table_with_odd_cells_is_refused_at_once(
    text: str, words: str, tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / "odd.csv"
    path.write_text(text)
    begun = time.process_time()
    with pytest.raises(LogError, match=words):
        read(path, scratch)
    assert time.process_time() - begun < 5.0 * slowness()


def test_a_description_without_end_is_refused(tmp_path: Path, scratch: Scratch) -> None:
    path = tmp_path / "run.csv"
    path.write_text("a,rattle\n" + f"1,{'x' * 1000}\n" * 70_000)
    with bounded(256 << 20), pytest.raises(LogError, match=r"run\.csv: its description has no end"):
        read(path, scratch)


def test_impacts_of_empty_lines_are_refused_at_the_first(tmp_path: Path, scratch: Scratch) -> None:
    path = tmp_path / "run.impacts.csv"
    description = '{"rattle":1,"tracks":[],"metadata":{},"events":[],"gaps":null,"clocks":[]}'
    path.write_text(f"# rattle impacts {description}\n{','.join(KINDS)}\n" + "\n" * 5_000_000)
    with bounded(64 << 20), pytest.raises(LogError, match="cut short"):
        read(path, scratch)


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        ("," * (1 << 25), "4096"),
        ("," * 12 + "\n" + ("," * 12 + "\n") * (1 << 21), "has no column"),
        (f",{','.join([*KINDS][3:])}\n" + ("," * (len(KINDS) - 1) + "\n") * (1 << 21), "damaged"),
    ],
)
def test_what_begins_as_a_table_of_impacts_takes_no_more_than_another(
    rest: str, words: str, tmp_path: Path, scratch: Scratch
) -> None:
    path = tmp_path / "run.impacts.csv"
    path.write_text(",".join([*KINDS][:3]) + rest)
    with bounded(), pytest.raises(LogError, match=words):
        read(path, scratch)


def test_an_opaque_variable_of_mat_is_named_and_left_out(tmp_path: Path, scratch: Scratch) -> None:
    """As MATLAB writes a table, a date or a string: no shape stands before its name."""
    words = [b"when", b"MCOS", b"datetime"]
    names = b"".join(
        struct.pack("<II", 1, len(word)) + word.ljust(-len(word) % 8 + len(word)) for word in words
    )
    content = struct.pack("<IIII", 6, 8, 17, 0) + names
    scipy.io.savemat(path := tmp_path / "x.mat", {"force": np.arange(6.0), "fs": RATE})
    with path.open("ab") as file:
        file.write(struct.pack("<II", 14, len(content)) + content)
    contents = read(path, scratch)
    assert [column.name for column in contents.columns] == ["force"]
    assert "left out: when, a MATLAB object" in contents.notes


@pytest.mark.parametrize("compressed", [False, True])
def test_a_variable_of_mat_whose_kind_is_no_variable_s_is_not_passed_over(
    tmp_path: Path, scratch: Scratch, compressed: bool
) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"fs": RATE, "force": np.arange(6.0)}, do_compression=compressed)
    content = bytearray(path.read_bytes())
    (length,) = struct.unpack_from("<I", content, 132)
    content[136 + length] ^= 64
    path.write_bytes(content)
    with pytest.raises(LogError, match="where a variable should begin"):
        read(path, scratch)


@pytest.mark.parametrize("cut", [1, 4, 40])
def test_a_compressed_variable_of_mat_that_is_cut_is_refused(
    tmp_path: Path, scratch: Scratch, cut: int
) -> None:
    """Also where only its checksum lacks."""
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"force": np.random.default_rng(3).normal(size=4000)}, do_compression=True)
    content = path.read_bytes()
    path.write_bytes(content[:132] + struct.pack("<I", len(content) - 136 - cut) + content[136:-cut])
    with pytest.raises(LogError, match="cut short"):
        read(path, scratch)


@pytest.mark.parametrize("number", [300, 2000])
def test_many_short_variables_of_mat_are_read(number: int, tmp_path: Path, scratch: Scratch) -> None:
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {f"v{each}": np.full(100, float(each)) for each in range(number)})
    begun = time.process_time()
    columns = read(path, scratch).columns
    assert [float(each.samples.read(99, 100)[0]) for each in columns] == list(range(number))
    assert time.process_time() - begun < 10.0 * slowness()


def test_damaged_lzma_is_a_log_error(tmp_path: Path, scratch: Scratch) -> None:
    path = tmp_path / "x.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as file:
        file.writestr("x.npy", npy(np.random.default_rng(1).normal(size=1000)))
    data = bytearray(path.read_bytes())
    data[60:64] = b"\xff" * 4
    path.write_bytes(data)
    with pytest.raises(LogError, match=r"x\.npz"):
        read(path, scratch)


def test_numbers_in_scratch_are_those_that_were_kept(scratch: Scratch) -> None:
    """In pieces, of any step and byte order."""
    values = np.arange(1_000_000, dtype=">f8")
    assert np.array_equal(scratch.keep(values[::2]).read(0, 500_000), values[::2])
    assert np.array_equal(scratch.keep(values).read(999_990, 1_000_000), values[-10:])


def test_short_columns_wait_no_longer_the_more_there_are(scratch: Scratch) -> None:
    columns = [scratch.column() for _ in range(4000)]
    with bounded(200 << 20):
        for _ in range(10):
            for column in columns:
                column.add(np.ones(1000))
    assert all(len(column) == 10_000 for column in columns)
    assert np.array_equal(columns[7].samples().read(9990, 10_000), np.ones(10))


def apart(path: Path, samples: int, second: int, scratch: Scratch) -> Recording:
    """Two channels on one time base, of which the second begins at sample `second`."""
    with LogWriter(path) as writer:
        for name, first in (("a", 0), ("b", second)):
            writer.declare("measured", Channel(name, "N"))
            time_ns = sample_time_ns(START_NS, first, RATE)
            each = SampleBlock(name, first, time_ns, RATE, np.ones(samples, np.float32))
            writer.add_block("measured", each, time_ns)
    with LogReader(path) as log:
        return read_log(log, scratch)


@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_channels_months_apart_make_no_table(name: str, tmp_path: Path, scratch: Scratch) -> None:
    """Ten samples each: it would have 10^10 rows."""
    recording, write = apart(tmp_path / "log.mcap", 10, 10**10, scratch), FORMATS[name].write
    assert write is not None
    with pytest.raises(LogError, match="20 samples in 10000000010 rows"):
        write(recording, tmp_path / f"run.{name}", lambda _: None)
    assert not list(tmp_path.glob("run*"))
    assert other_rates(recording) == []  # which is no table yet


def test_channels_of_a_second_that_begin_minutes_apart_make_one(tmp_path: Path, scratch: Scratch) -> None:
    (table,) = tables_of(apart(tmp_path / "log.mcap", 1000, 600_000, scratch), lambda _: None)
    assert (table.first, table.end) == (0, 601_000)


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e-310, 1e300, float("nan")])
def test_what_is_no_rate_is_no_time_base(rate: float) -> None:
    with pytest.raises(LogError, match="a sample rate of"):
        TimeBase(0, 0, rate)
