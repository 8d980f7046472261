"""An FR-D700 without its hardware: registers, ramps, communication watchdog, trips.

Behaviour after the FR-D700 Instruction Manual (Applied), IB(NA)-0600366ENG, section 4.19, as far as it could
be had; what is known from other manuals of the family or from memory (M) is marked.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from typing import Protocol

from pymodbus.constants import ExcCodes

from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.registers import Command, Status, Terminal
from drivers.mitsubishi_fr.settings import RAMPS_WITHDRAWN
from drivers.protocols.speed_drive import MotorLoad, MotorOutput
from drivers.rehearsal import Rehearsed

# Raw values. Pr.3 to 6 are those of the manual's example of a read; the rest is as rattle needs it.
PARAMETERS = {
    1: 12000,  # maximum frequency, 0.01 Hz
    2: 0,
    3: 6000,
    4: 6000,
    5: 3000,
    6: 1000,
    7: 50,  # acceleration and deceleration, 0.1 s (M)
    8: 50,
    20: 6000,  # to which those times are
    79: 0,  # operation mode is chosen over the line
    117: 1,
    118: 192,  # baud / 100
    119: 1,
    120: 2,  # even parity
    121: 1,
    122: 20,  # watchdog, 0.1 s
    178: 60,  # functions of STF, STR, RL, RM and RH (M)
    179: 61,
    180: 0,
    181: 1,
    182: 2,
    250: 9999,  # ramps down once run is withdrawn (M)
    340: 1,  # in network operation from power-on
    502: 1,  # ramps down on silence
    549: 1,  # Modbus RTU
}
RUNNING_FREQUENCY_EEPROM = 40015  # kept over power-off
HIGHEST_SET_FREQUENCY = 40000  # 400.00 Hz
WATCHDOG_OFF = 9999  # of Pr.122
RAMP_ON_SILENCE = 1
_NO_RAMP_HZ_PER_S = 1e6  # where Pr.7 or Pr.8 is 0
_VOLTS_PER_HZ = 200.0 / 60.0  # constant V/f: 200 V at 60 Hz
NO_TERMINAL = Terminal(0)
_MODES = {0x10: 0, fr.CHOOSE_PANEL: fr.PANEL_MODE, fr.CHOOSE_NETWORK: fr.NETWORK_MODE}


@dataclass(frozen=True, slots=True)
class DriveFaults:
    """What is wrong with the drive itself.

    `not_obeyed`: registers (manual numbers) whose writes are acknowledged and forgotten. `stuck`: orders are
    kept, the output stays as it is. `exceptions`: by register the Modbus exception that its next accesses are
    answered with, and how many of them. `terminals` are the inputs that are on: what is wired to them.
    """

    not_obeyed: frozenset[int] = frozenset()
    stuck: bool = False
    exceptions: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    terminals: Terminal = NO_TERMINAL


@dataclass(frozen=True, slots=True)
class InverterSetup:
    """How the drive is set (raw values by Pr. number), what is wrong with it, and what is to come.

    `stop_terminal` is the input that a contact of the emergency stop is on.
    """

    parameters: Mapping[int, int] = field(default_factory=dict)
    faults: DriveFaults = field(default_factory=DriveFaults)
    rehearsed: tuple[Rehearsed, ...] = ()
    stop_terminal: Terminal = NO_TERMINAL


class Unanswered(Exception):
    """The drive does what was asked and sends no answer."""


NO_LOAD_A = 0.6  # A; of a small motor


class OutputSink(Protocol):
    """The way to another process, or to several: a connection is one."""

    def send(self, output: MotorOutput, /) -> None:
        """Pass on what is put out; OSError where nobody is there any more."""


class FreeMotor:
    """A `MotorLoad` that turns nothing: its no-load current flows while anything is put out."""

    def __init__(self) -> None:
        self._on = False

    def drive(self, output: MotorOutput) -> None:
        self._on = output.on and (output.level > 0.0 or output.target > 0.0)

    def current_a(self) -> float:
        return NO_LOAD_A if self._on else 0.0


class RemoteLoad:
    """A `MotorLoad` in another process: outputs go to it, the last current (A, a float) that it sent counts.

    Without `currents` the current is that of a free motor.
    """

    def __init__(self, outputs: OutputSink | None, currents: Connection | None) -> None:
        self._outputs, self._currents = outputs, currents
        self._free = FreeMotor()
        self._current_a: float | None = None

    def drive(self, output: MotorOutput) -> None:
        self._free.drive(output)
        if self._outputs is not None:
            with suppress(OSError):  # the plant is gone; the drive goes on
                self._outputs.send(output)

    def current_a(self) -> float:
        with suppress(EOFError, OSError):
            while self._currents is not None and self._currents.poll():
                self._current_a = float(self._currents.recv())
        return self._free.current_a() if self._current_a is None else self._current_a


class EmulatedDrive:
    """The drive behind its line. `now` gives monotonic seconds; `load` hears of every change of the output.

    Nothing happens between calls that `settle` would not make up for, at the time when it was due. Not safe
    for several threads.
    """

    def __init__(self, setup: InverterSetup, load: MotorLoad, now: Callable[[], float]) -> None:
        self.faults, self._stop_terminal = setup.faults, setup.stop_terminal
        self._load, self._now = load, now
        self._parameters = PARAMETERS | dict(setup.parameters)
        self._set = self._eeprom = 0  # raw, 0.01 Hz
        self._run = False
        self._tripping: int | None = None  # a fault that is shown once the ramp has ended
        self._fault = 0
        self._history = [0] * len(fr.FAULTS)
        self._last_frame_s: float | None = None  # None: the watchdog has not begun to count
        self._mode = self._mode_at_start()
        self.output = MotorOutput(True, 0.0, 0.0, _NO_RAMP_HZ_PER_S, now())

    def put_faults(self, faults: DriveFaults) -> None:
        """Let something else be wrong from now on."""
        self.faults = faults
        self._follow(self._now())

    def heard_frame(self) -> None:
        """Take note of a frame, to whatever station: the watchdog begins anew (FR-A500 manual, p. 131)."""
        self.settle()
        self._last_frame_s = self._now()

    def settle(self) -> None:
        """Let happen what was due: a trip of the watchdog, the end of a ramp that followed one."""
        now_s = self._now()
        # Pr.122: the watchdog trips so long after the last frame, counted only in network operation.
        raw, due_s = self._parameters[122], math.inf
        waits = self._mode == fr.NETWORK_MODE and self._tripping is None and not self._fault
        if self._last_frame_s is not None and waits and raw != WATCHDOG_OFF:
            due_s = self._last_frame_s + fr.WATCHDOG.value(raw)
        if now_s >= due_s:
            # As Pr.502 says: 0 coasts, 1 ramps down and shows the fault at rest (M).
            self._run = False
            if self._parameters[502] == RAMP_ON_SILENCE:
                self._tripping = fr.COMMUNICATION_FAULT
                self._put_out(True, 0.0, due_s)
            else:
                self._indicate(fr.COMMUNICATION_FAULT, due_s)
        if self._tripping is not None and now_s >= self.output.settled_s:
            self._indicate(self._tripping, self.output.settled_s)

    def trip(self, code: int) -> None:
        """Trip now, with any code but that of the watchdog: the output is off at once."""
        self._indicate(code, self._now())

    def press_stop(self) -> None:
        """Press the emergency stop, of whose chain the drive shows a contact alone."""
        self.faults = replace(self.faults, terminals=self.faults.terminals ^ self._stop_terminal)

    def access(self, first: int, count: int, values: Sequence[int] | None) -> list[int] | ExcCodes:
        """Read `count` registers from the manual's number `first` on, or write `values` into them.

        One that it lacks beside one that it has is no error and reads 0 (800-series manual, 4.5.15). Raises
        `Unanswered`.
        """
        self.settle()
        numbers = range(first, first + count)
        for number in numbers:
            code, left = self.faults.exceptions.get(number, (0, 0))
            if left > 0:
                exceptions = {**self.faults.exceptions, number: (code, left - 1)}
                self.faults = replace(self.faults, exceptions=exceptions)
                return ExcCodes(code)  # as a test or a rehearsal wants it
        if not any(self._has(number) for number in numbers):
            return ExcCodes.ILLEGAL_ADDRESS
        if values is None:
            return [self._read(number) for number in numbers]
        for number, value in zip(numbers, values, strict=True):
            refusal = self._write(number, value)
            if refusal is not None:
                return refusal
        return []

    def _has(self, number: int) -> bool:
        parameter = number - fr.PARAMETERS
        return number in fr.REGISTERS or number == RUNNING_FREQUENCY_EEPROM or parameter in self._parameters

    def _read(self, number: int) -> int:
        if number in range(fr.FAULTS[0].number, fr.FAULTS[-1].number + 1):
            return self._history[number - fr.FAULTS[0].number]
        now_s = self._now()
        output_hz = self.output.at(now_s)
        status = Status(0)
        if self.output.on and (self._run or output_hz > 0.0):
            status |= Status.RUNNING | Status.FORWARD
            if self._run and now_s >= self.output.settled_s:
                status |= Status.UP_TO_FREQUENCY
        if self._fault:
            status |= Status.FAULT | Status.FAULT_OUTPUT
        readings: dict[int, Callable[[], float]] = {
            fr.STATUS_AND_COMMAND.number: lambda: int(status),
            fr.OPERATION_MODE.number: lambda: self._mode,
            fr.RUNNING_FREQUENCY.number: lambda: self._set,
            RUNNING_FREQUENCY_EEPROM: lambda: self._eeprom,
            fr.OUTPUT_FREQUENCY.number: lambda: output_hz / fr.OUTPUT_FREQUENCY.scale,
            fr.OUTPUT_CURRENT.number: lambda: self._load.current_a() / fr.OUTPUT_CURRENT.scale,
            fr.OUTPUT_VOLTAGE.number: lambda: output_hz * _VOLTS_PER_HZ / fr.OUTPUT_VOLTAGE.scale,
            fr.INPUT_TERMINALS.number: lambda: self.faults.terminals,
        }
        if number in readings:
            return min(max(round(readings[number]()), 0), 0xFFFF)
        return self._parameters.get(number - fr.PARAMETERS, 0)

    def _write(self, number: int, value: int) -> ExcCodes | None:
        if not self._has(number) or number in self.faults.not_obeyed:
            return None
        if number >= fr.PARAMETERS:
            if self._mode != fr.NETWORK_MODE or self._run:
                return ExcCodes.ILLEGAL_VALUE
            self._parameters[number - fr.PARAMETERS] = value
            return None
        if number == RUNNING_FREQUENCY_EEPROM:
            self._eeprom = value
        writers: dict[int, Callable[[int], ExcCodes | None]] = {
            fr.INVERTER_RESET.number: self._reset,
            fr.STATUS_AND_COMMAND.number: self._take_command,
            fr.OPERATION_MODE.number: self._take_mode,
            fr.RUNNING_FREQUENCY.number: self._take_frequency,
            RUNNING_FREQUENCY_EEPROM: self._take_frequency,
        }
        return writers[number](value) if number in writers else ExcCodes.ILLEGAL_ADDRESS

    def _reset(self, value: int) -> ExcCodes | None:
        """Restart the inverter: the output goes off, a fault is forgotten, its history is not."""
        self._fault, self._tripping, self._run = 0, None, False
        self._set, self._mode, self._last_frame_s = self._eeprom, self._mode_at_start(), None
        self._put_out(True, 0.0, self._now())
        raise Unanswered

    def _take_command(self, value: int) -> ExcCodes | None:
        if self._mode != fr.NETWORK_MODE:
            return ExcCodes.ILLEGAL_VALUE
        command, now_s = Command(value), self._now()
        if command & Command.OUTPUT_SHUT_OFF:
            self._run = False
            self._put_out(False, 0.0, now_s)
            return None
        ran = self._run
        self._run = bool(command & Command.FORWARD) and not self._fault and self._tripping is None
        if ran and not self._run and self._parameters[250] not in RAMPS_WITHDRAWN:
            self._put_out(False, 0.0, now_s)
        self._follow(now_s)
        return None

    def _take_mode(self, value: int) -> ExcCodes | None:
        if value not in _MODES or self.output.at(self._now()) > 0.0:
            return ExcCodes.ILLEGAL_VALUE
        # The watchdog counts from the first message in network operation.
        if _MODES[value] != self._mode:
            self._mode, self._last_frame_s = _MODES[value], None
        return None

    def _take_frequency(self, value: int) -> ExcCodes | None:
        if self._mode != fr.NETWORK_MODE or value > HIGHEST_SET_FREQUENCY:
            return ExcCodes.ILLEGAL_VALUE
        self._set = value
        self._follow(self._now())
        return None

    def _follow(self, now_s: float) -> None:
        """Let the output go to where it is told to, unless a fault forbids it."""
        if self._fault or self._tripping is not None or self.faults.stuck:
            return
        highest = self._parameters[1]
        target_hz = min(self._set, highest) * fr.RUNNING_FREQUENCY.scale if self._run else 0.0
        if (self._run and not self.output.on) or target_hz != self.output.target:
            self._put_out(True, target_hz, now_s)

    def _put_out(self, on: bool, target_hz: float, at_s: float) -> None:
        from_hz = self.output.at(at_s) if on else 0.0
        # Pr.7 and Pr.8 are the times from 0 to Pr.20 and back: a ramp has the slope, not the time.
        ramp = fr.ACCELERATION_TIME if target_hz > from_hz else fr.DECELERATION_TIME
        time_s = ramp.value(self._parameters[ramp.number - fr.PARAMETERS])
        reference_hz = fr.RAMP_REFERENCE.value(self._parameters[20])
        slope = reference_hz / time_s if time_s > 0.0 else _NO_RAMP_HZ_PER_S
        self.output = MotorOutput(on, from_hz, target_hz, slope, at_s)
        self._load.drive(self.output)

    def _indicate(self, code: int, at_s: float) -> None:
        self._run, self._tripping, self._fault = False, None, code
        # Newest first; eight are kept.
        self._history = [code, *self._history[:-1]]
        self._put_out(False, 0.0, at_s)

    def _mode_at_start(self) -> int:
        return fr.NETWORK_MODE if self._parameters[340] in (1, 10) else fr.PANEL_MODE
