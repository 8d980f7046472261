"""The shaft of an emulated crank: its angle as a function of time, from what turns it has put out.

Every process that shows the shaft computes it from the same outputs and gets the same angle.
"""

from __future__ import annotations

import math
import select
import threading
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from typing import Final

import numpy as np

from drivers.protocols.speed_drive import MotorOutput
from sim_twin.rigs.crank_drive import SpeedDrive, angle_after

STEP_S: Final = 0.01
"""On a ramp the speed is constant for as long; the angle is off by less than 0.3 mrad from an even ramp."""
COAST_RAD_S2: Final = 5.0
"""How fast friction slows a shaft that nobody turns."""
_MOST_SLIP: Final = 0.03


@dataclass(frozen=True, slots=True)
class EmulatedMotor:
    """What turns the shaft: `rad_s_per_level` of output (Hz, V), in truth.

    Within a revolution the speed goes as that of `shape`, which turns at 1 rad/s. Before the first output the
    shaft stands at `start_angle` rad.
    """

    rad_s_per_level: float
    shape: SpeedDrive
    start_angle: float = 0.0


def drawn_motor(
    rpm_per_hz: float, shape: SpeedDrive, seed: int, run_seed: int, healthy: bool = True
) -> EmulatedMotor:
    """A motor with the slip of the rig's draw, its shaft wherever this run finds it."""
    slip = np.random.default_rng([seed, 2]).uniform(0.0, _MOST_SLIP) if healthy else 0.0
    angle = np.random.default_rng([seed, 3, run_seed]).uniform(0.0, math.tau)
    return EmulatedMotor(rpm_per_hz * math.tau / 60.0 * (1.0 - slip), replace(shape, speed=1.0), angle)


@dataclass(frozen=True, slots=True)
class SpeedChange:
    """From `time_s` (monotonic clock), at `angle` rad, the shaft turns as `drive` says."""

    time_s: float
    angle: float
    drive: SpeedDrive


@dataclass(frozen=True, slots=True)
class _Stretch:
    """From `start_s` on the speed goes in steps from `first` to `last` rad/s within `span_s`, then stays.

    `turned` is how far the shaft had come, in rad as if it ran smoothly.
    """

    start_s: float
    turned: float = 0.0
    first: float = 0.0
    last: float = 0.0
    span_s: float = 0.0

    @property
    def steps(self) -> int:
        return math.ceil(self.span_s / STEP_S)

    def step_at(self, time_s: float) -> int:
        """The step that `time_s` lies in; `steps` after the ramp."""
        if time_s >= self.start_s + self.span_s:
            return self.steps
        return int((time_s - self.start_s) / self.span_s * self.steps)

    def step_s(self, k: int) -> float:
        return self.start_s + self._share(k) * self.span_s

    def speed_in(self, k: int) -> float:
        """The mean of an even ramp over step `k`."""
        return self.last if k >= self.steps else self._between((k + 0.5) / self.steps)

    def turned_at(self, time_s: float) -> float:
        k = self.step_at(time_s)
        before = self._between(0.5 * self._share(k)) * self._share(k) * self.span_s
        return self.turned + before + self.speed_in(k) * (time_s - self.step_s(k))

    def _share(self, k: int) -> float:
        return k / self.steps if self.steps else 0.0

    def _between(self, share: float) -> float:
        return self.first + (self.last - self.first) * share


_ALWAYS_S: Final = -1e12


class ShaftCourse:
    """The shaft over all time, as far as the outputs go that it has heard of; they come in their order.

    Hearing an output again changes nothing.
    """

    def __init__(self, motor: EmulatedMotor) -> None:
        self._motor = motor
        self._stretches = [_Stretch(_ALWAYS_S)]

    def hear(self, output: MotorOutput) -> None:
        """Follow an output from its beginning on; whatever was to come then is forgotten."""
        while self._stretches[-1].start_s >= output.started_s:
            self._stretches.pop()
        before, at_s = self._stretches[-1], output.started_s
        if output.on:
            per_level = self._motor.rad_s_per_level
            first, last = output.level * per_level, output.target * per_level
            span_s = output.settled_s - at_s
        else:
            first, last = before.speed_in(before.step_at(at_s)), 0.0
            span_s = first / COAST_RAD_S2
        self._stretches.append(_Stretch(at_s, before.turned_at(at_s), first, last, span_s))

    def angle(self, time_s: float) -> float:
        """Angle in rad at `time_s` (monotonic clock), not wrapped."""
        turned = self._at(time_s).turned_at(time_s)
        return angle_after(self._motor.shape, self._motor.start_angle, turned)

    def turning_at(self, time_s: float) -> SpeedChange:
        stretch = self._at(time_s)
        return self._change(time_s, stretch.speed_in(stretch.step_at(time_s)))

    def changes(self, after_s: float, until_s: float) -> Iterator[SpeedChange]:
        """The steps of the last output that begin after `after_s`, and not after `until_s`."""
        stretch = self._stretches[-1]
        for k in range(stretch.step_at(max(after_s, stretch.start_s)) + 1, stretch.steps + 1):
            if stretch.step_s(k) > until_s:
                return
            if stretch.step_s(k) > after_s:
                yield self._change(stretch.step_s(k), stretch.speed_in(k))

    def _at(self, time_s: float) -> _Stretch:
        later = bisect_right(self._stretches, time_s, key=lambda stretch: stretch.start_s)
        return self._stretches[max(later - 1, 0)]

    def _change(self, time_s: float, speed: float) -> SpeedChange:
        return SpeedChange(time_s, self.angle(time_s), replace(self._motor.shape, speed=speed))


class LinkedShaft:
    """A shaft that asks at every look what has come through `outputs` since; any thread may look.

    `initial` is what is put out where nobody tells.
    """

    def __init__(
        self, motor: EmulatedMotor, outputs: Connection | None = None, initial: MotorOutput | None = None
    ) -> None:
        self._course, self._outputs = ShaftCourse(motor), outputs
        self._poll = select.poll()
        if outputs is not None:
            self._poll.register(outputs, select.POLLIN)
        self._looking = threading.Lock()
        if initial is not None:
            self._course.hear(initial)

    def __call__(self, time_s: float) -> float:
        with self._looking:
            try:
                # Not the connection's own poll: it makes a selector each time.
                while self._outputs is not None and self._poll.poll(0):
                    self._course.hear(self._outputs.recv())
            except (EOFError, OSError):  # the inverter is gone; its output stays as it was
                self._outputs = None
            return self._course.angle(time_s)
