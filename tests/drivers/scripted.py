"""An instrument on TCP that answers as a test tells it, however wrong."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress

Answer = Callable[[str], bytes | None]


class ScriptedInstrument:
    """Answers each line with `answer(line)`; None hangs up."""

    def __init__(self, answer: Answer) -> None:
        self._answer = answer
        self._server = socket.create_server(("127.0.0.1", 0))
        self._client: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve)
        self.resource = f"TCPIP::127.0.0.1::{self._server.getsockname()[1]}::SOCKET"
        self.lines: list[str] = []

    def __enter__(self) -> ScriptedInstrument:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        for end in (self._server, self._client):
            if end is not None:
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._server.close()

    def _serve(self) -> None:
        with suppress(OSError):
            self._client, _ = self._server.accept()
            with self._client, self._client.makefile("rb") as lines:
                for line in lines:
                    text = line.decode("ascii").strip()
                    self.lines.append(text)
                    answer = self._answer(text)
                    if answer is None:
                        return
                    self._client.sendall(answer)


def healthy(line: str) -> bytes:
    """Answer as a 33220A that keeps what it is told, as far as the driver asks."""
    if line == "*IDN?":
        return b"Agilent Technologies,33220A,1,1\n"
    if line == "SYST:ERR?":
        return b'+0,"No error"\n'
    return {"*OPC?": b"1\n", "OUTP?": b"0\n"}.get(line, b"")
