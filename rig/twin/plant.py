"""The emulated rig: a twin that differs from the operator's as real rigs do, driven by a generator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.protocols.card import Plant
from drivers.protocols.generator import DriveSettings
from sim_twin.ranges import require
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


@dataclass(frozen=True, slots=True)
class ShakenPlantFactory:
    """Makes the plant in the emulator's process.

    `believed` is the operator's twin with the hidden effects in; `healthy` draws the rig from `seed`, and
    what is set anew for each run (clearance, drive, noise) from `run_seed` as well.
    `force_per_volt` in N/V is what generator, amplifier and shaker nominally make of a volt.
    """

    believed: AnyTwin
    force_per_volt: float
    seed: int
    run_seed: int
    healthy: bool

    def __call__(self) -> Plant[DriveSettings]:
        """Draw the rig and compile its simulation."""
        plant = ShakenPlant(self)
        plant.start(51_200.0)
        plant.advance(64)
        return plant


class ShakenPlant:
    """A shaken rig that hears the generator's volts and gives what its sensors really show."""

    def __init__(self, factory: ShakenPlantFactory) -> None:
        rig_draw = np.random.default_rng([factory.seed, 0])
        self._noise = np.random.default_rng([factory.seed, 1, factory.run_seed])
        believed = factory.believed
        unit = replace(believed, drive=replace(believed.drive, amplitude=1.0, frequency=1.0, offset=0.0))
        self._twin = unit.model.draw_healthy(unit, rig_draw, self._noise) if factory.healthy else unit
        self._force_per_volt = factory.force_per_volt
        self._stream: TwinStream | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """Rows of `advance`."""
        return self._twin.channels

    @property
    def really(self) -> AnyTwin:
        """The rig as it was drawn; its drive is what a newton and a hertz of the bench's really are."""
        return self._twin

    def start(self, sample_rate: float) -> None:
        """Start at rest with the drive off."""
        self._stream = self._twin.model.stream(self._twin, sample_rate, self._noise, drive_changes=True)

    def drive(self, output: DriveSettings, at_sample: float) -> None:
        """Follow the generator from `at_sample` on."""
        per_volt = self._force_per_volt * self._twin.drive.amplitude if output.on else 0.0
        force = replace(
            self._twin.drive,
            amplitude=output.amplitude_v * per_volt,
            offset=output.offset_v * per_volt,
            frequency=output.frequency_hz * self._twin.drive.frequency,
        )
        self._running.drive(force, output.phase_rad, at_sample)

    def advance(self, count: int) -> NDArray[np.float64]:
        """Next `count` samples, shape (channels, count), noise in."""
        return self._running.advance(count)

    @property
    def _running(self) -> TwinStream:
        if self._stream is None:
            raise ValueError("the plant has not been started")
        return self._stream
