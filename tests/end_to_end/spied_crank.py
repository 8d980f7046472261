"""A crank's instruments in processes of the test's own: it hears its drive, spoils its line, kills any."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.canopen_cia406.emulator.process import EncoderSetup, start_encoder
from drivers.emulator_process import DriveLink, EmulatedInstrument, Fork
from drivers.mitsubishi_fr.emulator.drive import DriveFaults
from drivers.mitsubishi_fr.emulator.process import InverterWiring, matching_setup, start_inverter
from drivers.mitsubishi_fr.settings import InverterSettings
from drivers.ni_daq.emulator.process import start_daq_card
from drivers.ni_daq.emulator.wiring import CardWiring, CounterWire, Wire
from drivers.protocols.emergency_stop import StopLine
from drivers.protocols.speed_drive import MotorOutput
from drivers.scpi.emulator.process import start_dc_supply
from rig.twin.shaft import EmulatedMotor, LinkedShaft, ShaftCourse
from sim_twin.rigs.crank_drive import SpeedDrive
from tests.end_to_end.command import await_true
from tests.end_to_end.files import forget_stop

RPM, RPM_PER_LEVEL, RAMP_S, WATCHDOG_S = 300.0, 5.0, 1.0, 2.0
"""A level is a hertz of the inverter, or a volt of the supply."""
SETTINGS = InverterSettings(RPM_PER_LEVEL, 350.0)
MOTOR = EmulatedMotor(RPM_PER_LEVEL * math.tau / 60.0, SpeedDrive(1.0))
WATCHDOG, STOP_SELECTION = 122, 250
_POINT_S = 0.002
STRIKE = 150.0
"""N or m/s^2, on an input of the card that the bench file leaves out."""

SCENARIO = f"""\
name = "tested crank"
rig = "planar_slider_crank"
[drive]
speed = "{RPM:g} rpm"
[acquisition]
sample_rate = "10.24 kHz"
settle = "1 s"
duration = "30 s"
"""
INVERTER = f"""\
[inverter]
driver = "mitsubishi_fr"
port = "{{address}}"
rpm_per_hz = {RPM_PER_LEVEL}
maximum_speed = "350 rpm"
"""
SUPPLY = f"""\
[dc_supply]
resource = "{{address}}"
rpm_per_volt = {RPM_PER_LEVEL}
maximum_speed = "350 rpm"
maximum_current = "3 A"
ramp = "{RAMP_S:g} s"
"""
BENCH = """\
[daq_card]
grpc = "{card}"
[[daq_card.channels]]
name = "crank.angle"
physical = "cDAQ1Mod3/ctr0"
kind = "encoder"
pulses_per_revolution = 1024
decoding = "x4"
index = true
[[daq_card.channels]]
name = "crank.marker"
physical = "cDAQ1Mod1/ai0"
kind = "marker"
range = "10 V"
[encoder]
interface = "socketcand"
host = "{host}"
port = {port}
channel = "can0"
node = 7
"""


@dataclass
class TurningPlant:
    """A shaft that follows the inverter; `slips_after_s` a steady output it falls to four fifths of it.

    Its frame shows `STRIKE` once the file `struck` is there.
    """

    slips_after_s: float = math.inf
    struck: Path | None = None
    channels: tuple[str, ...] = ("crank.angle", "crank.marker", "struck")
    _course: ShaftCourse = field(default_factory=lambda: ShaftCourse(MOTOR))
    _rate: float = 1.0
    _made: int = 0
    _start_s: float | None = None
    _steady_s: float = math.inf
    _lost_rad: float = 0.0

    def start(self, sample_rate: float) -> None:
        self._rate, self._made = sample_rate, 0

    def drive(self, output: MotorOutput, at_sample: float) -> None:
        self._start_s = output.started_s - at_sample / self._rate
        self._steady_s = output.settled_s if output.target > 0.0 else math.inf
        self._course.hear(output)

    def advance(self, count: int) -> NDArray[np.float64]:
        samples = self._made + np.arange(count)
        self._made += count
        struck = np.full(count, STRIKE if self.struck and self.struck.exists() else 0.0)
        if self._start_s is None:
            angle = np.zeros(count)
        else:
            times = self._start_s + samples / self._rate
            points = np.arange(times[0], times[-1] + _POINT_S, _POINT_S)
            angle = np.interp(times, points, [self._course.angle(float(at)) for at in points])
            slipping = np.maximum(times - self._steady_s - self.slips_after_s, 0.0)
            lost = 0.2 * RPM * math.tau / 60.0 * slipping
            self._lost_rad = max(self._lost_rad, float(lost[-1]))
            angle = angle - np.maximum(lost, self._lost_rad if lost[-1] == 0.0 else 0.0)
        return np.stack([angle, 5.0 * (np.mod(angle, math.tau) < 0.1), struck])


@dataclass(frozen=True, slots=True)
class Made:
    """Makes the plant in the card's process."""

    slips_after_s: float
    struck: Path | None

    def __call__(self) -> TurningPlant:
        return TurningPlant(self.slips_after_s, self.struck)


class MotorSpy:
    """Hears every change of what turns the motor."""

    def __init__(self, receiver: Connection) -> None:
        self.heard: list[MotorOutput] = []
        self.heard_ns: list[int] = []
        self._receiver = receiver
        self._thread = threading.Thread(target=self._listen, name="motor spy", daemon=True)
        self._thread.start()

    @property
    def runs(self) -> bool:
        return bool(self.heard) and self.heard[-1].on and self.heard[-1].target > 0.0

    @property
    def moved(self) -> bool:
        return any(output.target > 0.0 for output in self.heard)

    def await_stopping(self) -> None:
        """Wait until it was told, or tripped, to come to rest; what it puts out then ends on its ramp."""
        await_true("motor stops", lambda: self.moved and not self.runs, 15.0)

    def _listen(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                output = self._receiver.recv()
                self.heard_ns.append(time.time_ns())
                self.heard.append(output)

    def join(self) -> None:
        self._thread.join()


@dataclass(frozen=True, slots=True)
class SpiedCrank:
    """Scenario and bench file of real instruments, the instruments, and what the motor heard."""

    scenario: Path
    file: Path
    actuator: EmulatedInstrument
    card: EmulatedInstrument
    encoder: EmulatedInstrument
    spy: MotorSpy
    rehearsal: Connection
    stop: StopLine | None

    def press(self) -> None:
        """Open the line of its emergency stop."""
        assert self.stop is not None
        self.rehearsal.send(DriveFaults() if self.stop.terminal else {self.stop.line: False})


@contextmanager
def spied_crank(
    folder: Path,
    slips_after_s: float = math.inf,
    encoder: EncoderSetup | None = None,
    stop: str = "",
    struck: Path | None = None,
    watchdog_s: float = WATCHDOG_S,
    by_supply: bool = False,
    coasts: bool = False,
) -> Iterator[SpiedCrank]:
    """A crank's bench without physics but for its shaft, and a strike at its frame.

    `stop` is the line of an emergency stop; `by_supply`, a DC supply turns it and no inverter, which by its
    Pr.250 lets it coast once run is withdrawn, if it `coasts`.
    """
    line = StopLine(stop) if stop else None
    on_card = line is not None and not line.terminal
    wiring = CardWiring(
        {
            "cDAQ1Mod1/ai0": Wire("crank.marker", 1.0, range_v=10.0),
            "cDAQ1Mod1/ai1": Wire("struck", 0.05 / 9.80665),
        },
        counters={"cDAQ1Mod3/ctr0": CounterWire("crank.angle", 1024)},
        lines={stop: True} if on_card else {},
    )
    setup = matching_setup(replace(SETTINGS, stop_line=None if on_card else line), RAMP_S)
    parameters = {**setup.parameters, WATCHDOG: round(watchdog_s * 10)}
    if coasts:
        parameters[STOP_SELECTION] = 0
    rehearsal, ordered = get_context("spawn").Pipe()
    with DriveLink.new() as spied, DriveLink.new() as shown, DriveLink.new() as sensed:
        fork = Fork((spied.sender, shown.sender, sensed.sender))
        if by_supply:
            actuator = start_dc_supply(fork)
        else:
            actuator = start_inverter(
                InverterWiring(fork, None, None if on_card else ordered),
                replace(setup, parameters=parameters),
            )
        card = start_daq_card(
            Made(slips_after_s, struck), wiring, shown.receiver, rehearsal=ordered if on_card else None
        )
        ordered.close()
        sensor = start_encoder(partial(LinkedShaft, MOTOR, sensed.receiver), encoder)
        spied.sender.close()
        spy = MotorSpy(spied.receiver)
        host, _, port = sensor.address.rpartition(":")
        text = (SUPPLY if by_supply else INVERTER).format(address=actuator.address)
        text += BENCH.format(card=card.address, host=host, port=port)
        if line is not None:
            text += f'[emergency_stop]\nline = "{line.line}"\n'
        scenario, bench = folder / "scenario.toml", folder / "bench.toml"
        scenario.write_text(SCENARIO)
        bench.write_text(re.sub(r"valid_until = 2036", "valid_until = 2096", text))
        try:
            yield SpiedCrank(scenario, bench, actuator, card, sensor, spy, rehearsal, line)
        finally:
            for instrument in (actuator, card, sensor):
                instrument.close()
            forget_stop(actuator.address)
            rehearsal.close()
            spy.join()
