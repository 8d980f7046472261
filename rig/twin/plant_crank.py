"""The emulated slider-cranks: twins that differ from the operator's as real rigs do, and an inverter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.protocols.card import Plant
from drivers.protocols.speed_drive import InverterOutput
from rig.twin.shaft import EmulatedMotor, ShaftCourse, SpeedChange
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.stream import TwinStream
from sim_twin.twin import AnyTwin

_AHEAD_SAMPLES = 64
"""The twin's sensors look ahead for less: half the length of an anti-alias filter."""


@dataclass(frozen=True, slots=True)
class CrankPlantFactory:
    """Makes the plant in the emulator's process.

    `believed` is the operator's twin with the hidden effects in; `healthy` draws the rig from `seed`, and the
    noise from `run_seed` as well. `motor` turns it.
    """

    believed: AnyTwin
    motor: EmulatedMotor
    seed: int
    run_seed: int
    healthy: bool

    def __call__(self) -> Plant[InverterOutput]:
        """Draw the rig and compile its simulation."""
        plant = CrankPlant(self)
        plant.start(51_200.0)
        plant.advance(64)
        return plant


class CrankPlant:
    """A slider-crank of either kind that hears the inverter and gives what its sensors really show."""

    def __init__(self, factory: CrankPlantFactory) -> None:
        rig_draw = np.random.default_rng([factory.seed, 0])
        self._noise = np.random.default_rng([factory.seed, 1, factory.run_seed])
        believed = factory.believed
        self._model = believed.model
        self._twin = (
            self._model.draw_healthy(believed, rig_draw, self._noise) if factory.healthy else believed
        )
        self._standing = SpeedChange(0.0, factory.motor.start_angle, SpeedDrive(0.0))
        self._course = ShaftCourse(factory.motor)
        self._stream: TwinStream | None = None
        self._rate, self._made = 1.0, 0
        self._start_s, self._passed_s = 0.0, math.inf

    @property
    def channels(self) -> tuple[str, ...]:
        """Rows of `advance`."""
        return self._twin.channels

    def start(self, sample_rate: float) -> None:
        """Start with a shaft that stands, until the first output says otherwise."""
        self._stream = self._model.stream(self._twin, sample_rate, self._noise, drive_changes=True)
        self._rate, self._made = sample_rate, 0
        self._start_s, self._passed_s = 0.0, math.inf
        self._turn(self._standing)

    def drive(self, output: InverterOutput, at_sample: float) -> None:
        """Follow the inverter from `at_sample` on."""
        self._start_s = output.started_s - at_sample / self._rate
        self._pass_on(output.started_s)
        self._course.hear(output)
        self._passed_s = max(output.started_s, self._time_s(self._made))
        self._turn(self._course.turning_at(self._passed_s))

    def advance(self, count: int) -> NDArray[np.float64]:
        """Next `count` samples, shape (channels, count), noise in."""
        self._made += count
        self._pass_on(self._time_s(self._made + _AHEAD_SAMPLES))
        return self._running.advance(count)

    def _time_s(self, sample: int) -> float:
        return self._start_s + sample / self._rate

    def _pass_on(self, until_s: float) -> None:
        for change in self._course.changes(self._passed_s, until_s):
            self._turn(change)
        self._passed_s = max(self._passed_s, until_s)

    def _turn(self, change: SpeedChange) -> None:
        at_sample = (change.time_s - self._start_s) * self._rate
        self._running.drive(change.drive, change.angle, at_sample)

    @property
    def _running(self) -> TwinStream:
        if self._stream is None:
            raise ValueError("the plant has not been started")
        return self._stream
