"""Runs of the spatial slider-crank: forces at the slider's vertical sensors turn by turn, and impacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.spatial_slider_crank.model import SpatialSliderCrank
from sim_twin.rigs.spatial_slider_crank.rig import MODEL
from sim_twin.status import Status
from sim_twin.twin import Twin

Array = NDArray[np.float64]
RATE = 51_200.0
VERTICAL = ("slider.force_3", "slider.force_4", "slider.force_7", "slider.force_8")
SETTLE_TURNS = 12
_FLIGHT_S = 1e-3
_TOUCHES_N = 0.05


@dataclass(frozen=True, slots=True)
class Turns:
    """Forces in N of the vertical sensors, shape (4, turns * samples), a whole number of samples a turn."""

    forces: Array
    samples: int

    @property
    def count(self) -> int:
        """How many turns."""
        return int(self.forces.shape[1] // self.samples)

    def peaks(self, sensor: int) -> Array:
        """Largest force of each turn in N, shape (turns,)."""
        return np.asarray(self.forces[sensor].reshape(self.count, self.samples).max(axis=1))

    def peak_times(self, sensor: int) -> Array:
        """When in its turn the largest force comes, s, shape (turns,)."""
        return np.asarray(self.forces[sensor].reshape(self.count, self.samples).argmax(axis=1) / RATE)

    def impacts_a_turn(self, sensor: int) -> float:
        """Contacts that begin after at least 1 ms without force; 0.05 N, a sensor's noise, is none."""
        change = np.diff((self.forces[sensor] > _TOUCHES_N).astype(np.int8))
        begins, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
        before = np.searchsorted(ends, begins) - 1
        known = before >= 0
        return float(np.count_nonzero(begins[known] - ends[before[known]] >= _FLIGHT_S * RATE) / self.count)

    def impacts(self) -> float:
        """Impacts a turn at the sensor that sees most."""
        return max(self.impacts_a_turn(sensor) for sensor in range(len(VERTICAL)))


def run(rig: SpatialSliderCrank, speed_rpm: float, count: int) -> Turns:
    """`count` turns after the first twelve; raises SimulationFailed."""
    samples = round(60 / speed_rpm * RATE)
    drive = SpeedDrive(2 * np.pi * RATE / samples)  # whole samples a turn: off by 1e-4 at most
    truth = MODEL.truth(Twin(rig, drive), RATE, False)
    truth.change_drive(drive, 0.0, 0.0)
    rows = truth.advance(samples * (SETTLE_TURNS + count))
    if truth.status is not Status.COMPLETED:
        raise SimulationFailed(f"the spatial crank stopped at {speed_rpm:g} rpm", truth.status.advice)
    kept = [rows[rig.channels.index(name), samples * SETTLE_TURNS :] for name in VERTICAL]
    return Turns(np.array(kept), samples)
