"""A programmable DC supply of the Keysight N6900 / N7900 command set that turns a motor."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress

from daq.clock import Clock, SystemClock
from daq.errors import InstrumentError
from drivers.protocols.instrument import Notice, Notices
from drivers.protocols.speed_drive import MotorState
from drivers.scpi import supply_settings as n6900
from drivers.scpi.instrument import ScpiSource
from drivers.scpi.language import MOVING_S, OUTPUT_OFF, OUTPUT_ON, model_in, number_in
from drivers.scpi.supply_settings import Condition, SupplySettings, Trouble

_SELDOM = (n6900.VOLTAGE.command, n6900.CURRENT.command, n6900.WATCHDOG_ON.command, n6900.CONDITION)
_LOOKS = tuple(
    look for each in _SELDOM for look in (OUTPUT_ON.command, n6900.MEASURED_V, n6900.TROUBLE, each)
)
"""One exchange a look: two might take longer than a sequence may look at nothing else."""
_JUST_NOW_S = 0.1
"""Who guards a run looks more often."""


class ScpiSupply(ScpiSource):
    """A `SpeedDrive`, and an `Actuator` at once: its stop is its output off, after which the motor coasts.

    It has no brake: a ramp down to zero volts would stop no sooner. The ramp up is the supply's slew rate.
    While it drives, its own watchdog switches it off 2 s after the last word that it heard.
    """

    warnings: tuple[str, ...] = ()

    def __init__(self, config: SupplySettings, off_first: bool = False, clock: Clock | None = None) -> None:
        super().__init__(config, _LOOKS, off_first)
        self.config, self._clock = config, clock or SystemClock()
        self.state: MotorState | None = None
        self._running = self._limited = False
        self._set_v = self._volts = self._amperes = 0.0
        self._notices = Notices(self._clock)

    @property
    def step_rpm(self) -> float:
        return n6900.RESOLUTION_V * self.config.rpm_per_volt

    @property
    def busy(self) -> bool:
        """Whether it heard or said something just now: an order is several exchanges, each with its time."""
        return time.monotonic() - self._link.last_word_s < _JUST_NOW_S

    @property
    def longest_stop_s(self) -> float:
        return self.config.longest_off_s

    def known(self, identity: str) -> str:
        return (
            "" if n6900.KNOWN_MODELS.fullmatch(model_in(identity)) else "supply of the N6900 or N7900 series"
        )

    def ramp_s(self, from_rpm: float, to_rpm: float) -> float:
        return abs(to_rpm - from_rpm) / self.config.maximum_speed_rpm * self.config.ramp_s

    def open(self) -> None:
        """Connect, and check model, ratings and what may have switched it off; moves nothing."""
        super().open()
        if self._off_first:
            return
        try:
            for what, wanted in ((n6900.VOLTAGE, self.config.maximum_v), (n6900.CURRENT, self._maximum_a)):
                most = self._number(f"{what.command}? MAX")
                if wanted > most:
                    raise self._refused(
                        f"it gives {most:g} {what.unit}, and the bench asks for {wanted:g} {what.unit}",
                        "maximum_speed, rpm_per_volt and maximum_current in the bench file",
                    )
            self._refuse_tripped(Trouble.WATCHDOG)  # which a run that died has left behind
        except BaseException:
            self.close()
            raise

    def arm(self, rpm: float) -> float:
        """Reset it, and set all that bounds the motor; its output is off."""
        self._check_speed(rpm)
        self._reset()
        self._choose(OUTPUT_OFF)
        self._set(n6900.VOLTAGE, 0.0)
        # what a watchdog has latched; the output stays off, as it has just been told
        self._link.write(n6900.CLEAR_PROTECTION)
        self._set(n6900.CURRENT, self._maximum_a)
        self._set(n6900.PROTECTION, n6900.OVER_VOLTAGE * self.config.maximum_v)
        self._set(n6900.SLEW, self.config.slew_v_per_s)
        return self.set_speed(rpm)

    def set_speed(self, rpm: float) -> float:
        self._check_speed(rpm)
        if self._stopped:  # by another thread
            raise self._refused("it was switched off")
        # in the steps that are told: what the supply itself rounds is less
        volts = round(rpm / self.config.rpm_per_volt / n6900.RESOLUTION_V) * n6900.RESOLUTION_V
        self._set(n6900.VOLTAGE, min(volts, self.config.maximum_v))
        self._set_v = volts
        self._notices.note("info", "supply.set", f"set to {volts:.2f} V")
        return volts * self.config.rpm_per_volt

    def start(self) -> None:
        asked_s = time.monotonic()
        self._link.hurry(MOVING_S)  # before anything moves
        if not self._stopped:
            self._set(n6900.WATCHDOG_DELAY, n6900.WATCHDOG_DELAY_S)
        self._running = True
        self._choose_promptly(asked_s, n6900.WATCHDOG_ON, OUTPUT_ON)
        self._refuse_stopped()
        self._notices.note(
            "info", "supply.on", f"on, set to {self._set_v:.2f} V, {self._maximum_a:g} A at most"
        )

    def off(self) -> None:
        """Turn the output off and see that it is; then its watchdog, which would disturb a person there."""
        super().off()
        self._running = False
        if self._link.is_open:
            self._kept.pop(n6900.WATCHDOG_OFF.command, None)
            with suppress(InstrumentError):
                self._link.write(f"{n6900.WATCHDOG_OFF.command} {n6900.WATCHDOG_OFF.word}")

    def stop(self, measured_rpm: Callable[[], float] | None = None) -> None:
        self.off()

    def cut(self) -> None:
        self.off()

    def read(self) -> MotorState:
        self._volts, self._amperes = self._number(n6900.MEASURED_V), self._number(n6900.MEASURED_A)
        return self._told()

    def check(self) -> None:
        """Ask for the next of what it was told or shows; raises where that is wrong, or it has tripped."""
        look, moves = next(self._watched), self._running and not self._stopped
        match look:
            case n6900.MEASURED_V | n6900.TROUBLE | n6900.CONDITION if not moves:
                return
            case n6900.MEASURED_V:
                self._volts = self._number(n6900.MEASURED_V)
                self._told()
            case n6900.TROUBLE:
                self._refuse_tripped()
            case n6900.CONDITION:
                limited = bool(self._register(n6900.CONDITION) & Condition.CONSTANT_CURRENT)
                if limited and not self._limited:
                    text = f"the motor takes all {self._maximum_a:g} A that the bench allows: is it blocked?"
                    self._notices.note("warning", "supply.current_limit", text)
                self._limited = limited
            case _:
                self._watch(look)

    def take_notices(self) -> tuple[Notice, ...]:
        return self._notices.take()

    @property
    def _maximum_a(self) -> float:
        return self.config.maximum_current

    def _check_speed(self, rpm: float) -> None:
        if not 0.0 <= rpm <= self.config.maximum_speed_rpm:
            raise self._refused(
                f"{rpm:g} rpm is outside 0 to {self.config.maximum_speed_rpm:g} rpm; nothing was sent",
                "the speed asked for and the bench's maximum_speed",
                "limit",
            )

    def _told(self) -> MotorState:
        per_volt = self.config.rpm_per_volt
        self.state = MotorState(
            at_s=self._clock.monotonic_s(),
            running=self._running,
            set_rpm=self._set_v * per_volt,
            speed_rpm=self._volts * per_volt,
            output_frequency_hz=0.0,
            output_current_a=self._amperes,
            output_voltage_v=self._volts,
        )
        return self.state

    def _refuse_tripped(self, but: Trouble | None = None) -> None:
        shown = Trouble(self._register(n6900.TROUBLE) & ~(but or 0) & sum(Trouble))
        if shown:
            raise self._refused(
                f"it has switched its output off: {shown.told}",
                "motor, cable and what it turns; clear it at the supply's panel, by hand",
                "tripped",
            )

    def _number(self, query: str) -> float:
        try:
            return number_in(self._link.query(query))
        except ValueError as error:
            raise self._refused(f"{query} is answered with what is {error}") from error

    def _register(self, query: str) -> int:
        value = self._number(query)
        if not 0.0 <= value <= 0xFFFF:
            raise self._refused(f"{query} is answered with {value:g}, which is no register of 16 bits")
        return int(value)
