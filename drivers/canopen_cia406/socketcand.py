"""python-can's socketcand bus without its traps (version 4.6.1)."""

from __future__ import annotations

import socket
from typing import Any

import can
from can.interfaces.socketcand.socketcand import SocketCanDaemonBus

_LONGEST_GREETING = 80


class SocketcandBus(SocketCanDaemonBus):
    """A socketcand bus whose handshake has a deadline, and which notices when the server hangs up.

    As it is, the handshake waits for ever for a server that hangs and fails where a frame comes right behind
    the last answer, as on any busy bus; a refused connection is tried again for 10 s without a pause; and the
    end of the stream is taken for silence. Raises `OSError` (`TimeoutError` after `timeout_s`), `CanError`.
    """

    def __init__(self, channel: str, host: str, port: int, timeout_s: float, **keys: Any) -> None:
        self._timeout_s = timeout_s
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
        if message is None and self._ended():
            raise can.CanOperationError("it closed the connection")
        return message, False

    def _ended(self) -> bool:
        try:
            return self._stream.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False


def _untyped(parent: object) -> Any:
    return parent
