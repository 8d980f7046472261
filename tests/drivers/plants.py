"""Plants for the emulated card: small enough that a test knows every sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.protocols.generator import DriveSettings


@dataclass
class SinePlant:
    """Row `force` is gain * drive voltage; `acceleration` the same over a mass; `constant` is a constant."""

    gain_n_per_v: float = 3.6
    mass_kg: float = 2.0
    constant: float = 1.0
    channels: tuple[str, ...] = ("force", "acceleration", "constant")
    _rate: float = 1.0
    _next: int = 0
    _changes: list[tuple[float, DriveSettings]] = field(default_factory=list)

    def start(self, sample_rate: float) -> None:
        self._rate, self._next, self._changes = sample_rate, 0, []

    def drive(self, settings: DriveSettings, at_sample: float) -> None:
        self._changes.append((at_sample, settings))

    def advance(self, count: int) -> NDArray[np.float64]:
        samples = np.arange(self._next, self._next + count)
        volts = np.zeros(count)
        for at_sample, settings in self._changes:
            later = samples >= at_sample
            time_s = (samples[later] - at_sample) / self._rate
            sine = np.sin(settings.phase_rad + math.tau * settings.frequency_hz * time_s)
            volts[later] = (settings.offset_v + settings.amplitude_v * sine) * settings.on
        self._next += count
        force = self.gain_n_per_v * volts
        return np.stack([force, force / self.mass_kg, np.full(count, self.constant)])


@dataclass
class RampPlant:
    """Sample n of its one channel is n modulo 2^20: any loss, repeat or shift shows."""

    channels: tuple[str, ...] = ("ramp",)
    _next: int = 0

    def start(self, sample_rate: float) -> None:
        self._next = 0

    def drive(self, settings: DriveSettings, at_sample: float) -> None:
        pass

    def advance(self, count: int) -> NDArray[np.float64]:
        samples = np.arange(self._next, self._next + count)
        self._next += count
        return (samples % 2**20).astype(float)[None, :]


@dataclass
class TurningPlant(RampPlant):
    """A shaft beside the ramp: a quarter of a count of 4096 a sample, backwards after 4096 samples."""

    channels: tuple[str, ...] = ("ramp", "angle")

    def advance(self, count: int) -> NDArray[np.float64]:
        ramp = super().advance(count)[0]
        turned = np.where(ramp < 4096, ramp, 8192 - ramp) / 4.0
        return np.stack([ramp, turned * math.tau / 4096])


class BrokenPlant(RampPlant):
    """Fails after some samples."""

    def advance(self, count: int) -> NDArray[np.float64]:
        if self._next > 5000:
            raise ZeroDivisionError("a fault of the plant")
        return super().advance(count)


class NotFinitePlant(RampPlant):
    """Its solver diverged."""

    def advance(self, count: int) -> NDArray[np.float64]:
        values = super().advance(count)
        return np.where(values == 100.0, np.nan, 1.0)


class UnbuildablePlant(RampPlant):
    """Cannot be made at all."""

    def __init__(self) -> None:
        raise ValueError("no such rig")


def seen_at(settings: DriveSettings, time_s: float) -> float:
    """Return the voltage of `settings` at a time of the monotonic clock, in V."""
    phase = settings.phase_rad + math.tau * settings.frequency_hz * (time_s - settings.started_s)
    return (settings.offset_v + settings.amplitude_v * math.sin(phase)) * settings.on


def half(settings: DriveSettings) -> DriveSettings:
    """Return the settings with half the amplitude."""
    return replace(settings, amplitude_v=settings.amplitude_v / 2.0)
