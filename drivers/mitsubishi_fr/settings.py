"""How the inverter has to be set, and everything in which it is not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from daq.errors import InstrumentRefused, Problem
from daq.quantity import Check, Key, Quantity, Text, Whole, rule
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.registers import Register
from drivers.protocols.emergency_stop import StopLine
from drivers.protocols.instrument import misplaced

LONGEST_WATCHDOG_S = 2.0
SHORTEST_WATCHDOG_S = 0.5  # a silence that long happens on a disturbed line without anybody being gone
WATCHDOG_OFF = 9999  # raw: no time but the word for none
_STOP_LINE_POLL_S = 0.05
PARITY_SETTINGS = {"N": 0, "O": 1, "E": 2}  # Pr.120
_PROTOCOL_MODBUS = 1  # Pr.549
_STOPS = {0: "coasts", 1: "ramps down"}  # Pr.502
# Raw values of Pr.250 and of Pr.178 to 182 (M). A drive may write 9999 and 8888 as 65535 and 65520.
RAMPS_WITHDRAWN = (9999, 8888, 65535, 65520)
_COASTS_WITHDRAWN = (0, 10_000)
_MOVES = {0: "low speed", 1: "middle speed", 2: "high speed", 5: "jog", 60: "run forward", 61: "run reverse"}
NO_FUNCTION = 9999
_CANNOT_MOVE = {NO_FUNCTION: "none", 65535: "none", 7: "OH", 10: "X10", 24: "MRS"}

CHECKED = (
    fr.block(fr.MAXIMUM_FREQUENCY),
    fr.block(fr.ACCELERATION_TIME, fr.DECELERATION_TIME),
    fr.block(fr.RAMP_REFERENCE),
    fr.block(fr.STATION, fr.PARITY),
    fr.block(fr.WATCHDOG),
    fr.block(fr.STOP_SELECTION),
    fr.block(fr.OPERATION_MODE_SELECTION),
    fr.block(fr.START_MODE),
    fr.block(fr.ON_SILENCE),
    fr.block(fr.PROTOCOL),
)


def checked(wanted: InverterSettings) -> tuple[fr.Block, ...]:
    """Return what a start depends on."""
    line = wanted.stop_line
    return CHECKED if line is None else (*CHECKED, fr.block(fr.TERMINAL_FUNCTIONS[line.terminal]))


_PORT = Text(
    'a serial port or a socket of this machine, such as "/dev/ttyUSB1" or "socket://127.0.0.1:5020"',
    r"/dev/\S+|COM\d{1,3}|socket://[^\s/]+:\d{1,5}",
)
_SOCKET = "socket://"
_MOST_HZ = 400.0  # what an FR-D700 puts out at most
_BAUDRATES = (4800, 9600, 19200, 38400)  # of Pr.118, which holds a hundredth


def _reachable(inverter: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    port = inverter["port"]
    if not port and not inverter["emulated"]:
        yield "port", f"{_PORT}; or emulated = true"
    if port.startswith(_SOCKET) and (wrong := misplaced(port.removeprefix(_SOCKET))):
        yield "port", wrong


def _output_hz(inverter: Mapping[str, Any]) -> float:
    return float(inverter["maximum_speed"] / inverter["rpm_per_hz"])


@dataclass(frozen=True, slots=True)
class InverterSettings:
    """The table [inverter] of a bench: where the inverter is and how far it may go.

    `rpm_per_hz` is the crank's speed per output frequency, poles and gear together. `port` is empty where
    nobody knows it yet. It is polled every `poll_s`, given up after `silent_s` without an answer, and stopped
    when nobody has looked after the running motor for `unattended_s` (all in s); an answer may take
    `answer_s`. `parity` is E, O or N (the drive then has two stop bits). A pty takes N only: with E or O its
    second setting fails (EINVAL). `socket://` takes and ignores any parity. An emergency stop's line on
    one of its terminals, `stop_line`, is read with each poll, every 0.05 s or as fast as its answers come.
    """

    rpm_per_hz: Annotated[float, Quantity("", 0, 10_000, above=True)]
    maximum_speed_rpm: Annotated[
        float, Quantity("rpm", 0, 100_000, above=True, kept=True, key="maximum_speed")
    ]
    driver: Annotated[Literal["mitsubishi_fr"], Key()] = "mitsubishi_fr"
    port: Annotated[str, _PORT] = ""
    station: Annotated[int, Whole(1, 247)] = 1
    baudrate: Annotated[int, Whole(_BAUDRATES[0], _BAUDRATES[-1])] = 19200
    parity: Annotated[Literal["E", "O", "N"], Key()] = "E"
    answer_s: Annotated[float, Quantity("s", 0.05, 2, key="answer")] = 0.2
    poll_s: Annotated[float, Quantity("s", 0.02, 0.5, key="poll")] = 0.1
    silent_s: Annotated[float, Quantity("s", 0.2, 5, key="silent")] = 0.7
    unattended_s: Annotated[float, Quantity("s", 1, 60, key="unattended")] = 5.0
    emulated: Annotated[bool, Key()] = False
    name: str = "inverter"
    stop_line: StopLine | None = None
    CHECKS: ClassVar = (
        Check(("port", "emulated"), _reachable),
        rule(
            ("maximum_speed", "rpm_per_hz"),
            lambda inverter: _output_hz(inverter) <= _MOST_HZ,
            "maximum_speed",
            lambda inverter: (
                f"at most {_MOST_HZ:g} Hz of output, not {_output_hz(inverter):g} Hz: "
                "maximum_speed / rpm_per_hz"
            ),
        ),
        rule(
            ("baudrate",),
            lambda inverter: inverter["baudrate"] in _BAUDRATES,
            "baudrate",
            " or ".join(map(str, _BAUDRATES)),
        ),
        rule(
            ("silent", "answer"),
            lambda inverter: inverter["silent"] > inverter["answer"],
            "silent",
            "longer than answer, {answer:g} s",
        ),
    )

    @staticmethod
    def place(address: str) -> Mapping[str, Any]:
        return {"port": address}

    def at(self, address: str) -> InverterSettings:
        return replace(self, port=address)

    @property
    def period_s(self) -> float:
        """Time between two polls, s."""
        return self.poll_s if self.stop_line is None else min(self.poll_s, _STOP_LINE_POLL_S)

    @property
    def maximum_speed(self) -> float:
        """The highest speed in rad/s."""
        return self.maximum_speed_rpm * math.tau / 60.0

    @property
    def maximum_hz(self) -> float:
        """Output frequency at the highest speed."""
        return self.maximum_speed_rpm / self.rpm_per_hz


class InverterMisconfigured(InstrumentRefused):
    """The drive's parameters are not what this bench needs; `problems` lists every one of them."""

    def __init__(self, instrument: str, address: str, problems: tuple[Problem, ...]) -> None:
        self.problems = problems
        lines = "\n".join(f"  {problem}" for problem in problems)
        text = f"its settings do not fit, nothing was moved:\n{lines}\n"
        super().__init__(instrument, address, text, "these parameters at its panel, and the bench file")


@dataclass(frozen=True, slots=True)
class Parameters:
    """The checked parameters of a drive, raw, by register."""

    raw: Mapping[Register, int]

    def value(self, register: Register) -> float:
        return register.value(self.raw[register])

    @property
    def watchdog_s(self) -> float:
        """Silence after which the drive trips."""
        return self.value(fr.WATCHDOG)

    @property
    def coasts(self) -> bool:
        """Whether the motor coasts once run is withdrawn."""
        return self.raw[fr.STOP_SELECTION] not in RAMPS_WITHDRAWN

    def ramp_s(self, from_hz: float, to_hz: float) -> float:
        """Return the time of a ramp; Pr.7 and Pr.8 are the times from 0 to Pr.20 and back."""
        time = fr.ACCELERATION_TIME if to_hz > from_hz else fr.DECELERATION_TIME
        return abs(to_hz - from_hz) / self.value(fr.RAMP_REFERENCE) * self.value(time)


def problems(found: Parameters, wanted: InverterSettings) -> tuple[Problem, ...]:
    """Return every parameter with which the rig may not move."""
    equal = (
        (fr.PROTOCOL, _PROTOCOL_MODBUS, "1, Modbus RTU"),
        (fr.STATION, wanted.station, f"{wanted.station}, the station of the bench file"),
        (fr.BAUDRATE, wanted.baudrate // 100, f"{wanted.baudrate // 100}, the bench's speed / 100 bit/s"),
        (fr.PARITY, PARITY_SETTINGS.get(wanted.parity, -1), f"the bench's parity {wanted.parity}"),
        (fr.OPERATION_MODE_SELECTION, 0, "0, so that network operation can be chosen"),
    )
    wrong = [_problem(register, found, text) for register, raw, text in equal if found.raw[register] != raw]
    if found.raw[fr.START_MODE] not in (1, 10):
        wrong.append(_problem(fr.START_MODE, found, "1 or 10, network operation from power-on"))
    if found.raw[fr.ON_SILENCE] not in _STOPS:
        # What 2 and above do (ramp and then restart, run on) is known from memory of the manual only (M).
        wrong.append(_problem(fr.ON_SILENCE, found, "0 (coast) or 1 (ramp), stopped for good"))
    if found.value(fr.MAXIMUM_FREQUENCY) < wanted.maximum_hz:
        wrong.append(_problem(fr.MAXIMUM_FREQUENCY, found, f"at least {wanted.maximum_hz:g} Hz"))
    if found.raw[fr.RAMP_REFERENCE] == 0:
        wrong.append(_problem(fr.RAMP_REFERENCE, found, "1 to 400 Hz"))
    for register in (fr.ACCELERATION_TIME, fr.DECELERATION_TIME):
        if found.raw[register] == 0:
            wrong.append(_problem(register, found, "above 0 s: a ramp, no step"))
    if found.raw[fr.STOP_SELECTION] not in (*RAMPS_WITHDRAWN, *_COASTS_WITHDRAWN):
        allowed = "9999 (ramps down) or 0 s (coasts): it would turn on for so long once run is withdrawn"
        wrong.append(_problem(fr.STOP_SELECTION, found, allowed))
    if (line := wanted.stop_line) is not None:
        terminal = fr.TERMINAL_FUNCTIONS[line.terminal]
        if (function := found.raw[terminal]) not in _CANNOT_MOVE:
            has = f"{function} ({_MOVES[function]})" if function in _MOVES else str(function)
            allowed = (
                "9999 (none), 7 (OH), 10 (X10) or 24 (MRS), none of which moves it: the emergency stop's line"
            )
            wrong.append(Problem(terminal.name, has, allowed))
    return (*wrong, *_watchdog_problems(found))


def warnings(found: Parameters, wanted: InverterSettings) -> tuple[str, ...]:
    """Return what the operator should know."""
    highest_hz = found.value(fr.MAXIMUM_FREQUENCY)
    if highest_hz <= wanted.maximum_hz:
        return ()
    return (
        f"{fr.MAXIMUM_FREQUENCY.name} is {highest_hz:g} Hz, above the bench's {wanted.maximum_hz:g} Hz: "
        "rattle alone keeps the maximum speed",
    )


def described(found: Parameters, station: int) -> str:
    """Say in a line what is known of the drive."""
    stops = _STOPS[found.raw[fr.ON_SILENCE]]
    return (
        f"Mitsubishi FR, station {station}, {stops} after {found.watchdog_s:g} s of silence, "
        f"{'coasts' if found.coasts else 'ramps down'} once run is withdrawn, "
        f"ramps {found.value(fr.ACCELERATION_TIME):g} s up and {found.value(fr.DECELERATION_TIME):g} s down "
        f"to {found.value(fr.RAMP_REFERENCE):g} Hz"
    )


def _watchdog_problems(found: Parameters) -> list[Problem]:
    # Pr.122 (and Pr.539, "same specifications", FR-A700 manual p. 347): 9999 never checks; with 0 a drive
    # answers but trips in network operation; else the check begins with the first message there, and a
    # message to any station restarts it (FR-A500 manual p. 131).
    register, raw = fr.WATCHDOG, found.raw[fr.WATCHDOG]
    allowed = f"{SHORTEST_WATCHDOG_S:g} to {LONGEST_WATCHDOG_S:g} s"
    if raw == WATCHDOG_OFF:
        return [Problem(register.name, "9999 (off)", f"{allowed}: without it the motor outlives a dead PC")]
    if raw == 0:
        return [Problem(register.name, "0 (trips in network operation)", allowed)]
    if not SHORTEST_WATCHDOG_S <= found.watchdog_s <= LONGEST_WATCHDOG_S:
        return [_problem(register, found, allowed)]
    return []


def _problem(register: Register, found: Parameters, allowed: str) -> Problem:
    return Problem(register.name, f"{found.value(register):g} {register.unit}".strip(), allowed)
