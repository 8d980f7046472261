"""A motor, its inverter and its shaft in time that only passes where somebody waits."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from daq.errors import InstrumentRefused
from drivers.protocols.instrument import Notice
from drivers.protocols.speed_drive import MotorState
from tests.rig.session.fakes import FAKE

RPM_PER_HZ = 10.0
STEP_RPM = 0.01 * RPM_PER_HZ
RAMP_RPM_PER_S = 100.0
HIGHEST_RPM = 300.0


class SteppedClock:
    """Both clocks of a host, moved by `sleep` alone."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def unix_ns(self) -> int:
        return 1_800_000_000_000_000_000 + round(self.now_s * 1e9)

    def monotonic_s(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@dataclass
class FakeDrive:
    """A `SpeedDrive` whose motor slips; `shaft_rpm` is what an instrument on the shaft would show."""

    clock: SteppedClock
    slip: float = 0.0
    ripple: Callable[[float], float] = lambda _: 0.0
    stuck: bool = False
    seen: bool = True
    ramp_rpm_per_s: float = RAMP_RPM_PER_S
    name: str = "inverter"
    address: str = FAKE
    identity: str = "a fake"
    warnings: tuple[str, ...] = ()
    longest_stop_s: float = 40.0
    step_rpm: float = STEP_RPM
    busy: bool = False
    error: Exception | None = None
    told: list[tuple[object, ...]] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    _from: tuple[float, float] = (0.0, 0.0)
    _set_rpm: float = 0.0
    _run: bool = False

    @property
    def output_rpm(self) -> float:
        start_s, start_rpm = self._from
        target = self._set_rpm if self._run and not self.stuck else 0.0
        way = target - start_rpm
        return start_rpm + math.copysign(
            min(abs(way), self.ramp_rpm_per_s * (self.clock.now_s - start_s)), way
        )

    def shaft_rpm(self) -> float:
        if not self.seen:
            return math.nan
        return self.output_rpm * (1.0 - self.slip) + self.ripple(self.clock.now_s)

    @property
    def state(self) -> MotorState:
        output = self.output_rpm
        hz = output / RPM_PER_HZ
        return MotorState(self.clock.now_s, self._run, self._set_rpm, output, hz, 1.0, 100.0)

    def ramp_s(self, from_rpm: float, to_rpm: float) -> float:
        return abs(to_rpm - from_rpm) / self.ramp_rpm_per_s

    def open(self) -> None:
        self.told.append(("open",))

    def close(self) -> None:
        self.told.append(("close",))

    def arm(self, rpm: float) -> float:
        return self.set_speed(rpm)

    def set_speed(self, rpm: float) -> float:
        if rpm > HIGHEST_RPM:
            raise InstrumentRefused(self.name, self.address, "above the maximum", code="limit")
        kept = round(rpm / STEP_RPM) * STEP_RPM
        self._from = self.clock.now_s, self.output_rpm
        self._set_rpm = kept
        self.told.append(("set_speed", kept))
        return kept

    def start(self) -> None:
        self._from, self._run = (self.clock.now_s, 0.0), True
        self.told.append(("start",))

    def stop(self, measured_rpm: Callable[[], float] | None = None) -> None:
        self.told.append(("stop", measured_rpm))
        self._from, self._run = (self.clock.now_s, self.output_rpm), False

    def cut(self) -> None:
        self.told.append(("cut",))

    def read(self) -> MotorState:
        self.clock.sleep(0.06)
        return self.state

    def check(self) -> None:
        self.told.append(("check",))
        if self.error is not None:
            raise self.error

    def take_notices(self) -> tuple[Notice, ...]:
        notices, self.notices = tuple(self.notices), []
        return notices
