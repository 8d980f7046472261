"""Which rigs the fixed step of the lanes resolves; the others are for the exact solver."""

from __future__ import annotations

from math import pi, sqrt

from sim_twin.rigs.impact_beam.model import ImpactBeam
from sim_twin.rigs.impact_beam.structure import structure_of

_STEPS_A_PERIOD = 21.0
_DECAY_A_STEP = 0.15
_DAMPING_RATIO = 0.4
_TYPICAL_FORCE = 30.0
"""N; Hertz's law is judged by its tangent here."""


def resolves(rig: ImpactBeam, rate: float) -> bool:
    """Whether first peaks on lanes at `rate` Hz come within 0.5 % of the exact solver's.

    Measured over the catalogue's ranges: a contact needs 21 steps in a period of tip and stop, and no more
    damping than leaves its peak after its onset, where the damper makes the force jump.
    """
    mobility = float(sum(structure_of(rig).contact ** 2))
    k, c = _stiffness(rig), rig.contact_damping
    if k <= 0.0:
        return True
    steps = 2 * pi * rate / sqrt(k * mobility)
    ratio = c * sqrt(mobility / k) / 2
    return steps >= _STEPS_A_PERIOD and c * mobility / rate <= _DECAY_A_STEP and ratio <= _DAMPING_RATIO


def _stiffness(rig: ImpactBeam) -> float:
    if rig.hertz is None:
        return rig.contact_stiffness
    return float(1.5 * rig.hertz ** (2 / 3) * _TYPICAL_FORCE ** (1 / 3))
