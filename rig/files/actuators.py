"""The tables of a bench file that say what moves the rig."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from daq.quantity import Check, Key, Quantity, Text, Whole
from rig.files.loopback import misplaced

_VISA: Final = Text(
    'a VISA address, such as "TCPIP::192.168.0.5::5025::SOCKET"',
    r"(TCPIP\d*::.+::(SOCKET|INSTR)|ASRL.+::INSTR|USB\d*::.+::INSTR|GPIB\d*::.+::INSTR)",
)
_PORT: Final = Text(
    'a serial port or a socket of this machine, such as "/dev/ttyUSB1" or "socket://127.0.0.1:5020"',
    r"/dev/\S+|COM\d{1,3}|socket://[^\s/]+:\d{1,5}",
)
_SOCKET: Final = "socket://"
_LOOPBACK_VISA: Final = ("TCPIP::127.0.0.1::", "TCPIP0::127.0.0.1::", "TCPIP::localhost::", "ASRL")
_MOST_HZ: Final = 400.0
_BAUDRATES: Final = (4800, 9600, 19200, 38400)


@dataclass(frozen=True, slots=True)
class SignalGenerator:
    """The generator that drives the shaker's amplifier.

    `resource` is its VISA address, None when emulated; `force_per_volt` in N/V at the drive point,
    `maximum_amplitude` in N.
    """

    force_per_volt: Annotated[float, Quantity("N/V", 0.001, 1000)]
    maximum_amplitude: Annotated[float, Quantity("N", 0, 1000, above=True)]
    driver: Annotated[Literal["scpi_33220a"], Key()] = "scpi_33220a"
    resource: Annotated[str | None, _VISA] = None
    emulated: Annotated[bool, Key()] = False


@dataclass(frozen=True, slots=True)
class Inverter:
    """The inverter that turns the crank, in SI.

    `port` is None when emulated. `rpm_per_hz` is the crank's speed for each hertz of output, poles and gear
    together; `maximum_speed` in rad/s. An answer may take `answer`; it is asked every `poll`, given up after
    `silent` without an answer, and stopped when nobody has looked after it for `unattended` (all in s).
    """

    rpm_per_hz: Annotated[float, Quantity("", 0, 10_000, above=True)]
    maximum_speed: Annotated[float, Quantity("rpm", 0, 100_000, above=True)]
    driver: Annotated[Literal["mitsubishi_fr"], Key()] = "mitsubishi_fr"
    port: Annotated[str | None, _PORT] = None
    station: Annotated[int, Whole(1, 247)] = 1
    baudrate: Annotated[int, Whole(_BAUDRATES[0], _BAUDRATES[-1])] = 19200
    parity: Annotated[Literal["E", "O", "N"], Key()] = "E"
    answer: Annotated[float, Quantity("s", 0.05, 2)] = 0.2
    poll: Annotated[float, Quantity("s", 0.02, 0.5)] = 0.1
    silent: Annotated[float, Quantity("s", 0.2, 5)] = 0.8
    unattended: Annotated[float, Quantity("s", 1, 60)] = 5.0
    emulated: Annotated[bool, Key()] = False


def _generator_reachable(generator: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    resource = generator["resource"]
    if resource is None and not generator["emulated"]:
        yield "resource", "the generator's VISA address, or emulated = true"
    if generator["emulated"] and resource is not None and not resource.startswith(_LOOPBACK_VISA):
        yield "resource", "127.0.0.1 (an emulated instrument listens on loopback only)"


def _inverter_reachable(inverter: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    port = inverter["port"]
    if port is None and not inverter["emulated"]:
        yield "port", f"{_PORT.meaning}; or emulated = true"
    if port is not None and port.startswith(_SOCKET) and (wrong := misplaced(port.removeprefix(_SOCKET))):
        yield "port", wrong


def _within_its_output(inverter: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    output_hz = inverter["maximum_speed"] * 60 / math.tau / inverter["rpm_per_hz"]
    if output_hz > _MOST_HZ:
        yield (
            "maximum_speed",
            f"at most {_MOST_HZ:g} Hz of output, not {output_hz:g} Hz: maximum_speed / rpm_per_hz",
        )


def _baudrate_known(inverter: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if inverter["baudrate"] not in _BAUDRATES:
        yield "baudrate", " or ".join(map(str, _BAUDRATES))


def _patient(inverter: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    if inverter["silent"] <= inverter["answer"]:
        yield "silent", f"longer than answer, {inverter['answer']:g} s"


GENERATOR_CHECKS: Final = (Check(("resource", "emulated"), _generator_reachable),)
INVERTER_CHECKS: Final = (
    Check(("port", "emulated"), _inverter_reachable),
    Check(("maximum_speed", "rpm_per_hz"), _within_its_output),
    Check(("baudrate",), _baudrate_known),
    Check(("silent", "answer"), _patient),
)
