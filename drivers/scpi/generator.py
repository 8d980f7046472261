"""A function generator of the Agilent 33220A / 33500 command set."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import cycle

from daq.errors import InstrumentAbsent, InstrumentRefused
from drivers.scpi import settings
from drivers.scpi.settings import Choice, GeneratorSettings, Number, error_in, model_in

KNOWN_MODELS = re.compile(r"33210A|33220A|335\d\d[AB]|336\d\d[AB]")
LONGEST_ERROR_QUEUE = 64  # the 33220A keeps 20, the 33500 series 20
_WATCHED = (settings.OUTPUT_ON, settings.SINE, settings.FREQUENCY, settings.AMPLITUDE, settings.OFFSET)


class ScpiGenerator:
    """A `DriveGenerator` over SCPI: every setting is read back and the error queue is drained after it.

    For one thread at a time but for `off`, which any may call; a supervisor that turns the output off has one
    of its own, with `off_first`: its `open` turns the output off before anything is asked, and asks nothing.
    """

    def __init__(self, config: GeneratorSettings, off_first: bool = False) -> None:
        self.config, self._off_first = config, off_first
        self.name, self.address = config.name, config.resource
        self.identity = ""
        # VISA is loaded where a generator is made: who only names one, in a bench file, does without.
        from drivers.scpi.link import ScpiLink

        self._link = ScpiLink(config.name, config.resource, config.timeout_s)
        self._amplitude_v = self._offset_v = 0.0
        self._triggered = False
        self._kept: dict[str, Callable[[str], bool]] = {}  # by command: is an answer what was told?
        self._stopped = False
        self._watched = cycle(each.command for each in _WATCHED)  # one a call: the guard may be waiting

    def open(self) -> None:
        """Connect, check the model, and discard errors; one that drives is refused as it is."""
        self._link.open(
            f"{settings.OUTPUT_OFF.command} {settings.OUTPUT_OFF.word}" if self._off_first else ""
        )
        if self._off_first:
            return
        try:
            self.identity = self._link.query("*IDN?")
            if not KNOWN_MODELS.fullmatch(model_in(self.identity)):
                raise InstrumentAbsent(
                    self.name,
                    self.address,
                    f"{self.identity[:200]!r} answers, which is no 33210A, 33220A, 33500 or 33600",
                    "the resource string in the bench file",
                )
            self._refuse_driving()
            self._link.write("*CLS")
            self._errors()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Hang up; the output stays as it is."""
        self._link.close()

    def arm_sine(self, frequency_hz: float, amplitude_v: float, offset_v: float, *, triggered: bool) -> None:
        """Reset the generator and prepare a sine; see `DriveGenerator.arm_sine`."""
        self._check_limits(amplitude_v, offset_v)
        self._check_range(settings.FREQUENCY, frequency_hz)
        self._refuse_driving()
        self._kept.clear()
        self._stopped = False
        self._link.write("*RST")
        self._link.query("*OPC?")  # answered once the reset is done
        # The output first, so that nothing moves; load and unit before amplitudes, which depend on them.
        for choice in (settings.OUTPUT_OFF, settings.SINE, settings.OPEN_CIRCUIT, settings.PEAK_TO_PEAK):
            self._choose(choice)
        self._set(settings.FREQUENCY, frequency_hz)
        self._set(settings.AMPLITUDE, 2.0 * amplitude_v)  # peak to Vpp
        self._set(settings.OFFSET, offset_v)
        self._amplitude_v, self._offset_v, self._triggered = amplitude_v, offset_v, triggered
        if triggered:
            for choice in (*settings.TRIGGERED_BURST, settings.OUTPUT_ON):
                self._choose(choice)

    def start(self) -> None:
        self._link.hurry(settings.MOVING_S)  # before anything moves
        # A burst of infinite count that waits for its trigger: the sine begins at phase 0 with its full
        # amplitude. Turning the output on lets it begin at whatever phase it has.
        if not self._stopped and self._triggered:
            self._link.write("*TRG")
            self._refuse_on_error("trigger")
        elif not self._stopped:
            self._choose(settings.OUTPUT_ON)
        if self._stopped:  # by another thread, which this may have overtaken
            self.off()
            raise self._refused("it was switched off while it was to start")

    def set_frequency(self, frequency_hz: float) -> None:
        self._set(settings.FREQUENCY, frequency_hz)

    def set_amplitude(self, amplitude_v: float) -> None:
        self._check_limits(amplitude_v, self._offset_v)
        self._set(settings.AMPLITUDE, 2.0 * amplitude_v)
        self._amplitude_v = amplitude_v

    def set_offset(self, offset_v: float) -> None:
        self._check_limits(self._amplitude_v, offset_v)
        self._set(settings.OFFSET, offset_v)
        self._offset_v = offset_v

    def check(self) -> None:
        """Ask for the next of what it was told; raises where it shows something else."""
        command = next(self._watched)
        for _ in range(2):  # it may have been turned off while it was asked
            if (kept := self._kept.get(command)) is None:
                return
            answer = self._link.query(f"{command}?")
            with suppress(ValueError):
                if kept(answer):
                    return
        raise self._refused(
            f"{command} is {answer}, which it was not told", "its panel, and who else commands it"
        )

    def off(self) -> None:
        """Turn the output off and see that it is; errors of earlier commands do not matter here."""
        self._stopped = True  # first: a `start` that is under way looks at it once more
        if not self._link.is_open:
            return
        # Safe state: nothing but the output is asked for, and errors of before stay in the queue.
        choice = settings.OUTPUT_OFF
        self._kept[choice.command] = choice.agrees
        self._link.write(f"{choice.command} {choice.word}")
        answer = self._link.query(f"{choice.command}?")
        if not choice.agrees(answer):
            raise self._refused(f"the output does not go off, it answers {answer!r}")

    def _refuse_driving(self) -> None:
        """Leave one that somebody else has drive as it is: nobody knows what hangs on it."""
        if not settings.OUTPUT_OFF.agrees(answer := self._link.query(f"{settings.OUTPUT_OFF.command}?")):
            self.close()
            raise self._refused(
                f"its output is on already (it answers {answer!r}); nothing was changed",
                "who drives with it, its panel or another program; switch it off there, by hand",
                "in use",
            )

    def _set(self, quantity: Number, value: float) -> None:
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

    def _choose(self, choice: Choice) -> None:
        self._kept[choice.command] = choice.agrees
        self._link.write(f"{choice.command} {choice.word}")
        answer = self._link.query(f"{choice.command}?")
        self._refuse_on_error(f"{choice.name} = {choice.word}")
        if not choice.agrees(answer):
            raise self._refused(f"{choice.name} = {choice.word} reads back {answer!r}")

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

    def _check_limits(self, amplitude_v: float, offset_v: float) -> None:
        self._check_range(settings.AMPLITUDE, 2.0 * amplitude_v)
        self._check_range(settings.OFFSET, offset_v)
        largest = amplitude_v + abs(offset_v)
        if largest > self.config.maximum_amplitude_v:
            raise self._refused(
                f"amplitude + |offset| = {largest:g} V is above the bench's limit of "
                f"{self.config.maximum_amplitude_v:g} V; nothing was sent",
                check="drive amplitude and the bench's maximum_amplitude",
                code="limit",
            )

    def _check_range(self, quantity: Number, value: float) -> None:
        if not quantity.allows(value):
            raise self._refused(
                f"{quantity.name} = {value:g} {quantity.unit} is outside {quantity.minimum:g} to "
                f"{quantity.maximum:g} {quantity.unit}; nothing was sent",
                code="limit",
            )

    def _refused(self, what: str, check: str = "", code: str = "") -> InstrumentRefused:
        return InstrumentRefused(self.name, self.address, what, check, code)
