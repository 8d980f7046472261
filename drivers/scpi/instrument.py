"""What all sources over SCPI share: every setting is read back, errors are drained, and off comes first."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import cycle
from typing import Protocol

from daq.errors import InstrumentAbsent, InstrumentRefused
from drivers.scpi.language import IDENTITY, MOVING_S, OUTPUT_OFF, Choice, Number, error_in, serial_in

LONGEST_ERROR_QUEUE = 64  # the 33220A keeps 20, the 33500 series 20


class SourceSettings(Protocol):
    """What a bench says of any source."""

    @property
    def name(self) -> str: ...

    @property
    def resource(self) -> str:
        """Its VISA address."""

    @property
    def timeout_s(self) -> float: ...

    @property
    def emulated(self) -> bool: ...

    @property
    def serial(self) -> str:
        """As it answers to *IDN?; empty: any will do."""


class ScpiSource:
    """An `Actuator` whose safe state is its output off; every setting is read back and its errors drained.

    For one thread at a time but for `off`, which any may call; a supervisor that turns the output off has one
    of its own, with `off_first`: its `open` turns the output off before anything is asked, and asks nothing.
    """

    def __init__(self, config: SourceSettings, watched: Sequence[str], off_first: bool = False) -> None:
        self._off_first = off_first
        self.name, self.address = config.name, config.resource
        self._serial = "" if config.emulated else config.serial  # an emulated one has none of its own
        self.identity = ""
        # VISA is loaded where a source is made: who only names one, in a bench file, does without.
        from drivers.scpi.link import ScpiLink

        self._link = ScpiLink(config.name, config.resource, config.timeout_s)
        self._kept: dict[str, Callable[[str], bool]] = {}  # by command: is an answer what was told?
        self._right_s: dict[str, float] = {}  # when it was so last, monotonic
        self._stopped = False
        self._watched = cycle(watched)  # commands, one a call: the guard may be waiting

    def known(self, identity: str) -> str:
        """What it should be where its answer to *IDN? is of another; empty where it is right."""
        raise NotImplementedError

    def open(self) -> None:
        """Connect, check model and serial number, and discard errors; one that drives is refused as it is."""
        self._link.open(f"{OUTPUT_OFF.command} {OUTPUT_OFF.word}" if self._off_first else "")
        if self._off_first:
            return
        try:
            self.identity = self._link.query(IDENTITY)
            other, check = self.known(self.identity), "the resource string in the bench file"
            if not other and self._serial not in ("", serial_in(self.identity)):
                other = f"instrument with serial number {self._serial}"
                check = "the resource string and the serial number in the bench file"
            if other:
                raise InstrumentAbsent(
                    self.name,
                    self.address,
                    f"{self.identity[:200]!r} answers, which is no {other}",
                    check,
                )
            self._link.identity = self.identity
            self._refuse_driving()
            self._link.write("*CLS")
            self._errors()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Hang up; the output stays as it is."""
        self._link.close()

    def off(self) -> None:
        """Turn the output off and see that it is; errors of earlier commands do not matter here."""
        self._stopped = True  # first: a `start` that is under way looks at it once more
        if not self._link.is_open:
            return
        # Safe state: nothing but the output is asked for, and errors of before stay in the queue.
        self._kept[OUTPUT_OFF.command] = OUTPUT_OFF.agrees
        self._link.write_at_once(f"{OUTPUT_OFF.command} {OUTPUT_OFF.word}")
        answer = self._link.query(f"{OUTPUT_OFF.command}?")
        if not OUTPUT_OFF.agrees(answer):
            raise self._refused(f"the output does not go off, it answers {answer!r}")

    def check(self) -> None:
        """Ask for the next of what it was told; raises where it shows something else."""
        self._watch(next(self._watched))

    def _watch(self, command: str) -> None:
        for _ in range(2):  # it may have been turned off while it was asked
            if (kept := self._kept.get(command)) is None:
                return
            asked_s, answer = time.monotonic(), self._link.query(f"{command}?")
            with suppress(ValueError):
                if kept(answer):
                    self._right_s[command] = asked_s
                    return
        error = self._refused(
            f"{command} is {answer}, which it was not told", "its panel, and who else commands it"
        )
        error.right_s = self._right_s.get(command)
        raise error

    def _reset(self) -> None:
        """As it was switched on, unless somebody else drives with it."""
        self._refuse_driving()
        self._kept.clear()
        self._right_s.clear()
        self._stopped = False
        self._link.write("*RST")
        self._link.query("*OPC?")  # answered once the reset is done

    def _refuse_stopped(self) -> None:
        if self._stopped:  # by another thread, which a start may have overtaken
            self.off()
            raise self._refused("it was switched off while it was to start")

    def _refuse_driving(self) -> None:
        """Leave one that somebody else has drive as it is: nobody knows what hangs on it."""
        if not OUTPUT_OFF.agrees(answer := self._link.query(f"{OUTPUT_OFF.command}?")):
            self.close()
            raise self._refused(
                f"its output is on already (it answers {answer!r}); nothing was changed",
                "who drives with it, its panel or another program; switch it off there, by hand",
                "in use",
            )

    def _set(self, quantity: Number, value: float) -> str:
        """Set it; returns what it reads back."""
        self._check_range(quantity, value)
        self._kept[quantity.command] = partial(quantity.agrees, value)
        self._link.write(f"{quantity.command} {quantity.text(value)}")
        answer = self._link.query(f"{quantity.command}?")
        self._refuse_on_error(f"{quantity.name} = {quantity.text(value)} {quantity.unit}")
        try:
            agrees = quantity.agrees(value, answer)
        except ValueError as error:
            raise self._refused(f"{quantity.name}: {error}") from error
        if not agrees:
            raise self._refused(
                f"{quantity.name} = {quantity.text(value)} {quantity.unit} reads back {answer}"
            )
        return answer

    def _choose(self, choice: Choice, until_s: float = math.inf) -> None:
        """Set it, by `until_s` (monotonic) or not at all."""
        self._kept[choice.command] = choice.agrees
        self._link.write(f"{choice.command} {choice.word}", until_s)
        answer = self._link.query(f"{choice.command}?")
        self._refuse_on_error(f"{choice.name} = {choice.word}")
        if not choice.agrees(answer):
            raise self._refused(f"{choice.name} = {choice.word} reads back {answer!r}")

    def _choose_promptly(self, asked_s: float, *choices: Choice) -> None:
        """One after the other until it is stopped, each only while the order before it is fresh.

        The first was asked for at `asked_s`, monotonic.
        """
        for choice in choices:
            if not self._stopped:  # by another thread
                until_s, asked_s = asked_s + MOVING_S, time.monotonic()
                self._choose(choice, until_s)

    def _refuse_on_error(self, setting: str) -> None:
        errors = self._errors()
        if errors:
            text = "; ".join(f"{code} {message}" for code, message in errors)
            raise self._refused(f"{setting}: {text}", code=str(errors[0][0]))

    def _errors(self) -> list[tuple[int, str]]:
        errors: list[tuple[int, str]] = []
        for _ in range(LONGEST_ERROR_QUEUE):  # one that never ends holds nobody up
            try:
                code, message = error_in(self._link.query("SYST:ERR?"))
            except ValueError as error:
                raise self._refused(str(error)) from error
            if code == 0:
                return errors
            errors.append((code, message))
        raise self._refused(f"its error queue does not end, last {errors[-1][0]} {errors[-1][1]}")

    def _check_range(self, quantity: Number, value: float) -> None:
        if not quantity.allows(value):
            raise self._refused(
                f"{quantity.name} = {value:g} {quantity.unit} is outside {quantity.minimum:g} to "
                f"{quantity.maximum:g} {quantity.unit}; nothing was sent",
                code="limit",
            )

    def _refused(self, what: str, check: str = "", code: str = "") -> InstrumentRefused:
        return InstrumentRefused(self.name, self.address, what, check, code)
