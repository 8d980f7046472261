"""Lines of text to and from an instrument through VISA; no exception of pyvisa leaves this module."""

from __future__ import annotations

import math
import select
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import cast

import pyvisa
import pyvisa_py.sessions  # what "@py" stands for, loaded with this module and not when a drive is to stop
import pyvisa_py.tcpip
from pyvisa.constants import StatusCode
from pyvisa.resources import MessageBasedResource
from pyvisa_py.protocols import rpc

from daq.clock import wait_steadily
from daq.errors import DeviceLost, InstrumentAbsent, InstrumentError, InstrumentRefused, InstrumentSilent
from drivers.scpi.language import IDENTITY

LONGEST_ANSWER = 4096  # bytes
QUIET_S = 0.1  # an instrument that says nothing for this long has nothing left to say
DRAIN_S = 2.0
_TURN_S = 0.05
"""An exchange takes some ms; whoever has taken longer may hang in one."""

_FOREIGN = (pyvisa.Error, OSError, rpc.RPCError, EOFError)
"""What a link raises; the last two by VXI-11, where a reply is not as it should be."""

wait_steadily(pyvisa_py.sessions, pyvisa_py.tcpip, rpc)


class ScpiLink:
    """One instrument at a VISA resource string, e.g. `TCPIP::192.168.0.5::5025::SOCKET`.

    Every answer is awaited for `timeout_s` at most and may be 4096 bytes long. For any thread: a question and
    its answer are not parted. Once it is known who answers, `identity`, no late answer is taken for another.
    """

    def __init__(self, instrument: str, resource: str, timeout_s: float = 2.0) -> None:
        self.instrument, self.resource, self.timeout_s = instrument, resource, timeout_s
        self._visa: MessageBasedResource | None = None
        self._answer_pending = False
        self.identity = ""
        self.last_word_s = -math.inf  # when a word last went to it or came from it, monotonic
        self._owed = 0  # answers with it that were asked for and have not come
        self._turn = threading.RLock()

    @property
    def is_open(self) -> bool:
        """Whether a connection was made and not closed."""
        return self._visa is not None

    def open(self, first: str = "") -> None:
        """Connect anew and discard what an earlier client left half said. Raises `InstrumentAbsent`.

        The command `first` is sent before anything is read.
        """
        self.close()
        timeout_ms = round(self.timeout_s * 1e3)
        try:
            visa = pyvisa.ResourceManager("@py").open_resource(self.resource, open_timeout=timeout_ms)
        except Exception as error:  # pyvisa-py raises a bare Exception where a connection times out
            raise self._absent(str(error)) from error
        self._visa = cast(MessageBasedResource, visa)
        try:
            self._visa.read_termination = self._visa.write_termination = "\n"
            self._visa.timeout = timeout_ms
            # Only pyvisa-py shows its socket.
            stream = _socket(self._visa)
            if stream is not None:  # a short command must not wait 40 ms for the last one's acknowledgement
                stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._translated("clearing"):
                if first:
                    self._visa.write(f"\n{first}")
                self._drain(self._visa)
                self._visa.write("")  # ends a command that an earlier client left without its line end
                self._drain(self._visa)
        except (ValueError, *_FOREIGN) as error:
            self.close()
            raise self._absent(error.what if isinstance(error, DeviceLost) else str(error)) from error

    def close(self) -> None:
        """Hang up. Never raises."""
        if self._visa is not None:
            visa, self._visa = self._visa, None
            with suppress(*_FOREIGN):
                visa.close()

    def hurry(self, timeout_s: float) -> None:
        """Await answers for so long at most from now on."""
        self.timeout_s = min(timeout_s, self.timeout_s)
        if self._visa is not None:
            self._visa.timeout = self.timeout_s * 1e3

    def write(self, command: str, until_s: float = math.inf) -> None:
        """Send one command. Raises `DeviceLost`, and `InstrumentRefused` later than `until_s` (monotonic)."""
        with self._translated(command) as visa:
            # A process that was frozen may wake up here, and whoever watched it has switched off and gone.
            if (late_s := time.monotonic() - until_s) > 0.0:
                what = f"{command} comes {late_s:.1f} s too late; it was not sent"
                raise InstrumentRefused(
                    self.instrument, self.resource, what, "the load of this machine", "late"
                )
            visa.write(command)
            self.last_word_s = time.monotonic()

    def write_at_once(self, command: str) -> None:
        """Send one without an answer; by a socket also past another thread that hangs in an exchange.

        It is sent once more when that thread has done: it may have said the contrary. Raises `DeviceLost`,
        and `InstrumentSilent` where that thread is not done in time.
        """
        if not self._turn.acquire(timeout=_TURN_S):
            if (visa := self._visa) is None:
                raise self._lost("the connection is closed")
            with suppress(*_FOREIGN):
                if (stream := _socket(visa)) is not None:  # begins with the end of what may be half sent
                    stream.send(f"\n{command}\n".encode("ascii"), socket.MSG_DONTWAIT)
            self._take_turn(command)
        try:
            self.write(command)
        finally:
            self._turn.release()

    def query(self, command: str) -> str:
        """Return the answer to a query. Raises `InstrumentSilent`, `InstrumentRefused`, `DeviceLost`."""
        with self._translated(command) as visa:
            if self._answer_pending:  # the last query timed out or was interrupted; its answer may be late
                self._drain(visa)
                if self.identity:
                    self._await_identity(visa)
            self._answer_pending = True
            visa.write(command)
            self.last_word_s = time.monotonic()
            return self._answer(visa, command)

    def _answer(self, visa: MessageBasedResource, command: str) -> str:
        answer = visa.read_bytes(LONGEST_ANSWER, break_on_termchar=True)
        self.last_word_s = time.monotonic()
        self._answer_pending = not answer.endswith(b"\n")
        if self._answer_pending:
            what = f"its answer to {command} is longer than {LONGEST_ANSWER} bytes"
            raise InstrumentRefused(self.instrument, self.resource, what, "that it is a SCPI instrument")
        return answer.decode("ascii", errors="replace").strip()

    def _await_identity(self, visa: MessageBasedResource) -> None:
        """Answers keep their order: after this one no answer to an earlier question can come."""
        deadline = time.monotonic() + DRAIN_S
        self._answer_pending = True
        self._owed += 1
        visa.write(IDENTITY)
        while self._owed:
            self._answer_pending = True
            self._owed -= self._answer(visa, IDENTITY) == self.identity
            if self._owed and time.monotonic() > deadline:
                self._answer_pending = True
                what = f"no answer to {IDENTITY} among others"
                raise InstrumentSilent(self.instrument, self.resource, what, "who else asks it")

    def _drain(self, visa: MessageBasedResource) -> None:
        deadline = time.monotonic() + DRAIN_S
        visa.timeout = QUIET_S * 1e3
        try:
            while time.monotonic() < deadline and not _closed_by_peer(visa):
                came = visa.read_bytes(LONGEST_ANSWER, break_on_termchar=True)
                if self._owed and came.decode("ascii", errors="replace").strip() == self.identity:
                    self._owed -= 1
        except pyvisa.VisaIOError as error:
            if error.error_code != StatusCode.error_timeout:
                raise
        finally:
            visa.timeout = self.timeout_s * 1e3
        self._answer_pending = False

    @contextmanager
    def _translated(self, command: str) -> Iterator[MessageBasedResource]:
        visa = self._visa
        if visa is None:
            raise self._lost("the connection is closed")
        self._take_turn(command)
        try:
            if _closed_by_peer(visa):
                raise self._lost("it closed the connection")
            yield visa
        except pyvisa.VisaIOError as error:
            if error.error_code != StatusCode.error_timeout:
                raise self._lost(str(error)) from error
            if _closed_by_peer(visa):
                raise self._lost(f"it closed the connection after {command}") from error
            raise InstrumentSilent(
                self.instrument,
                self.resource,
                f"no answer to {command} within {self.timeout_s:g} s",
                "that it is switched on, in remote mode and set to this interface",
            ) from error
        except InstrumentError:
            raise
        except _FOREIGN as error:
            raise self._lost(str(error)) from error
        finally:
            self._turn.release()

    def _take_turn(self, command: str) -> None:
        """Wait for as long as another thread's exchange may take: discard, await the identity, an answer."""
        if not self._turn.acquire(timeout=2 * (DRAIN_S + QUIET_S + self.timeout_s)):
            what = f"{command} was not sent: another exchange with it hangs"
            raise InstrumentSilent(self.instrument, self.resource, what, "its interface and cable")

    def _absent(self, why: str) -> InstrumentAbsent:
        check = "cable, power and the resource string in the bench file"
        return InstrumentAbsent(self.instrument, self.resource, f"nobody answers ({why})", check)

    def _lost(self, why: str) -> DeviceLost:
        return DeviceLost(
            self.instrument, self.resource, f"the connection is lost ({why})", "cable and power"
        )


def _socket(visa: MessageBasedResource) -> socket.socket | None:
    # pyvisa-py 0.8 does not set VI_ATTR_TCPIP_NODELAY and takes the end of a stream for silence.
    session = getattr(visa.visalib, "sessions", {}).get(visa.session)
    interface = getattr(session, "interface", None)
    return interface if isinstance(interface, socket.socket) else None


def _closed_by_peer(visa: MessageBasedResource) -> bool:
    stream = _socket(visa)
    if stream is None:
        return False
    try:
        readable, _, _ = select.select([stream], [], [], 0)
        return bool(readable) and stream.recv(1, socket.MSG_PEEK) == b""
    except OSError:
        return True
