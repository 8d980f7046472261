"""What can go wrong, one class for each reaction of the caller.

    RattleError
    +-- ConfigurationError    fix the file                     (ValueError)
    +-- UnphysicalParameter   fix the parameter                (ValueError)
    +-- SimulationFailed      change what is simulated         (ArithmeticError)
    +-- InstrumentError       look at the instrument
    |   +-- InstrumentAbsent  nobody, or somebody else, answers (ConnectionError)
    |   +-- InstrumentRefused it answered: no                   (RuntimeError)
    |   +-- InstrumentSilent  it did not answer in time         (TimeoutError)
    |   +-- DeviceLost        it went away during the run       (ConnectionError)
    +-- InterlockTripped      a limit was passed; rig is safe   (RuntimeError)
    |   +-- EmergencyStop     a person frees it and starts anew (InstrumentRefused)
    +-- LogError              the file cannot be trusted        (ValueError)
    +-- RecorderFailed        stop the rig: samples are lost    (OSError)

Each class also inherits the matching built-in, so that code that knows nothing of rattle can handle it.
"""

from __future__ import annotations

import re
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

DAMAGED = (ValueError, LookupError, ArithmeticError, RuntimeError, EOFError, OSError, MemoryError)
"""What Python raises where a file is not what it should be; who reads one adds his packages' own."""


class RattleError(Exception):
    """Anything that rattle raises on purpose."""


_Noted = TypeVar("_Noted", bound=BaseException)


def with_notes_of(error: _Noted, other: BaseException | None) -> _Noted:
    """An error that is raised in place of another, with what that one says besides."""
    for note in getattr(other, "__notes__", ()):
        if note not in getattr(error, "__notes__", ()):
            error.add_note(note)
    return error


def show_fault(error: BaseException | None) -> None:
    """Print where a fault of ours came from; words after deeds: the terminal may hang, or be gone."""
    with suppress(OSError, ValueError):
        traceback.print_exception(error)


@dataclass(frozen=True, slots=True)
class Problem:
    """One fault in a file: where, what stands there, what may stand there (with its unit)."""

    key: str
    value: str
    allowed: str

    def __str__(self) -> str:
        return f"{self.key} = {self.value}: {self.allowed}"


class ConfigurationError(RattleError, ValueError):
    """A scenario, bench or effects file is wrong; `problems` lists every fault in it at once."""

    def __init__(self, source: str, problems: Sequence[Problem]) -> None:
        self.source = source
        self.problems = tuple(problems)
        super().__init__("\n".join([f"{source}:", *(f"  {problem}" for problem in self.problems)]))


class UnphysicalParameter(RattleError, ValueError):
    """A parameter of a model that no rig can have: whose, which, its value, and what it may be."""

    def __init__(self, owner: str, name: str, value: float, allowed: str) -> None:
        self.owner, self.name, self.value, self.allowed = owner, name, value, allowed
        super().__init__(owner, name, value, allowed)

    def __str__(self) -> str:
        return f"{self.owner}: {self.name} = {self.value:g}: {self.allowed}"


class SimulationFailed(RattleError, ArithmeticError):
    """A simulation ended without a result; `advice` says what to change, `status` how a solver ended."""

    def __init__(self, what: str, advice: str, status: Enum | None = None) -> None:
        self.what, self.advice, self.status = what, advice, status
        super().__init__(what, advice, status)

    def __str__(self) -> str:
        return f"{self.what}: {self.advice}"


class InstrumentError(RattleError):
    """An instrument did not do as asked; says which, where it is, and what to check.

    `right_s` is when it was last seen to do so (s of the monotonic clock), where somebody looks.
    """

    right_s: float | None = None

    def __init__(self, instrument: str, address: str, what: str, check: str = "", code: str = "") -> None:
        self.instrument, self.address, self.what = instrument, address, what
        self.check, self.code = check, code
        text = f"{instrument} at {address}: {what}"
        super().__init__(f"{text}. Check {check}" if check else text)


class InstrumentAbsent(InstrumentError, ConnectionError):
    """Nobody answers at the address, or another model does."""


class InstrumentRefused(InstrumentError, RuntimeError):
    """The instrument answered with an error of its own (`code`)."""


class InstrumentSilent(InstrumentError, TimeoutError):
    """The instrument did not answer within its deadline."""


class DeviceLost(InstrumentError, ConnectionError):
    """The instrument went away while the rig was running."""


class InterlockTripped(RattleError, RuntimeError):
    """A channel passed its abort limit; the rig was brought to its safe state."""


class EmergencyStop(InstrumentRefused, InterlockTripped):
    """Its line is open, or cannot be read, since `at_s` (s of the monotonic clock)."""

    def __init__(self, address: str, what: str, at_s: float, check: str = "") -> None:
        self.at_s = at_s
        check = check or "that nobody is in danger, free it where it was pressed (a broken wire opens it too)"
        super().__init__("emergency stop", address, what, check, "emergency_stop")

    def __reduce__(self) -> tuple[type[EmergencyStop], tuple[str, str, float, str]]:
        return type(self), (self.address, self.what, self.at_s, self.check)

    @classmethod
    def unread(cls, address: str, what: str, at_s: float, check: str) -> EmergencyStop:
        """One whose line cannot be read, which counts as open; `check` where nobody pressed it."""
        pressed = (
            "that nobody is in danger, and whether it was pressed: an unread line counts as open. If not,"
        )
        return cls(address, what, at_s, f"{pressed} {check or 'cable and power of what reads it'}")


class LogError(RattleError, ValueError):
    """A log is damaged, truncated or not a rattle log."""


class RecorderFailed(RattleError, OSError):
    """The recorder could not keep every sample; nothing was accepted after this."""


_ACTS = re.compile(r"[^\n\t -~\xa0-\u200d\u2010-\u2027\u202f-\u2065\u206a-\ud7ff\ue000-\U0010ffff]")
"""Control characters, what turns the direction of writing, halves of characters."""


def harmless(text: str) -> str:
    """A text, which may come from a file of anybody's, as a terminal shows it and does nothing of it."""
    return _ACTS.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
