"""A CAN bus with a socketcand server on it, as far as raw mode (socketcand, doc/protocol.md)."""

from __future__ import annotations

import queue
import selectors
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import can

_LONGEST_COMMAND = 200  # bytes
_PENDING = 1 << 18
"""Bytes kept for a client that does not read; what comes then is lost, as on the interface itself."""


@dataclass(slots=True)
class _Client:
    connection: socket.socket
    received: bytearray = field(default_factory=bytearray)
    pending: bytearray = field(default_factory=bytearray)
    raw: bool = False


class SocketcandBus(can.BusABC):
    """The far end: what is sent here goes to all clients, what they send is received here.

    A frame carries `stamp()` (s) unless it has a timestamp already.
    """

    def __init__(self, channel: str, stamp: Callable[[], float]) -> None:
        self._name, self._stamp = channel, stamp
        self._arrived: queue.SimpleQueue[can.Message] = queue.SimpleQueue()
        self._clients: dict[socket.socket, _Client] = {}
        self._lock = threading.Lock()  # over clients and their bytes: any thread sends
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._wake, self._woken = socket.socketpair()  # ends `select` from another thread
        self.channel_info = f"emulated {channel}"
        super().__init__(channel)

    @property
    def address(self) -> str:
        """Where clients find it, `host:port`."""
        return f"127.0.0.1:{self._listener.getsockname()[1]}"

    def serve(self) -> None:
        """Attend to clients until `stop`."""
        with selectors.DefaultSelector() as selector:
            for ready in (self._listener, self._woken):
                selector.register(ready, selectors.EVENT_READ)
            while True:
                for key, _ in selector.select():
                    if key.fileobj is self._woken:
                        return
                    if key.fileobj is self._listener:
                        self._accept(selector)
                    elif isinstance(key.fileobj, socket.socket) and not self._take(key.fileobj):
                        selector.unregister(key.fileobj)

    def stop(self) -> None:
        """End `serve`; may be called by any thread."""
        self._wake.send(b"x")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Pass a frame on to every client in raw mode."""
        stamp_s = msg.timestamp or self._stamp()
        if msg.is_error_frame:
            self.say(f"< error {msg.arbitration_id:03X} {stamp_s:.6f} >")  # socketcand sends no data with it
        else:
            width = 8 if msg.is_extended_id else 3
            self.say(f"< frame {msg.arbitration_id:0{width}X} {stamp_s:.6f} {msg.data.hex().upper()} >")

    def say(self, text: str) -> None:
        """Send a line to every client in raw mode."""
        with self._lock:
            for client in self._clients.values():
                if client.raw:
                    _write(client, text)

    def hang_up(self) -> None:
        with self._lock:
            for connection in self._clients:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)  # `serve` reads the end, and forgets the client

    def shutdown(self) -> None:
        super().shutdown()
        for end in (self._listener, self._wake, self._woken, *self._clients):
            end.close()

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            return self._arrived.get(timeout=timeout), False
        except queue.Empty:
            return None, False

    def _accept(self, selector: selectors.BaseSelector) -> None:
        with suppress(OSError):  # it has hung up already
            connection, _ = self._listener.accept()
            connection.setblocking(False)
            # Else a frame waits for the acknowledgement of the one before: python-can's tcp_tune at this end.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = _Client(connection)
            with self._lock:
                self._clients[connection] = client
                _write(client, "< hi >")
            selector.register(connection, selectors.EVENT_READ)

    def _take(self, connection: socket.socket) -> bool:
        client = self._clients[connection]
        try:
            data = connection.recv(4096)
        except BlockingIOError:
            return True
        except OSError:
            data = b""
        client.received += data
        *commands, rest = client.received.split(b">")
        # What never ends is no command: only its end is kept.
        client.received = bytearray(rest[-_LONGEST_COMMAND:])
        for command in commands:
            self._obey(client, command.decode("ascii", "replace").strip(" <").split())
        if not data:
            with self._lock:
                del self._clients[connection]
            connection.close()
        return bool(data)

    def _obey(self, client: _Client, words: list[str]) -> None:
        with self._lock:
            match words:
                case ["open", channel]:
                    _write(client, "< ok >" if channel == self._name else "< error could not open bus >")
                case ["rawmode"]:
                    client.raw = True
                    _write(client, "< ok >")
                case ["echo"]:
                    _write(client, "< echo >")
                case ["send", name, length, *content]:
                    with suppress(ValueError):  # socketcand drops what it cannot read
                        data = bytes(int(byte, 16) for byte in content[: int(length, 16)])
                        extended = len(name) > 3  # 3 digits are 11 bits, 8 are 29
                        self._arrived.put(
                            can.Message(
                                arbitration_id=int(name, 16), is_extended_id=extended, data=data, check=True
                            )
                        )
                case ["send", *_]:
                    pass
                case _:
                    _write(client, "< error unknown command >")


def _write(client: _Client, text: str) -> None:
    if len(client.pending) < _PENDING:
        client.pending += text.encode("ascii")
    with suppress(BlockingIOError, ConnectionError):  # a client that has gone is noticed when it is read
        while client.pending:
            del client.pending[: client.connection.send(client.pending)]
