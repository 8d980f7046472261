"""The emulated rigs: twins that differ from the operator's as real rigs do, and what moves them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.protocols.generator import DriveSettings
from drivers.protocols.speed_drive import MotorOutput
from rig.twin.shaft import EmulatedMotor, ShaftCourse, SpeedChange
from sim_twin.ranges import require
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.stream import TwinStream
from sim_twin.twin import AnyTwin

if TYPE_CHECKING:
    from sim_twin.rigs.impact_beam.truth import BeamTwin


_RESTS_WITHIN = 0.9
"""Of the clearance, which varies by 2 % from run to run."""


def resting_at(believed: BeamTwin, place: float | str, seed: int) -> BeamTwin:
    """The beam whose tip really rests at `place` (m), whatever is believed; a word: drawn by `seed`.

    Raises UnphysicalParameter for a place that the draw of a healthy clearance may put outside the stops.
    """
    most = _RESTS_WITHIN * believed.rig.clearance
    share = np.random.default_rng([seed, 2]).uniform(-0.5, 0.5)
    really = share * believed.rig.clearance if isinstance(place, str) else place
    require("emulation", "rest_offset", abs(really), 0.0, most, "m")
    return replace(believed, rig=replace(believed.rig, rest_offset=really))


class _DrawnPlant:
    """A rig as it was drawn; it begins at rest with the drive off.

    `believed` is the operator's twin with the hidden effects in; `healthy` draws the rig from `seed`, and
    what is set anew for each run, each start (clearance, drive, noise), from `run_seed` as well.
    """

    def __init__(self, believed: AnyTwin, seed: int, run_seed: int, healthy: bool) -> None:
        self._believed, self._seed, self._healthy = believed, seed, healthy
        self._noise = np.random.default_rng([seed, 1, run_seed])
        self._twin = self._drawn()
        self._stream: TwinStream | None = None

    def _drawn(self) -> AnyTwin:
        if not self._healthy:
            return self._believed
        rig_draw = np.random.default_rng([self._seed, 0])
        return self._believed.model.draw_healthy(self._believed, rig_draw, self._noise)

    @property
    def channels(self) -> tuple[str, ...]:
        return self._twin.channels

    def start(self, sample_rate: float) -> None:
        if self._stream is not None:  # another run
            self._twin = self._drawn()
        self._stream = self._twin.model.stream(self._twin, sample_rate, self._noise, drive_changes=True)

    def advance(self, count: int) -> NDArray[np.float64]:
        """Next `count` samples, shape (channels, count), noise in."""
        shown = self._running.advance(count)
        if not self._healthy:
            return shown
        picked_up = np.random.default_rng([self._seed, 4])  # the rig's own share, in every block the same
        return self._twin.model.stray(self._twin, shown, picked_up)

    @property
    def _running(self) -> TwinStream:
        if self._stream is None:
            raise ValueError("the plant has not been started")
        return self._stream


_Drawn = TypeVar("_Drawn", bound=_DrawnPlant)


def compiled(kind: Callable[..., _Drawn], *drawn: Any) -> _Drawn:
    """A plant in the emulator's process, so that nobody waits for the compiler later on."""
    plant = kind(*drawn)
    plant.start(51_200.0)
    plant.advance(64)
    return plant


class ShakenPlant(_DrawnPlant):
    """A shaken rig that hears the generator's volts and gives what its sensors really show.

    `force_per_volt` in N/V is what generator, amplifier and shaker nominally make of a volt.
    """

    def __init__(
        self, believed: AnyTwin, force_per_volt: float, seed: int, run_seed: int, healthy: bool
    ) -> None:
        drive = replace(believed.drive, amplitude=1.0, frequency=1.0, offset=0.0)
        super().__init__(replace(believed, drive=drive), seed, run_seed, healthy)
        self._force_per_volt = force_per_volt

    @property
    def really(self) -> AnyTwin:
        """The rig as it was drawn; its drive is what a newton and a hertz of the bench's really are."""
        return self._twin

    def drive(self, output: DriveSettings, at_sample: float) -> None:
        per_volt = self._force_per_volt * self._twin.drive.amplitude if output.on else 0.0
        force = replace(
            self._twin.drive,
            amplitude=output.amplitude_v * per_volt,
            offset=output.offset_v * per_volt,
            frequency=output.frequency_hz * self._twin.drive.frequency,
        )
        self._running.drive(force, output.phase_rad, at_sample)


_AHEAD_SAMPLES = 64
"""The twin's sensors look ahead for less: half the length of an anti-alias filter."""


class CrankPlant(_DrawnPlant):
    """A slider-crank, which `motor` turns: hears the inverter and gives what its sensors really show."""

    def __init__(
        self, believed: AnyTwin, motor: EmulatedMotor, seed: int, run_seed: int, healthy: bool
    ) -> None:
        super().__init__(believed, seed, run_seed, healthy)
        self._standing = SpeedChange(0.0, motor.start_angle, SpeedDrive(0.0))
        self._course = ShaftCourse(motor)
        self._rate, self._made = 1.0, 0
        self._start_s, self._passed_s = 0.0, math.inf

    def start(self, sample_rate: float) -> None:
        """Start with a shaft that stands, until the first output says otherwise."""
        super().start(sample_rate)
        self._rate, self._made = sample_rate, 0
        self._start_s, self._passed_s = 0.0, math.inf
        self._turn(self._standing)

    def drive(self, output: MotorOutput, at_sample: float) -> None:
        self._start_s = output.started_s - at_sample / self._rate
        self._pass_on(output.started_s)
        self._course.hear(output)
        self._passed_s = max(output.started_s, self._time_s(self._made))
        self._turn(self._course.turning_at(self._passed_s))

    def advance(self, count: int) -> NDArray[np.float64]:
        self._made += count
        self._pass_on(self._time_s(self._made + _AHEAD_SAMPLES))
        return super().advance(count)

    def _time_s(self, sample: int) -> float:
        return self._start_s + sample / self._rate

    def _pass_on(self, until_s: float) -> None:
        for change in self._course.changes(self._passed_s, until_s):
            self._turn(change)
        self._passed_s = max(self._passed_s, until_s)

    def _turn(self, change: SpeedChange) -> None:
        at_sample = (change.time_s - self._start_s) * self._rate
        self._running.drive(change.drive, change.angle, at_sample)
