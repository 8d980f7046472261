"""Frames to and from one node on a CAN bus; no exception of python-can or canopen leaves this module."""

from __future__ import annotations

import logging
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

import can
import can.bus
import canopen
from can.interfaces.socketcand import socketcand
from canopen.objectdictionary import import_od

from daq.block import LATEST, NS_PER_S
from daq.clock import Clock, wait_steadily
from daq.errors import DeviceLost, InstrumentAbsent, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.canopen_cia406 import frames
from drivers.canopen_cia406.frames import NmtCommand
from drivers.canopen_cia406.objects import Entry
from drivers.canopen_cia406.settings import EncoderSettings

SLICE_S = 0.05  # how long the thread waits for a frame before it looks whether it is to stop
_JOIN_S = 2.0  # forty slices: a thread that has not ended by then hangs in an interface's driver

wait_steadily(can.bus, socketcand)

# Both libraries raise what they log: it need not go to standard error where nobody asked for it.
for _library in ("can", "canopen"):
    logging.getLogger(_library).addHandler(logging.NullHandler())


class Listener(Protocol):
    """Hears of everything on the bus, in the thread of the link."""

    def frame(self, message: can.Message, arrival_s: float) -> None:
        """A frame of any node, or an error frame."""

    def quiet(self, now_s: float) -> None:
        """Nothing came for a while, and nothing waits."""

    def lost(self, why: str, cause: Exception | None = None) -> None:
        """No frame can come any more."""


_LONGEST_GREETING = 80  # bytes; a server's answers have about ten


class SocketcandBus(socketcand.SocketCanDaemonBus):
    """A socketcand bus whose handshake has a deadline, and which notices when the server hangs up.

    As it is, the handshake waits for ever for a server that hangs and fails where a frame comes right behind
    the last answer, as on any busy bus; a refused connection is tried again for 10 s without a pause; and the
    end of the stream is taken for silence. Raises `OSError` (`TimeoutError` after `timeout_s`), `CanError`.
    """

    def __init__(self, channel: str, host: str, port: int, timeout_s: float, **keys: Any) -> None:
        self._timeout_s = timeout_s
        # python-can would try a refused connection for 10 s: ask first, within our own deadline.
        socket.create_connection((host, port), timeout_s).close()
        try:
            _untyped(super()).__init__(channel, host, port, **{"tcp_tune": True, **keys})
        except BaseException:
            self._stream.close()
            raise

    @property
    def _stream(self) -> socket.socket:
        stream = self._SocketCanDaemonBus__socket  # type: ignore[attr-defined]
        assert isinstance(stream, socket.socket)  # noqa: S101 - pinned by every test of this driver
        return stream

    def _expect_msg(self, msg: str) -> None:
        stream, answer = self._stream, b""
        stream.settimeout(self._timeout_s)
        while not answer.endswith(b">") and len(answer) < _LONGEST_GREETING:
            byte = stream.recv(1)  # not more: what comes behind are frames
            if not byte:
                raise can.CanError(f"it hung up after {answer!r}")
            answer += byte
        stream.settimeout(None)
        if answer != msg.encode("ascii"):
            raise can.CanError(f"it says {answer.decode('ascii', 'replace')!r} and not {msg!r}")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message: can.Message | None = _untyped(super())._recv_internal(timeout)[0]
        with suppress(BlockingIOError):  # nothing waits, and nobody has hung up
            if message is None and self._stream.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b"":
                raise can.CanOperationError("it closed the connection")
        if message is not None and not 0.0 <= message.timestamp < LATEST / NS_PER_S:
            raise can.CanOperationError(f"it says that a frame came at {message.timestamp:g} s")
        return message, False


def _untyped(parent: object) -> Any:
    return parent


class CanLink:
    """A bus with one thread that reads it; SDO answers go to the caller, everything else to `listener`.

    canopen's own thread is not started: whatever a bus raises as it is read has to reach `listener.lost`.
    `upload`, `download` and `command` are for the caller's thread: the link's would wait for itself.
    """

    def __init__(self, settings: EncoderSettings, listener: Listener, clock: Clock) -> None:
        self._settings, self._listener, self._clock = settings, listener, clock
        self._network: Any = None
        self._sdo: Any = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Connect and listen. Raises `InstrumentAbsent`, `InstrumentSilent`."""
        settings = self._settings
        check = "the interface, its keys in the bench file, and that it runs"
        keys: dict[str, Any] = dict(settings.options)
        try:
            bus: can.BusABC
            if settings.interface == "socketcand":
                bus = SocketcandBus(timeout_s=settings.timeout_s, **keys)
            else:
                # Without ignore_config a file of the user's would decide which bus it is.
                bus = can.Bus(interface=settings.interface, ignore_config=True, **keys)
        except TimeoutError as error:
            what = f"no answer within {settings.timeout_s:g} s"
            raise InstrumentSilent(settings.name, settings.address, what, check) from error
        except (can.CanError, NotImplementedError, OSError, TypeError, ValueError, KeyError) as error:
            what = f"nobody answers ({error})"
            raise InstrumentAbsent(settings.name, settings.address, what, check) from error
        self._network = canopen.Network(bus)  # not connected: that would start its own thread
        # An empty dictionary: what is read and written is named by `Entry`, not by an EDS file.
        node = self._network.add_node(canopen.RemoteNode(settings.node, import_od(None)))
        self._sdo = node.sdo
        self._sdo.RESPONSE_TIMEOUT = settings.timeout_s
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, args=(bus,), name="encoder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Hang up. Never raises."""
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(_JOIN_S)
        network, self._network, self._sdo = self._network, None, None
        if network is not None:
            with suppress(can.CanError, OSError):
                network.disconnect()

    def upload(self, entry: Entry) -> int:
        """Return the value of an entry.

        Raises `InstrumentRefused` where the node says no, `InstrumentSilent` where it says nothing in time.
        """
        with self._translated(f"reading {entry}"):
            # One segment is enough for a number; more would let a node send for ever.
            return entry.decode(bytes(self._sdo.open(entry.index, entry.subindex, buffering=0).read(7)))

    def download(self, entry: Entry, value: int) -> None:
        """Write an entry and read it back. Raises as `upload` does."""
        with self._translated(f"{entry} = {value}"):
            self._sdo.download(entry.index, entry.subindex, entry.encode(value))
        # An acknowledged write counts once it reads back.
        kept = self.upload(entry)
        if kept != value:
            raise self._refused(f"{entry} = {value} {entry.unit} reads back {kept}")

    def command(self, command: NmtCommand) -> None:
        """Tell the node to change its state; it does not answer."""
        with self._translated(f"sending {command.name}"):
            self._network.send_message(0, [command, self._settings.node])

    def _run(self, bus: can.BusABC) -> None:
        # canopen hears of its answers alone; all else goes on without passing through its queues.
        answer_id = frames.SDO_ANSWER + self._settings.node
        try:
            while not self._stop.is_set():
                message = bus.recv(SLICE_S)
                now_s = self._clock.monotonic_s()
                if message is None:
                    self._listener.quiet(now_s)
                elif message.arbitration_id == answer_id and not message.is_error_frame:
                    self._network.notify(answer_id, message.data, message.timestamp)
                else:
                    self._listener.frame(message, now_s)
        except Exception as error:  # top of a thread: whatever it was, no frame will come
            said = str(error).partition("  Traceback")[0].splitlines() or [type(error).__name__]
            self._listener.lost(f"receiving failed ({said[0]})", error)  # python-can adds where it came from

    @contextmanager
    def _translated(self, doing: str) -> Iterator[None]:
        if self._network is None:
            raise DeviceLost(self._settings.name, self._settings.address, "the encoder is not open")
        try:
            yield
        except canopen.SdoAbortedError as error:
            raise self._refused(f"{doing}: {error}", f"{error.code:08X}h") from error
        except canopen.SdoCommunicationError as error:
            what = f"{doing}: no answer within {self._settings.timeout_s:g} s ({error})"
            check = "power, bit rate, cable and node number"
            raise InstrumentSilent(self._settings.name, self._settings.address, what, check) from error
        except (ValueError, OverflowError, struct.error) as error:
            raise self._refused(f"{doing}: {error}") from error
        except InstrumentError:
            raise
        except (can.CanError, OSError) as error:
            what = f"the connection is lost ({doing}: {error})"
            check = "cable and power of the interface"
            raise DeviceLost(self._settings.name, self._settings.address, what, check) from error

    def _refused(self, what: str, code: str = "") -> InstrumentRefused:
        return InstrumentRefused(
            self._settings.name, self._settings.address, what, "that it is a CiA 406 encoder", code
        )
