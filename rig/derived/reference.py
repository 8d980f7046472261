"""What counts the cycles of an origin, and what its first seconds tell of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.angle.begins import Cycles
from daq.angle.crank_cycles import AngleCycles, MarkerCycles
from daq.angle.drive_cycles import DriveCycles
from daq.angle.marker import MarkTracker
from rig.derived.settings import Settings, role_of
from rig.files.scenario import Scenario
from rig.rigs import RIGS
from rig.twin.reference import reference_among
from sim_twin.rigs.channel_table import ENCODER_ANGLE, Role

_CYCLES = 3
_LEAST_S = 1.0
_LEAST_TURN = 0.05


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the scenario says of the cycles: how many a second, and how the drive is found in its channel.

    `align(values, sample rate)` gives frequency (Hz) and phase (rad), None where no drive shows.
    """

    cycle_hz: float
    align: Callable[[NDArray[Any], float], tuple[float, float] | None]

    @property
    def settle_s(self) -> float:
        """How much of a record everything is settled on."""
        return max(_LEAST_S, _CYCLES / self.cycle_hz)


def nominal_of(scenario: Scenario) -> Nominal:
    """What a scenario says."""
    table, drive = RIGS[scenario.rig].channels, scenario.drive
    reference = reference_among(table, (table.drive,))

    def align(values: NDArray[Any], sample_rate: float) -> tuple[float, float] | None:
        found = reference.align(values, sample_rate, 0, drive)
        return (found.frequency, found.phase) if found.trusted else None

    return Nominal(drive.cycle_hz, align)


def reference_of(channels: tuple[str, ...]) -> str | None:
    """The channel that counts the cycles: the encoder rather than a marker, the drive where nothing turns."""
    # of two with one role the first counts
    by_role = {role_of(name): name for name in reversed(channels) if name != ENCODER_ANGLE.name}
    return next((by_role[role] for role in (Role.ANGLE, Role.MARKER, Role.DRIVE) if role in by_role), None)


def first_look(
    reference: str, values: NDArray[np.floating], sample_rate: float, nominal: Nominal
) -> tuple[float | None, float]:
    """Rate of the cycles in Hz, None if nothing counts them, and the drive's phase in rad (0 of a crank)."""
    if role_of(reference) is Role.DRIVE:
        return nominal.align(values, sample_rate) or (None, 0.0)
    seen = (
        _angle_hz(values, sample_rate) if role_of(reference) is Role.ANGLE else _marks_hz(values, sample_rate)
    )
    return nominal.cycle_hz if seen is None else seen, 0.0


def cycles_of(reference: str, settings: Settings, sample_rate: float) -> Cycles | None:
    """What counts the cycles by the reference channel."""
    if settings.cycle_hz is None:
        return None
    if role_of(reference) is Role.DRIVE:
        return DriveCycles(sample_rate, settings.cycle_hz, settings.phase_rad)
    return AngleCycles(sample_rate) if role_of(reference) is Role.ANGLE else MarkerCycles(sample_rate)


def _angle_hz(angle: NDArray[np.floating], sample_rate: float) -> float | None:
    known = np.flatnonzero(np.isfinite(angle))
    if len(known) < 2:
        return None
    turned = (float(angle[known[-1]]) - float(angle[known[0]])) / tau
    return turned * sample_rate / int(known[-1] - known[0]) if turned > _LEAST_TURN else None


def _marks_hz(marker: NDArray[np.floating], sample_rate: float) -> float | None:
    marks, _ = MarkTracker().track(marker)
    if len(marks) < 2:
        return None
    turns = int(marks.turn[-1] - marks.turn[0])
    return float(turns * sample_rate / (marks.position[-1] - marks.position[0]))
