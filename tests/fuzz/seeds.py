"""Writes the inputs that the corpora begin with: small, sound, one of each kind that a decoder knows.

Usage: python -m tests.fuzz.seeds
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from nptdms import ChannelObject, RootObject, TdmsWriter

from daq.block import NS_PER_S, Flag, SampleBlock, sample_time_ns
from daq.channel import Channel
from daq.formats import FORMATS
from daq.formats.recording import read_log
from daq.formats.samples import Scratch
from daq.log.reader import LogReader
from daq.log.records import ClockRecord, Event, Impact
from daq.log.writer import LogWriter
from drivers.mitsubishi_fr.frames import READ, WRITE, Request, checksum
from drivers.mitsubishi_fr.registers import MARKS, MONITOR_BLOCK, STATUS_BLOCK
from rig.files.surrogate_file import save_surrogate
from rig.live.page_server import PORT
from rig.twin.recorded_samples import RIG
from sim_twin.surrogates.surrogate import learnt_and_tested
from tests.fuzz.targets import CORPUS, SCENARIOS
from tests.rig.files.test_model_file import TEXT
from tests.sim_twin.surrogates.test_surrogate import CHANNELS, three_clearances

START_NS = 1_790_000_000 * NS_PER_S
FORCE = Channel("contact.force_upper", "N", "force", "contact", "9301B", "1234", 41.6, "V")
ANGLE = Channel("crank.angle", "rad")
SCENARIO = (SCENARIOS / "impact_beam.toml").read_text()


def write_run(path: Path) -> None:
    """Everything that a log can hold, in few bytes."""
    with LogWriter(path) as log:
        log.add_metadata("scenario", {"toml": SCENARIO})
        log.add_metadata("run", {"id": "run-7"})
        log.add_event(Event(START_NS + 5, "warning", "rig", "drive.stopping", "früh"))
        log.add_clock(ClockRecord(START_NS, "card", 1e-3, -12.5, float("nan")))
        for origin in ("measured", "predicted"):
            log.add_impact(
                Impact(START_NS, origin, FORCE.name, 4, 9, 6, 40.1, 39.9, 0.3, 1e-3, 1, 12.75), START_NS
            )
            for channel, kind, rate in ((FORCE, "f4", 100.0), (ANGLE, "f8", 50.0)):
                log.declare(origin, channel)
                for first in (0, 10, 30):
                    values = np.arange(first, first + 10).astype(kind)
                    time_ns = sample_time_ns(START_NS, first, rate)
                    flags = Flag.OVERLOAD if first else Flag.GOOD
                    log.add_block(
                        origin, SampleBlock(channel.name, first, time_ns, rate, values, flags), time_ns
                    )


def unsealed(path: Path, run: Path, chunked: bool) -> None:
    """The same log without compression or any checksum: so what is within it can be changed."""
    with run.open("rb") as source, path.open("wb") as file:
        reader = make_reader(source)
        writer = Writer(
            file,
            compression=CompressionType.NONE,
            chunk_size=1 << 10,
            enable_crcs=False,
            use_chunking=chunked,
            index_types=IndexType.ALL if chunked else IndexType.NONE,
        )
        writer.start(library="others")
        numbers: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in numbers:
                assert schema is not None
                numbers[channel.id] = writer.register_channel(channel.topic, "protobuf", 0, channel.metadata)
            writer.add_message(
                numbers[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        for metadata in reader.iter_metadata():
            writer.add_metadata(
                metadata.name, metadata.metadata if metadata.name == "run" else {"toml": "name=1"}
            )
        writer.finish()


def logs(folder: Path) -> Iterator[tuple[str, bytes]]:
    run = folder / "run.mcap"
    write_run(run)
    yield "finished.mcap", run.read_bytes()
    yield "cut.mcap", run.read_bytes()[: run.stat().st_size // 2]
    for chunked in (True, False):
        path = folder / f"unsealed{chunked}.mcap"
        unsealed(path, run, chunked)
        whole = path.read_bytes()
        yield f"unsealed_{'chunks' if chunked else 'records'}.mcap", whole
        yield f"unsealed_{'chunks' if chunked else 'records'}_cut.mcap", whole[: 2 * len(whole) // 3]


def messages(folder: Path) -> Iterator[tuple[str, bytes]]:
    with LogReader(folder / "run.mcap") as log:
        for message in log.messages():
            yield f"{message.topic.strip('/').replace('/', '_')}", message.data


def foreign(folder: Path) -> Iterator[tuple[str, str, bytes]]:
    """Target, name, file: as rattle exports, and as other programs write."""
    with LogReader(folder / "run.mcap") as log, Scratch(folder) as scratch:
        recording = read_log(log, scratch)
        for name, form in FORMATS.items():
            if form.write is not None:
                target = folder / f"own{form.suffixes[0]}"
                for path in form.write(recording, target, lambda _: None):
                    yield name, path.name, path.read_bytes()
    x, rate, times = np.arange(6.0), 1000.0, np.arange(6) / 1000
    path = folder / "x"
    for compressed in (False, True):
        save = np.savez_compressed if compressed else np.savez
        save(folder / "x.npz", x=x, y=np.arange(12, dtype=">i2").reshape(2, 6), fs=rate, x_unit="N")
        yield "npz", f"arrays{compressed}.npz", (folder / "x.npz").read_bytes()
        scipy.io.savemat(
            path, {"x": x, "t": times, "s": {"a": 1}, "c": "text"}, do_compression=compressed, appendmat=False
        )
        yield "mat", f"vectors{compressed}.mat", path.read_bytes()
    scipy.io.savemat(path, {"x": x, "fs": rate}, format="4", appendmat=False)
    yield "mat", "version4.mat", path.read_bytes()
    for name, array in (("plain", x), ("rows", np.ones((2, 6), "f4")), ("fields", np.zeros(6, "f8,f4,S3"))):
        np.save(folder / "x.npy", array)
        yield "npz", f"{name}.npy", (folder / "x.npy").read_bytes()
    pq.write_table(pa.table({"time": times, "x": x}), path, compression="NONE")
    yield "parquet", "plain.parquet", path.read_bytes()
    stamps = pa.array(range(6), pa.timestamp("ms"))
    pq.write_table(
        pa.table({"t": stamps, "x": x, "n": ["a"] * 6}), path, compression="zstd", use_dictionary=True
    )
    yield "parquet", "stamps.parquet", path.read_bytes()
    with TdmsWriter(path) as tdms:
        waveform = {
            "wf_increment": 1e-3,
            "unit_string": "N",
            "wf_start_time": np.datetime64("2026-05-04T10:00"),
        }
        tdms.write_segment([RootObject({"a": 1}), ChannelObject("g", "x", x.astype("f4"), waveform)])
        tdms.write_segment([ChannelObject("g", "x", x.astype("f4")), ChannelObject("g", "n", ["a", "b"])])
    yield "tdms", "waveform.tdms", path.read_bytes()
    for name, text in {
        "seconds": "time,force [N]\n0,1\n0.001,2\n0.002,nan\n",
        "units": "# by hand\nt;x;y\nms;N;m/s2\n0;1,5;2\n1;2,5;1e-3\n",
        "tabs": "x\ty\n1\t2\n3\t4\n",
        "quoted": '"a b","c ""d"""\n1,2\n',
    }.items():
        yield "csv", f"{name}.csv", text.encode()
    ids = "".join(f"{line:<80}\n" for line in ("point 1", "NONE", "NONE", "NONE", "NONE"))
    axes = "".join(f"{kind:10d}    0    0    0 {'Time':<20} {'s':<20}\n" for kind in (17, 12, 0, 0))
    for spacing, numbers in (
        (1, "  1.00000e+00 -2.00000e+00\n"),
        (0, "  0.00000e+00  1.00000e+00  1.00000D-03  2.00000e+00\n"),
    ):
        ordinate = f"{2:10d}{2:10d}{spacing:10d}  0.00000e+00  1.00000e-03  0.00000e+00\n"
        node = f"{1:5d}{1:10d}{0:5d}{0:10d} {'NONE':<10}{1:10d}{0:4d} {'NONE':<10}{0:10d}{0:4d}\n"
        text = f"    -1\n    58\n{ids}{node}{ordinate}{axes}{numbers}    -1\n    -1\n   164\n  1\n    -1\n"
        yield "uff", f"text{spacing}.uff", text.encode()


def piece(*parts: bytes) -> bytes:
    """Parts of an input, each with its length before it."""
    return b"".join(bytes([len(part)]) + part for part in parts)


def frames() -> Iterator[tuple[str, str, bytes]]:
    def registers(*values: int) -> bytes:
        return b"+" + struct.pack(f">BBB{len(values)}H", 1, READ, 2 * len(values), *values)

    mark, status, monitor = ([0] * block.count for block in (MARKS[0], STATUS_BLOCK, MONITOR_BLOCK))
    echo = Request(1, WRITE, 13, 3000).frame()
    yield "modbus", "healthy", piece(registers(*mark), registers(*status), registers(*monitor), b"-" + echo)
    yield (
        "modbus",
        "refused",
        piece(
            *[b"+" + bytes([1, function | 0x80, code]) for function in (3, 6) for code in (1, 4, 5, 6, 10)]
        ),
    )
    yield (
        "modbus",
        "noise",
        piece(
            b"-\0\xff" + bytes([1, 3, 2, 0, 0]) + checksum(b"\1\3\2\0\0"),
            b"+\2\3\2\0\0",
            b"-\1\3\4\0\0\0\0\0\0",
        ),
    )
    late = struct.pack(">h", 10)
    yield (
        "can",
        "positions",
        piece(*[bytes([9 + 64 * (n % 2)]) + late + struct.pack("<I", n) for n in range(0, 60, 3)]),
    )
    yield (
        "can",
        "kinds",
        piece(
            *(
                bytes([kind]) + struct.pack(">h", -3 + kind) + bytes([5, 1, 2, 3, 4, 5, 6, 7][: kind % 9])
                for kind in range(0, 256, 5)
            ),
        ),
    )
    answers = [0x00020196, 0x17F, 1, 1, 0x187, 254, 0, 1, 0x60040020, 4, 8192, 1 << 25]
    yield "sdo", "numbers", b"".join(struct.pack("<BHBI", 0x43, 0, 0, value) for value in answers)
    yield (
        "sdo",
        "short",
        b"".join(
            struct.pack("<BHBI", kind, 0, 0, 5)
            for kind in (0x4F, 0x4B, 0x47, 0x42, 0x40, 0x41, 0x80, 0x60, 0x20)
        ),
    )
    greeting, beats = b"< hi >< ok >< ok >", range(0, 60, 3)
    frames = [f"< frame 187 {1.0 + n * 1e-3:.6f} {struct.pack('<I', n).hex().upper()} >" for n in beats]
    yield "socketcand", "positions", greeting + "".join(frames).encode()
    others = (
        "< frame 707 1.001 05 >< frame 087 1.002 0102030405060708 >< error 004 1.003 >< nothing >"
        "< frame 00000187 1.004 00 >< frame 587 1.005 4300600000000000 >< frame 187 1.006 01000000 >"
    )
    yield "socketcand", "kinds", greeting + others.encode()
    yield "socketcand", "refused", b"< hi >< error could not open bus >"
    healthy = ["Agilent Technologies,33220A,1,1", '+0,"No error"']
    kept = ["0", "SIN", "9.9E37", "VPP", "1.0E1", "2", "0.5", "TRIG", "BUS", "9.9E37", "0", "1"]
    off = "0"  # when it is opened, and when it is armed
    lines = [healthy[0], off, healthy[1], off, "1"]
    lines += [line for answer in kept for line in (answer, healthy[1])]
    yield "scpi", "healthy", "\n".join([*lines, "1", "SIN", "10", "2", "0.5", "0", ""]).encode()
    none, volts = healthy[1], "+2.0E+01"
    told = [volts, none, "2", none, "1", none, "1", none]  # at the speed, watchdog, output
    armed = ["0", "1", "0", none, "0", none, "3", none, "66", none, "20", none]
    checked = ["1", volts, "0", volts, "1"]
    opened = ["Keysight Technologies,N6954A,1,1", "0", none, "81.6", "12.75", "0"]
    answered = [*opened, *armed, *told, *checked, volts, "0.8", "0", ""]
    yield "scpi_supply", "healthy", "\n".join(answered).encode()
    yield (
        "scpi",
        "errors",
        b'Agilent Technologies,33521B,1,1\n0\n-113,"Undefined header"\n+0,"x"\n0\n1\n1e999\n\xff\n-1,"\n',
    )


def requests() -> Iterator[tuple[str, str, bytes]]:
    """What the page, its runs and others send."""
    from_here = f"Host: 127.0.0.1:{PORT}\r\nOrigin: http://127.0.0.1:{PORT}\r\n"
    asked = ("/", "/page.js", "/about", "/state?after=0", "/state?after=17", "/report", "/none")
    yield "page", "asked", "".join(f"GET {path} HTTP/1.1\r\n{from_here}\r\n" for path in asked).encode()
    told = [
        f"PUT /{what}/1.5 HTTP/1.1\r\n{from_here}Content-Length: 1\r\n\r\n7" for what in ("state", "report")
    ]
    yield "page", "told", f"{''.join(told)}GET /report HTTP/1.1\r\n{from_here}\r\n".encode()
    yield "page", "ended", f"DELETE / HTTP/1.1\r\n{from_here}\r\n".encode()
    yield "page", "elsewhere", b"GET /state HTTP/1.1\r\nHost: evil.example\r\n\r\n"


def files() -> Iterator[tuple[str, str, bytes]]:
    for path in sorted(SCENARIOS.glob("*.toml")):
        kind = "sweep" if ".sweep" in path.name else "bench" if "bench" in path.name else "scenario"
        yield kind, path.name, path.read_bytes().replace(b"scenarios/", b"")
    yield ("model", "beam.toml", TEXT.encode())
    yield "effects", "clearance.json", b'[{"name": "clearance", "parameters": {"scale": 1.5}}]'


def surrogates(folder: Path) -> Iterator[tuple[str, str, bytes]]:
    for kind, units in (("rbf", {"max_units": 3}), ("grnn", {"max_prototypes": 5})):
        found = learnt_and_tested(three_clearances(), RIG, CHANNELS, "angle", kind, width=1.0, **units)  # type: ignore[arg-type]
        save_surrogate(found, folder / f"{kind}.npz")
        yield "surrogate", f"{kind}.npz", (folder / f"{kind}.npz").read_bytes()


def main() -> None:
    names = {"numpy": "npz"}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        seeds = list[tuple[str, str, bytes]]()
        for name, data in logs(folder):
            seeds += [(target, name, data) for target in ("log", "recovery", "replay", "report")]
            if name in ("finished.mcap", "unsealed_chunks.mcap"):
                seeds.append(("export", name, data))
            if name == "finished.mcap":
                seeds += [("messages", *seed) for seed in messages(folder)]
        seeds += [*foreign(folder), *frames(), *requests(), *files(), *surrogates(folder)]
        tables = [(name, data) for target, name, data in seeds if target in ("log", "csv", "npz", "numpy")]
        seeds += [("own_rig", name, data) for name, data in tables]
    for target, name, data in seeds:
        path = CORPUS / names.get(target, target) / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


if __name__ == "__main__":
    main()
