"""Frames to and from one node on a CAN bus; no exception of python-can or canopen leaves this module."""

from __future__ import annotations

import logging
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

import can
import canopen
from canopen.objectdictionary import import_od

from daq.clock import Clock
from daq.errors import DeviceLost, InstrumentAbsent, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.canopen_cia406 import frames
from drivers.canopen_cia406.frames import NmtCommand
from drivers.canopen_cia406.objects import Entry
from drivers.canopen_cia406.settings import EncoderSettings
from drivers.canopen_cia406.socketcand import SocketcandBus

SLICE_S = 0.05
_JOIN_S = 2.0

# Both libraries raise what they log: it need not go to standard error where nobody asked for it.
for _library in ("can", "canopen"):
    logging.getLogger(_library).addHandler(logging.NullHandler())


class Listener(Protocol):
    """Hears of everything on the bus, in the thread of the link."""

    def frame(self, message: can.Message, arrival_s: float) -> None:
        """A frame of any node, or an error frame."""
        ...

    def quiet(self, now_s: float) -> None:
        """Nothing came for a while, and nothing waits."""
        ...

    def lost(self, why: str, cause: Exception | None = None) -> None:
        """No frame can come any more."""
        ...


class CanLink:
    """A bus with one thread that reads it; SDO answers go to the caller, everything else to `listener`."""

    def __init__(self, settings: EncoderSettings, listener: Listener, clock: Clock) -> None:
        self._settings, self._listener, self._clock = settings, listener, clock
        self._network: Any = None
        self._sdo: Any = None
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Connect and listen. Raises `InstrumentAbsent`, `InstrumentSilent`."""
        bus = self._connected()
        self._network = canopen.Network(bus)
        node = self._network.add_node(canopen.RemoteNode(self._settings.node, import_od(None)))
        self._sdo = node.sdo
        self._sdo.RESPONSE_TIMEOUT = self._settings.timeout_s
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, args=(bus,), name="encoder", daemon=True)
        self._thread.start()

    def _connected(self) -> can.BusABC:
        settings = self._settings
        check = "the interface, its keys in the bench file, and that it runs"
        keys: dict[str, Any] = dict(settings.options)
        try:
            if settings.interface == "socketcand":
                return SocketcandBus(timeout_s=settings.timeout_s, **keys)
            return can.Bus(interface=settings.interface, ignore_config=True, **keys)
        except TimeoutError as error:
            what = f"no answer within {settings.timeout_s:g} s"
            raise InstrumentSilent(settings.name, settings.address, what, check) from error
        except (can.CanError, NotImplementedError, OSError, TypeError, ValueError, KeyError) as error:
            what = f"nobody answers ({error})"
            raise InstrumentAbsent(settings.name, settings.address, what, check) from error

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
        kept = self.upload(entry)
        if kept != value:
            raise self._refused(f"{entry} = {value} {entry.unit} reads back {kept}")

    def command(self, command: NmtCommand) -> None:
        """Tell the node to change its state; it does not answer."""
        with self._translated(f"sending {command.name}"):
            self._network.send_message(0, [command, self._settings.node])

    def _run(self, bus: can.BusABC) -> None:
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
            self._listener.lost(f"receiving failed ({error})", error)

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
