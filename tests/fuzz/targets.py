"""What takes bytes of strangers, each as a function that raises nothing but what is wrong with rattle.

`TARGETS` is the one table: the tests give each a few hundred odd inputs and those that were kept,
`scripts/fuzz` millions. What an input may cost is checked here too.
"""

from __future__ import annotations

import asyncio
import io
import math
import socket
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cache, partial
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args
from unittest import mock

import can
import canopen
import pyvisa
from can.interfaces.socketcand import socketcand
from canopen.objectdictionary import import_od
from pyvisa.constants import StatusCode
from rich.console import Console

from daq.clock import SystemClock
from daq.errors import RattleError
from daq.formats import FORMATS, arrays, comma_separated, mat, parquet, tdms, uff
from daq.formats.contents import Contents, FileFormat
from daq.formats.recording import read_log, write_log
from daq.formats.samples import Scratch, chunks
from daq.log import codec
from daq.log.reader import LogReader, Origin, origin_and_name
from daq.log.records import ClockRecord, Event, Gap, Impact
from daq.log.recover import recover_log, verify_log
from daq.log.writer import LogWriter
from drivers.canopen_cia406 import frames as can_frames
from drivers.canopen_cia406 import startup
from drivers.canopen_cia406.link import CanLink, SocketcandBus
from drivers.canopen_cia406.objects import PositionLayout
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.canopen_cia406.stream import PositionStream
from drivers.mitsubishi_fr.conversation import Conversation
from drivers.mitsubishi_fr.frames import Answer, Request, checksum, find_answer, what_was_heard
from drivers.mitsubishi_fr.line import LineHealth, NoAnswer
from drivers.mitsubishi_fr.registers import MONITOR_BLOCK, RUNNING_FREQUENCY, STATUS_AND_COMMAND, STATUS_BLOCK
from drivers.scpi.generator import ScpiGenerator
from drivers.scpi.settings import GeneratorSettings
from drivers.scpi.supply import ScpiSupply
from drivers.scpi.supply_settings import SupplySettings
from rig.diagnosis.own_rig import columns_of
from rig.files.bench import load_bench
from rig.files.effects_file import load_effects
from rig.files.foreign import Answers, matched_to_rig
from rig.files.model_file import load_model
from rig.files.quantity import si_value
from rig.files.scenario import Scenario, load_scenario, parse_scenario
from rig.files.surrogate_file import load_surrogate
from rig.files.sweep import load_sweep
from rig.live.page_server import PORT, PageServer
from rig.report.page import render
from rig.report.record import read_run
from rig.rigs import RIGS
from rig.session.progress import Screen
from rig.session.replay import replay_log
from tests.hostile import MOST_BYTES, most_used_bytes, used_bytes

CORPUS = Path(__file__).parent / "corpus"
SCENARIOS = Path(__file__).parents[2] / "scenarios"
MOST_S_A_MIB = 1.0
_IN_MEMORY = Path("/dev/shm")  # noqa: S108 - where there is one; what a file is does not hang on the disk
_OFTEN = 200
"""Answers that an instrument gives at most: then it is silent."""


@dataclass(frozen=True, slots=True)
class Target:
    """`decode` is given bytes, and a folder if it wants a `suffix`; `longest` bytes are worth trying."""

    decode: Callable[[Any], None]
    suffix: str = ""
    longest: int = 1 << 14

    def run(self, data: bytes) -> None:
        """Raises what is none of rattle's errors."""
        if not self.suffix:
            self.decode(data)
            return
        with tempfile.TemporaryDirectory(dir=_IN_MEMORY if _IN_MEMORY.is_dir() else None) as folder:
            path = Path(folder) / f"x{self.suffix}"
            path.write_bytes(data)
            self.decode(path)


class Spent:
    """Tries inputs of a target, and keeps the most that one took: CPU seconds for each MiB begun, memory.

    What is loaded at the first use, and was there before, is no input's fault.
    """

    def __init__(self, name: str) -> None:
        self._target = TARGETS[name]
        si_value("1 furlong", "m")
        for path in kept(name):
            with suppress(Exception):  # it fails once more when it is tried
                self._target.run(path.read_bytes())
        self.seconds_a_mib, self.more_bytes, self._before = 0.0, 0, used_bytes()

    def run(self, data: bytes) -> None:
        """Raises AssertionError where an input takes more than it may."""
        begun = time.process_time()
        self._target.run(data)
        seconds = (time.process_time() - begun) / max(math.ceil(len(data) / (1 << 20)), 1)
        self.seconds_a_mib = max(self.seconds_a_mib, seconds)
        self.more_bytes = most_used_bytes() - self._before
        assert seconds < MOST_S_A_MIB, f"{seconds:.2f} s for each MiB"
        assert self.more_bytes < MOST_BYTES, f"{self.more_bytes >> 20} MiB"


def _all(*steps: Callable[[], object]) -> None:
    for step in steps:
        with suppress(RattleError):
            step()


# Logs


def _log(path: Path) -> None:
    with suppress(RattleError):
        verify_log(path)
    with suppress(RattleError), LogReader(path) as log, Scratch(path.parent) as scratch:
        origins: tuple[Origin, ...] = get_args(Origin)
        _all(log.events, log.gaps, log.clocks, log.impacts, lambda: log.until_stop_s)
        _all(*(partial(log.table, origin) for origin in origins), lambda: read_log(log, scratch))
        _all(lambda: list(log.messages(skip_damaged=True)), lambda: parse_scenario(log.scenario))


def _replay(path: Path) -> None:
    screen = Screen(Console(file=io.StringIO()))
    with suppress(RattleError):
        replay_log(path, 0.0, None, screen, SystemClock())


def _report(path: Path) -> None:
    with suppress(RattleError):
        render(read_run(path))


def _own_rig(path: Path) -> None:
    """What somebody measured, by either ending; a log by any."""
    for suffix in (".npz", ".csv"):
        path = path.rename(path.with_suffix(suffix))
        with suppress(RattleError):
            columns_of(path)


def _recovery(path: Path) -> None:
    target = path.with_name("recovered.mcap")
    with suppress(RattleError):
        report = recover_log(path, target)
        assert report.complete, report
        assert not report.damage, report
        with LogReader(path) as log, LogReader(target) as recovered:
            topics = recovered.topic_metadata()
            there = _blocks_as_written(log, topics)
            for block in _blocks_as_written(recovered, topics):
                assert block in there, "invented, or in another order"  # which goes on behind it


def _blocks_as_written(log: LogReader, topics: Collection[str]) -> Iterator[tuple[str, bytes]]:
    for message in log.messages(topics, skip_damaged=True):
        if origin_and_name(message.topic)[0]:
            yield message.topic, message.data


def _export(path: Path) -> None:
    with suppress(RattleError), LogReader(path) as log, Scratch(path.parent) as scratch:
        recording = read_log(log, scratch)
        for kind in FORMATS.values():
            if kind.write is not None:
                target = path.with_name(f"export{kind.suffixes[0]}")
                _all(partial(kind.write, recording, target, lambda _: None))


def _messages(data: bytes) -> None:
    kinds: tuple[Any, ...] = (Event, Gap, ClockRecord, Impact)
    _all(lambda: codec.decode_block("a", data), *(partial(codec.decode_record, kind, data) for kind in kinds))


# Files of other programs


@cache
def _scenario() -> Scenario:
    return load_scenario(SCENARIOS / "impact_beam.toml")


def _imported(kind: FileFormat, path: Path) -> None:
    with suppress(RattleError), Scratch(path.parent) as scratch:
        contents = kind.read(path, scratch)
        _all(*(partial(_read_all, column.samples) for column in contents.columns))
        _all(lambda: _as_log(contents, path.with_suffix(".mcap")))


def _read_all(samples: Any) -> None:
    for _ in chunks(samples):
        pass


def _as_log(contents: Contents, path: Path) -> None:
    channels = RIGS["impact_beam"].channels.told
    renamed = {column.name: name for column, name in zip(contents.columns, channels, strict=False)}
    units = {column.name: RIGS["impact_beam"].channels.unit(renamed[column.name]) or "" for column in
             contents.columns if column.name in renamed and column.unit is None}  # fmt: skip
    recording = matched_to_rig(contents, _scenario(), Answers(renamed, units), "x", lambda _: None)
    with LogWriter(path) as writer:
        write_log(recording, writer)


# Files of the operator


@cache
def _catalogues() -> tuple[Any, ...]:
    return tuple(kind.nominal().model.effects for kind in RIGS.values())


def _effects(path: Path) -> None:
    _all(*(partial(load_effects, path, catalogue) for catalogue in _catalogues()))


def _sweep(path: Path) -> None:
    path.with_name("impact_beam.toml").write_text(_scenario().text)
    _all(partial(load_sweep, path))


def _model(path: Path) -> None:
    _all(*(partial(load_model, path, rig) for rig in RIGS))


# Instruments


def _pieces(data: bytes) -> Iterator[bytes]:
    """An input as what came one after another: each with its length before it."""
    at = 0
    while at < len(data):
        length = data[at]
        yield data[at + 1 : at + 1 + length]
        at += 1 + length


class _HeardLine:
    """A line on which, whatever is asked, one piece after another is heard.

    The first byte of a piece says whether the rest gets the checksum that it lacks.
    """

    def __init__(self, data: bytes) -> None:
        self._heard = _pieces(data)
        self.health = LineHealth(lambda: 0.0)

    async def ask(self, request: Request) -> Answer:
        piece = next(self._heard, b"")
        heard = piece[1:] + (checksum(piece[1:]) if piece[:1] == b"+" else b"")
        answer = find_answer(request, heard)
        if answer is None:
            raise NoAnswer(what_was_heard(request, heard))
        return answer

    async def reopen(self) -> bool:
        return False  # it is never lost


async def _at_once(_: float) -> None:
    pass


async def _exchanges(data: bytes) -> None:
    talk = Conversation("inverter", "port", 1, _HeardLine(data), lambda: 0.0, _at_once)
    for _ in range(3):
        for block in (STATUS_BLOCK, MONITOR_BLOCK):
            with suppress(RattleError):
                await talk.read(block, 1.0)
        with suppress(RattleError):
            await talk.write(RUNNING_FREQUENCY, 3000, 1.0)
        with suppress(RattleError):
            await talk.command(STATUS_AND_COMMAND, 2, 1.0)


def _modbus(data: bytes) -> None:
    asyncio.run(asyncio.wait_for(_exchanges(data), 10.0))  # nothing in it waits


_ENCODER = EncoderSettings(node=7, interface="socketcand", timeout_s=1e-9)


def _can(data: bytes) -> None:
    """Frames as they come: kind and identifier, how much later than the one before in 0.1 ms, bytes."""
    stream = PositionStream(_ENCODER)
    stream.begin(PositionLayout(0, 4), 1 << 25, 0.1)
    known = (can_frames.TPDO1, can_frames.HEARTBEAT, can_frames.EMCY)
    now_s = 0.0
    for piece in _pieces(data):
        head = piece[:3].ljust(3, b"\0")
        delay_s = int.from_bytes(head[1:3], "big", signed=True) * 1e-4
        now_s += abs(delay_s)
        if head[0] & 128:
            stream.quiet(now_s)
            continue
        stream.frame(
            can.Message(
                now_s if head[0] & 64 else now_s + delay_s,
                known[head[0] % 3] + 7 if head[0] % 4 else int.from_bytes(piece[3:7], "big") & 0x7FF,
                is_extended_id=False,
                is_error_frame=head[0] & 56 == 56,
                is_remote_frame=head[0] & 56 == 48,
                dlc=len(piece[3:11]) if head[0] & 8 else 4,
                data=piece[3:11],
            ),
            now_s,
        )
    _take_all(stream)


def _take_all(stream: PositionStream) -> None:
    stream.end()
    numbers: list[int] = []
    with suppress(RattleError):
        while True:
            numbers += stream.take(5, 0.0).number.tolist()
    assert all(one < two for one, two in pairwise(numbers))
    assert stream.statistics.frames == len(numbers)


class _SaidAtOnce(socket.socket):
    """A connection on which all of the input has come, whatever is asked, and which is hung up then."""

    def __init__(self, data: bytes) -> None:
        near, self._far = socket.socketpair()
        super().__init__(fileno=near.detach())
        self._far.sendall(data)
        self._far.shutdown(socket.SHUT_WR)

    def connect(self, address: object) -> None:
        pass

    def setsockopt(self, *_: object) -> None:
        pass

    def close(self) -> None:
        self._far.close()
        super().close()


def _socketcand(data: bytes) -> None:
    """The text of a server: what it says as a client comes, then frames."""
    stream = PositionStream(_ENCODER)
    stream.begin(PositionLayout(0, 4), 1 << 25, 0.1)
    wire = _SaidAtOnce(data)
    names = SimpleNamespace(**vars(socket) | {"socket": lambda *_: wire})
    with (
        mock.patch.object(socketcand, "socket", names),
        mock.patch("socket.create_connection"),
        closing(wire),
        suppress(can.CanError, OSError),
        SocketcandBus("can0", "x", 1, timeout_s=1.0) as bus,
    ):
        for beat in count():
            message = bus.recv(0.0)
            if message is None:
                stream.quiet(beat * 1e-3)
            else:
                stream.frame(message, beat * 1e-3)
    _take_all(stream)


class _AnsweringBus:
    """A bus on which a node answers each question with the next eight bytes."""

    def __init__(self, data: bytes) -> None:
        self._data = data[: 8 * _OFTEN]
        self.network: Any = None

    def send(self, message: can.Message) -> None:
        answer, self._data = self._data[:8], self._data[8:]
        # what an answer is to, it has to repeat
        if answer[:1] and not answer[0] & 1:
            answer = bytes([answer[0] & 0xFE]) + bytes(message.data[1:4]) + answer[4:]
        if answer:
            self.network.notify(can_frames.SDO_ANSWER + 7, bytearray(answer), 0.0)


def _sdo(data: bytes) -> None:
    bus = _AnsweringBus(data)
    link = CanLink(_ENCODER, PositionStream(_ENCODER), mock.Mock())
    link._network = bus.network = canopen.Network(bus)  # type: ignore[arg-type]
    link._sdo = link._network.add_node(canopen.RemoteNode(7, import_od(None))).sdo
    link._sdo.RESPONSE_TIMEOUT = _ENCODER.timeout_s
    with suppress(RattleError):
        startup.differences(startup.read(link, _ENCODER), _ENCODER)


class _AnsweringVisa:
    """A VISA resource that answers with lines of the input, whatever it is asked; then it is silent."""

    visalib = session = None

    def __init__(self, data: bytes) -> None:
        self._lines = data.splitlines(keepends=True)[:_OFTEN]
        self._asked = False

    def open_resource(self, *_: object, **__: object) -> _AnsweringVisa:
        return self

    def write(self, command: str) -> None:
        self._asked = "?" in command

    def read_bytes(self, count: int, **_: object) -> bytes:
        if not self._asked or not self._lines:
            raise pyvisa.VisaIOError(StatusCode.error_timeout)
        self._asked = False
        line = self._lines.pop(0)
        return line if line.endswith(b"\n") else line.ljust(count, b" ")[:count]

    def close(self) -> None:
        pass


def _scpi(data: bytes) -> None:
    with mock.patch("pyvisa.ResourceManager", return_value=_AnsweringVisa(data)):
        generator = ScpiGenerator(GeneratorSettings(1.0, 5.0, resource="TCPIP::192.0.2.1::5025::SOCKET"))
        _all(
            generator.open,
            partial(generator.arm_sine, 10.0, 1.0, 0.5, triggered=True),
            partial(generator.set_frequency, 11.0),
            generator.start,
            *[generator.check] * 5,
            generator.off,
        )
        generator.close()


def _scpi_supply(data: bytes) -> None:
    with mock.patch("pyvisa.ResourceManager", return_value=_AnsweringVisa(data)):
        supply = ScpiSupply(SupplySettings(5.0, 300.0, 3.0, resource="TCPIP::192.0.2.1::5025::SOCKET"))
        _all(
            supply.open,
            partial(supply.arm, 100.0),
            supply.start,
            *[supply.check] * 5,
            supply.read,
            supply.off,
        )
        supply.close()


# The operator's page


class _Page(PageServer):
    """Answers what it is handed, on no port."""

    def __init__(self) -> None:
        super().__init__(0)
        self.server_close()
        self.port = PORT
        self.tell(b"{}", 0.0)

    def shutdown(self) -> None:
        pass


def _page(data: bytes) -> None:
    """All that a browser sends on one connection."""
    browser = mock.Mock(**{"makefile.return_value": io.BytesIO(data)})
    page = _Page()
    page.RequestHandlerClass(browser, ("127.0.0.1", 1), page)


IMPORTED = {
    "tdms": tdms.FORMAT,
    "mat": mat.FORMAT,
    "uff": uff.FORMAT,
    "csv": comma_separated.FORMAT,
    "parquet": parquet.FORMAT,
    "npz": arrays.FORMAT,
}
TARGETS = {
    "log": Target(_log, ".mcap"),
    "recovery": Target(_recovery, ".mcap"),
    "export": Target(_export, ".mcap"),
    "replay": Target(_replay, ".mcap"),
    "report": Target(_report, ".mcap"),
    "own_rig": Target(_own_rig, ".mcap"),
    "messages": Target(_messages),
    "modbus": Target(_modbus, longest=1 << 10),
    "can": Target(_can, longest=1 << 12),
    "socketcand": Target(_socketcand, longest=1 << 12),
    "sdo": Target(_sdo, longest=1 << 9),
    "scpi": Target(_scpi, longest=1 << 12),
    "scpi_supply": Target(_scpi_supply, longest=1 << 12),
    **{name: Target(partial(_imported, kind), f".{name}") for name, kind in IMPORTED.items()},
    "page": Target(_page, longest=1 << 12),
    "scenario": Target(lambda path: _all(partial(load_scenario, path)), ".toml"),
    "bench": Target(lambda path: _all(partial(load_bench, path)), ".toml"),
    "sweep": Target(_sweep, ".toml"),
    "model": Target(_model, ".toml"),
    "effects": Target(_effects, ".json"),
    "surrogate": Target(lambda path: _all(partial(load_surrogate, path, "planar_slider_crank")), ".npz"),
}


def kept(name: str) -> list[Path]:
    """The inputs that were kept of a target: small files that go far, and what once did harm."""
    return sorted((CORPUS / name).iterdir())
