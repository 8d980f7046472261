"""One program at a time uses an instrument of this machine: a lock file each, which says whose it is.

The kernel frees it with the last process that holds it.
"""

from __future__ import annotations

import datetime
import fcntl
import hashlib
import os
import re
import stat
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing.reduction import DupFd
from typing import Any, Final

from daq.errors import InstrumentRefused
from drivers.protocols.instrument import HOST, by_number

FOLDERS: Final = ("/run/lock", "/tmp")  # noqa: S108 - where every user of a machine can meet; no file is followed
_DOORS: Final = re.compile(r"(,\d+)?::(502[45]::socket|((inst|hislip)\d+(,\d+)?::)?instr)$")
"""Of one instrument on a network: VXI-11, HiSLIP, and SCPI as plain lines, for people and for programs."""
_LONGEST: Final = 200  # bytes that are believed and shown of a file that anybody can write


class InstrumentLock:
    """Held until `close`, and by a process that was given it at its start until that ends."""

    def __init__(self, path: str, file: int) -> None:
        self._path, self._file = path, file

    def __getstate__(self) -> tuple[str, Any]:
        return self._path, DupFd(self._file)  # a spawned child gets the open file, and with it the lock

    def __setstate__(self, state: tuple[str, Any]) -> None:
        self._path, self._file = state[0], state[1].detach()

    def __enter__(self) -> InstrumentLock:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def fileno(self) -> int:
        return self._file

    def sign(self, doing: str = "") -> None:
        """Say who holds it, and since when."""
        since = f"{datetime.datetime.now().astimezone():%Y-%m-%d %H:%M:%S}"
        os.ftruncate(self._file, 0)  # by the open file: the path may be another's by now
        os.pwrite(self._file, f"process {os.getpid()}{doing} since {since}".encode(), 0)

    def close(self) -> None:
        """Give it back. Never raises."""
        with suppress(OSError):
            os.close(self._file)
            again = os.open(self._path, os.O_RDWR | os.O_NOFOLLOW)
            try:  # the file goes with its last holder
                fcntl.flock(again, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is_at(again, self._path):
                    os.unlink(self._path)
            finally:
                os.close(again)


class Latch:
    """What the instrument at an address is set to outlives its program, until it is set to nothing.

    It goes by every name: a serial adapter may come back as another device.

    Raises `InstrumentRefused` where it cannot be kept or read.
    """

    def __init__(self, instrument: str, address: str) -> None:
        self._instrument, self._address = instrument, address
        self._paths = [_path(name, "latch") for name in _names(address)]

    def set(self, text: str) -> None:

        def write(path: str) -> None:
            with open(_opened(path), "r+", encoding="utf-8") as file:
                file.truncate()
                file.write(text[:_LONGEST])

        with self._translated("set"), ExitStack() as every:  # also where one of them fails
            for path in self._paths:
                every.callback(write, path)

    def told(self) -> str:
        """What it is set to; empty where it is not."""
        with self._translated("read"):
            for path in filter(os.path.lexists, self._paths):
                with open(_opened(path), encoding="utf-8", errors="replace") as file:
                    if text := "".join(filter(str.isprintable, file.read(_LONGEST))):
                        return text
        return ""

    @contextmanager
    def _translated(self, doing: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            what = f"the latch of its emergency stop cannot be {doing}: {error}"
            raise InstrumentRefused(
                self._instrument, self._address, what, " and ".join(self._paths)
            ) from error


def lock(instrument: str, address: str) -> InstrumentLock:
    """Hold the instrument at an address; raises `InstrumentRefused`, which says who has it."""
    path = _path(_names(address)[-1], "lock")
    try:
        while True:
            file = _opened(path)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is_at(file, path):  # else its last holder has taken it away
                    held = InstrumentLock(path, os.dup(file))  # `file` is closed below on every way
                    held.sign()
                    return held
            except BlockingIOError:
                told = os.pread(file, _LONGEST, 0).decode(errors="replace")
                holder = "".join(filter(str.isprintable, told)) or "another program"
                check = "that program, or wait until it has ended; nothing was sent"
                raise InstrumentRefused(instrument, address, f"in use by {holder}", check, "in use") from None
            finally:
                os.close(file)
    except OSError as error:
        raise InstrumentRefused(instrument, address, f"cannot be locked: {error}", path) from error


def _path(name: str, kind: str) -> str:
    file = f"rattle-{hashlib.sha256(name.encode()).hexdigest()[:16]}.{kind}"
    return os.path.join(next(filter(_is_everybodys, FOLDERS), FOLDERS[-1]), file)


def _is_everybodys(folder: str) -> bool:
    """Whether every user may write there, not just this one: root and a user have to find the same lock."""
    with suppress(OSError):
        return bool(os.stat(folder).st_mode & stat.S_IWOTH)
    return False


def _names(address: str) -> list[str]:
    """A device and a place on the network have many names: as it is written, and last as it is now."""
    serial = re.fullmatch(r"(?:ASRL)?(/.+?)(?:::INSTR)?", address)
    if serial is not None:
        return list(dict.fromkeys([serial[1], os.path.realpath(serial[1])]))
    name = re.sub(r"^tcpip\d+", "tcpip", address.casefold())  # a board is this machine's own way there
    if HOST.match(name) is None:
        return [name]
    # an instrument has several doors; other ports may be other instruments, of a serial server
    return list(dict.fromkeys([name, _DOORS.sub("", by_number(name))]))


def _opened(path: str) -> int:
    """The file, which every user may write; never one that a link leads to."""
    how = os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK  # not to hang on a pipe that somebody put there
    while True:
        with suppress(FileNotFoundError):
            file = os.open(path, how)
            break
        with suppress(FileExistsError):  # somebody was quicker: open that one
            file = os.open(path, how | os.O_CREAT | os.O_EXCL)
            os.fchmod(file, 0o666)  # past the umask: every user of the bench has to be able to lock
            break
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise OSError("it is no plain file")
    return file


def _is_at(file: int, path: str) -> bool:
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(file), os.lstat(path))
    return False
