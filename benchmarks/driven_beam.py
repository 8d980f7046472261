"""The emulated beam behind a generator, without wires and real time: as fast as it can be computed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from drivers.protocols.generator import DriveSettings
from rig.files.scenario import Scenario
from rig.twin.plant import ShakenPlant
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.structure import resting
from sim_twin.rigs.impact_beam.truth import BeamTwin


@dataclass(slots=True)
class DrivenBeam:
    """A drawn plant as both the generator of a `Shaker` (volts) and the beam that centring shakes (N)."""

    plant: ShakenPlant
    per_volt: float
    sample_rate: float
    name: str = "signal generator"
    address: str = "here"
    identity: str = "a plant"
    _settings: DriveSettings = field(default_factory=lambda: DriveSettings(False, 1.0, 0.0, 0.0, 0.0))
    _made: int = 0

    def open(self) -> None:
        """Begin with the drive off."""
        self.plant.start(self.sample_rate)

    def close(self) -> None:
        """Nothing is open."""

    def arm_sine(self, frequency_hz: float, amplitude_v: float, offset_v: float, *, triggered: bool) -> None:
        """Prepare a sine that `start` turns on."""
        self._settings = DriveSettings(False, frequency_hz, amplitude_v, offset_v, 0.0)

    def start(self) -> None:
        """Turn it on at phase 0."""
        self._set(replace(self._settings, on=True, phase_rad=0.0))

    def off(self) -> None:
        """Turn it off."""
        self._set(replace(self._settings, on=False))

    def set_frequency(self, frequency_hz: float) -> None:
        """Change the frequency, Hz."""
        self._set(replace(self._settings, frequency_hz=frequency_hz))

    def set_amplitude(self, amplitude_v: float) -> None:
        """Change the amplitude, V."""
        self._set(replace(self._settings, amplitude_v=amplitude_v))

    def set_offset(self, offset_v: float) -> None:
        """Change the offset, V."""
        self._set(replace(self._settings, offset_v=offset_v))

    def check(self) -> None:
        """It puts out what it was told."""

    def shake(self, amplitude: float) -> None:
        """Change the amplitude, N."""
        self.set_amplitude(amplitude / self.per_volt)

    def push(self, offset: float) -> None:
        """Change the offset, N."""
        self.set_offset(offset / self.per_volt)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.measured(seconds)

    def forces(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Upper and lower contact force of the next seconds, N."""
        found = self.measured(seconds)
        return found["contact.force_upper"], found["contact.force_lower"]

    def measured(self, seconds: float) -> dict[str, NDArray[np.float64]]:
        """Every channel over the next seconds."""
        count = round(seconds * self.sample_rate)
        phase = self._settings.phase_rad + math.tau * self._settings.frequency_hz * count / self.sample_rate
        self._settings = replace(self._settings, phase_rad=phase % math.tau)
        self._made += count
        return dict(zip(self.plant.channels, self.plant.advance(count), strict=True))

    def _set(self, settings: DriveSettings) -> None:
        self._settings = settings
        self.plant.drive(settings, float(self._made))

    @property
    def really(self) -> BeamTwin:
        """The rig as it was drawn, with the drive that a newton of the bench's really makes."""
        return self.plant.really

    def off_centre(self, offset: float) -> float:
        """Where `offset` N of the bench's holds the tip, in shares of the real clearance from the middle."""
        rig, drive = self.really.rig, self.really.drive
        return float((rig.rest_offset + resting(rig).compliance * drive.amplitude * offset) / rig.clearance)


def drawn_beam(
    scenario: Scenario, per_volt: float, seed: int, rest_offset: float | None = None
) -> DrivenBeam:
    """A healthy rig of the scenario by `seed`, opened; its tip rests at `rest_offset` (m), if given."""
    believed = twin_of(scenario)
    if rest_offset is not None:
        believed = replace(believed, rig=replace(believed.rig, rest_offset=rest_offset))
    plant = ShakenPlant(believed, per_volt, seed, seed + 1, healthy=True)
    beam = DrivenBeam(plant, per_volt, scenario.acquisition.sample_rate)
    beam.open()
    return beam
