"""How the tip of an impact beam answers slow forces between its stops."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.model import ImpactBeam
from sim_twin.rigs.impact_beam.structure import Structure, structure_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RestingBeam:
    """A beam that touches nothing.

    `compliance` in m/N is what a constant force at the drive moves its tip, `frequency` in Hz its lowest
    natural frequency, `decay_s` the time in which its slowest free motion falls to 1/e.
    """

    compliance: float
    frequency: float
    decay_s: float


def resting(rig: ImpactBeam) -> RestingBeam:
    """How the tip of `rig` stands between the stops."""
    s = structure_of(rig)
    n = len(s.K)
    poles = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-s.K, -s.C]]))
    lowest = float(np.sqrt(np.linalg.eigvalsh(s.K)[0])) / (2 * pi)
    return RestingBeam(tip_response(rig, 0.0).real, lowest, float(-1.0 / poles.real.max()))


def tip_response(rig: ImpactBeam, frequency: float) -> complex:
    """Complex motion of the tip (m) for each newton of a sine of `frequency` Hz at the drive."""
    s, omega = structure_of(rig), 2 * pi * frequency
    return complex(s.contact @ np.linalg.solve(_dynamic(s, omega), s.drive))


def _dynamic(s: Structure, omega: float) -> NDArray[np.complex128]:
    return np.asarray(s.K - omega**2 * np.eye(len(s.K)) + 1j * omega * s.C)
