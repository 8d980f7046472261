"""An N6954A without its hardware: what it keeps, what it refuses, when it switches off, and what it measures.

Behaviour after the Keysight N6900/N7900 Series Operating and Service Guide (N7900-90901), chapter 6; ratings,
resolution and what the slew rate does at off are from memory (M). The motor on it takes a current of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from drivers.protocols.speed_drive import MotorOutput
from drivers.scpi.emulator.command_tree import (
    Command,
    CommandError,
    CommandTree,
    asked,
    boolean,
    number,
    single,
    told,
)
from drivers.scpi.emulator.status_reporting import StatusReporting
from drivers.scpi.supply_settings import Condition, Trouble

IDENTITY = "Keysight Technologies,N6954A,MY00000000,A.01.02.0123"
RATED_V, RATED_A = 80.0, 12.5
MOST = 1.02  # of the rating, that can be set
LSB_V = RATED_V * MOST / 2**16
FASTEST_V_PER_S = 9.9e37
MOTOR_A = 0.8
"""What the motor takes while it turns; below it the supply is at its current limit and the motor stands."""


@dataclass(frozen=True, slots=True)
class SupplyState:
    """The settings after *RST."""

    volts: float = 0.0
    amperes: float = 0.0
    protection_v: float = 1.2 * RATED_V
    slew_v_per_s: float = FASTEST_V_PER_S
    output: bool = False
    watchdog: bool = False
    watchdog_s: float = 60.0


class EmulatedN6900:
    """The instrument behind its interfaces; `listener` hears of every change of the output.

    `clock` gives monotonic seconds. Not safe for use by several threads.
    """

    def __init__(
        self,
        listener: Callable[[MotorOutput], None],
        clock: Callable[[], float],
        identity: str = IDENTITY,
        pending_errors: Sequence[int] = (),
    ) -> None:
        self._listener, self._clock, self._identity = listener, clock, identity
        self._state, self._trouble = SupplyState(), Trouble(0)
        self.status = StatusReporting(pending_errors)
        self.output = MotorOutput(False, 0.0, 0.0, 0.0, clock())
        self._heard_s = clock()
        self._tree = CommandTree(self._commands())

    def run(self, message: str) -> str | None:
        """Run a program message and return its answer, if it asked anything."""
        self.look()
        self._heard_s = self._clock()
        return self._tree.run(message, self.status.report)

    def look(self) -> None:
        """What time alone brings: its watchdog."""
        if self._on and self._state.watchdog and self._clock() - self._heard_s > self._state.watchdog_s:
            self.trip(Trouble.WATCHDOG)

    def trip(self, why: Trouble) -> None:
        """Switch off by itself, until it is cleared; the output state stays as it was programmed."""
        self._trouble |= why
        self._put_out()

    @property
    def _on(self) -> bool:
        return self._state.output and not self._trouble

    @property
    def _limited(self) -> bool:
        return self._on and self._state.volts > 0.0 and self._state.amperes < MOTOR_A

    def _commands(self) -> list[Command]:
        """What of chapter 6 turns a motor."""
        return [
            *self.status.commands(),
            Command("*IDN", answer=asked(lambda: self._identity)),
            Command("*RST", apply=told(lambda: self._keep(SupplyState(amperes=0.0102 * RATED_A)))),
            Command(
                "[SOURce:]VOLTage[:LEVel][:IMMediate][:AMPLitude]",
                self._number("volts", 0.0, MOST * RATED_V, "V"),
                lambda p: self._queried(p, self._state.volts, MOST * RATED_V),
            ),
            Command(
                "[SOURce:]VOLTage:PROTection[:LEVel]",
                self._number("protection_v", 0.0, 1.2 * RATED_V, "V"),
                self._asked("protection_v"),
            ),
            Command(
                "[SOURce:]VOLTage:SLEW[:IMMediate]",
                self._number("slew_v_per_s", 0.0, FASTEST_V_PER_S, ""),
                self._asked("slew_v_per_s"),
            ),
            Command(
                "[SOURce:]CURRent[:LEVel][:IMMediate][:AMPLitude]",
                self._number("amperes", 0.0, MOST * RATED_A, "A"),
                lambda p: self._queried(p, self._state.amperes, MOST * RATED_A),
            ),
            Command(
                "OUTPut[:STATe]",
                lambda p: self._keep(replace(self._state, output=boolean(single(p)))),
                asked(lambda: str(int(self._state.output))),
            ),
            Command("OUTPut:PROTection:CLEar", apply=told(self._clear)),
            Command(
                "OUTPut:PROTection:WDOG[:STATe]",
                lambda p: self._keep(replace(self._state, watchdog=boolean(single(p)))),
                asked(lambda: str(int(self._state.watchdog))),
            ),
            Command(
                "OUTPut:PROTection:WDOG:DELay",
                self._number("watchdog_s", 1.0, 3600.0, "S"),
                asked(lambda: str(round(self._state.watchdog_s))),
            ),
            Command("MEASure[:SCALar]:VOLTage[:DC]", answer=asked(lambda: _shown(self._measured_v))),
            Command("MEASure[:SCALar]:CURRent[:DC]", answer=asked(lambda: _shown(self._measured_a))),
            Command("STATus:OPERation:CONDition", answer=asked(lambda: str(int(self._condition)))),
            Command("STATus:QUEStionable:CONDition", answer=asked(lambda: str(int(self._trouble)))),
        ]

    @property
    def _measured_v(self) -> float:
        return self.output.at(self._clock())

    @property
    def _measured_a(self) -> float:
        if not self._on or self._state.volts == 0.0:
            return 0.0
        return min(MOTOR_A, self._state.amperes)

    @property
    def _condition(self) -> Condition:
        if not self._on:
            return Condition.OFF
        return Condition.CONSTANT_CURRENT if self._limited else Condition.CONSTANT_VOLTAGE

    def _asked(self, name: str) -> Callable[[Sequence[str]], str]:
        return asked(lambda: _shown(getattr(self._state, name)))

    def _number(self, name: str, low: float, high: float, unit: str) -> Callable[[Sequence[str]], None]:
        def keep(parameters: Sequence[str]) -> None:
            text = single(parameters)
            words = {"MIN": low, "MINIMUM": low, "MAX": high, "MAXIMUM": high}
            factors = {unit: 1.0, f"M{unit}": 1e-3} if unit else {}
            value = words[text] if text in words else number(text, factors)
            if not low <= value <= high * (1 + 1e-9):
                raise CommandError(-222)
            if name == "volts":
                value = round(value / LSB_V) * LSB_V
            self._keep(replace(self._state, **{name: value}))  # type: ignore[arg-type]

        return keep

    def _queried(self, parameters: Sequence[str], value: float, high: float) -> str:
        if not parameters:
            return _shown(value)
        return _shown({"MIN": 0.0, "MAX": high}.get(single(parameters)[:3], math.nan))

    def _clear(self) -> None:
        self._trouble = Trouble(0)
        self._put_out()

    def _keep(self, state: SupplyState) -> None:
        self._state = state
        if self._on and state.volts > state.protection_v:
            self._trouble |= Trouble.OVER_VOLTAGE
        self._put_out()

    def _put_out(self) -> None:
        now, before, state = self._clock(), self.output, self._state
        target = state.volts if self._on and not self._limited else 0.0
        if (before.on, before.target) == (self._on, target) and (
            not self._on or before.slope_per_s == state.slew_v_per_s
        ):
            return  # a plant is told nothing twice
        self.output = MotorOutput(self._on, before.at(now), target, state.slew_v_per_s, now)
        self._listener(self.output)


def _shown(value: float) -> str:
    return f"{value:+.6E}"
