"""A person as an actuator: what is to be set is asked of them, and they are told what is measured."""

from __future__ import annotations

import socket
import sys
import threading
from contextlib import suppress

from daq.errors import DeviceLost, InstrumentAbsent, InstrumentRefused, InstrumentSilent
from drivers.manual.settings import ManualSettings

_ANSWER_S = 2.0
_SAID_S = 0.5
_LONGEST = 256  # bytes of an answer
REST = "rest"
STOP = "BY HAND NOW: bring the rig to rest, and switch off what drives it"


class ManualActuator:
    """An `Actuator` whose safe state is a person's doing: `off` asks for it and cannot see it.

    It does so once after anything was asked for, and with `off_first`, a supervisor's, once in any case; that
    one raises then, for nothing shows it that the rig rests.

    A person reads what is asked on standard error, by threads of its own, for a terminal may hang; an
    emulated one gets it as a line of a word and numbers in SI over a socket, and answers ok. For any thread.
    """

    def __init__(self, settings: ManualSettings, off_first: bool = False) -> None:
        self.settings, self._moves, self._unseen = settings, off_first, off_first
        self._saying: threading.Thread | None = None
        self.name = settings.name
        self.address = settings.person or "the rig"
        self.identity = "an emulated person" if settings.person else "a person"
        self._line: socket.socket | None = None
        self._turn = threading.Lock()

    def open(self) -> None:
        """Find the emulated person; a real one is there."""
        if not self.settings.person:
            return
        host, _, port = self.settings.person.rpartition(":")
        try:
            self._line = socket.create_connection((host, int(port)), _ANSWER_S)
        except OSError as error:
            raise InstrumentAbsent(self.name, self.address, f"{error}", "rattle emulate") from error

    def close(self) -> None:
        """Hang up. Never raises."""
        if self._saying is not None:
            self._saying.join(_SAID_S)  # a process that ends now would take it with it
        if self._line is not None:
            line, self._line = self._line, None
            with suppress(OSError):
                line.close()

    def off(self) -> None:
        if self._moves:
            self.ask(STOP, REST)
            self._moves = False
        if self._unseen:
            what = "rest was asked for, and nothing shows that it came"
            raise InstrumentRefused(self.name, self.address, what, "the rig itself: STOP IT BY HAND")

    def ask(self, words: str, *order: object) -> None:
        """Ask a person for it in words, an emulated one by an order."""
        self._moves = True
        if self.settings.person:
            self._tell(" ".join(map(str, order)))
        else:
            self._saying = threading.Thread(target=_say, args=(words, self._saying), daemon=True)
            self._saying.start()

    def _tell(self, order: str) -> None:
        with self._turn:
            if (line := self._line) is None:
                return
            try:
                line.sendall(f"{order}\n".encode())
                answer = line.recv(_LONGEST)
            except TimeoutError as error:
                raise InstrumentSilent(self.name, self.address, f"no answer to {order}") from error
            except OSError as error:
                raise DeviceLost(self.name, self.address, f"the connection is lost ({error})") from error
        if answer != b"ok\n":
            raise DeviceLost(self.name, self.address, f"it answers {answer!r} to {order}")


def _say(words: str, before: threading.Thread | None) -> None:
    if before is not None:
        before.join()  # an order that is read after the one to stop would be obeyed
    with suppress(OSError, ValueError):
        print(f"\a{words}" if words == STOP else words, file=sys.stderr, flush=True)
