"""The emulated inverter in a process of its own, set as a bench wants it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from daq.clock import SystemClock
from drivers.emulator_process import START_DEADLINE_S, EmulatedInstrument, start
from drivers.mitsubishi_fr import registers as fr
from drivers.mitsubishi_fr.emulator.drive import (
    NO_TERMINAL,
    PARAMETERS,
    DriveFaults,
    EmulatedDrive,
    InverterSetup,
    OutputSink,
    RemoteLoad,
)
from drivers.mitsubishi_fr.emulator.line_faults import LineFaults
from drivers.mitsubishi_fr.settings import NO_FUNCTION, PARITY_SETTINGS, InverterSettings
from drivers.rehearsal import Rehearsed

if TYPE_CHECKING:
    from drivers.mitsubishi_fr.emulator.server import InverterServer


STATION_PARAMETER = 117


@dataclass(frozen=True, slots=True)
class InverterWiring:
    """What an emulated inverter is joined to, by connections to other processes.

    Every change of its output (`MotorOutput`) goes to `outputs`; `currents` brings the motor current in A
    as floats; `rehearsal` brings what is to go wrong (`Rehearsed`, `LineFaults`).
    """

    outputs: OutputSink | None = None
    currents: Connection | None = None
    rehearsal: Connection | None = None


def start_inverter(
    wiring: InverterWiring | None = None,
    setup: InverterSetup | None = None,
    line: LineFaults | None = None,
    name: str = "emulated inverter",
    deadline_s: float = START_DEADLINE_S,
) -> EmulatedInstrument:
    """Start an emulated FR-D700; its addresses are ports for pyserial, TCP first, then the pty.

    On the pty only parity N can be chosen. Raises `InstrumentAbsent` where it does not start in time.
    """
    make = partial(_server, wiring or InverterWiring(), setup or InverterSetup(), line or LineFaults())
    return start(make, name, deadline_s)


def _server(wiring: InverterWiring, setup: InverterSetup, line: LineFaults) -> InverterServer:
    from drivers.mitsubishi_fr.emulator.server import InverterServer  # here, in the new process

    load = RemoteLoad(wiring.outputs, wiring.currents)
    drive = EmulatedDrive(setup, load, SystemClock().monotonic_s)
    station = {**PARAMETERS, **setup.parameters}[STATION_PARAMETER]
    return InverterServer(drive, station, line, wiring.rehearsal, setup.rehearsed)


def matching_setup(
    settings: InverterSettings, ramp_s: float, rehearsed: tuple[Rehearsed, ...] = ()
) -> InverterSetup:
    """A drive that `settings` find as they should be; from 0 to Pr.20, 60 Hz, and back it takes `ramp_s`."""
    raw = {
        fr.STATION: settings.station,
        fr.BAUDRATE: settings.baudrate // 100,
        fr.PARITY: PARITY_SETTINGS[settings.parity],
        fr.MAXIMUM_FREQUENCY: math.ceil(settings.maximum_hz / fr.MAXIMUM_FREQUENCY.scale),
        fr.ACCELERATION_TIME: fr.ACCELERATION_TIME.raw(ramp_s),
        fr.DECELERATION_TIME: fr.DECELERATION_TIME.raw(ramp_s),
    }
    terminal = on = NO_TERMINAL
    if (line := settings.stop_line) is not None:
        raw[fr.TERMINAL_FUNCTIONS[line.terminal]] = NO_FUNCTION
        terminal = fr.Terminal[line.terminal]
        on = terminal if line.healthy else NO_TERMINAL  # nobody presses it
    parameters = {register.number - fr.PARAMETERS: value for register, value in raw.items()}
    for fault in rehearsed:
        if fault.kind == "wrong_parameter":
            parameters[int(fault.number("number"))] = int(fault.number("value"))
    return InverterSetup(parameters, DriveFaults(terminals=on), rehearsed, terminal)
