"""What the truth's rig is made of: nominal values, healthy tolerances, and what one run sets anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.blind.beam.structure import MODES, Array, Beam


@dataclass(frozen=True, slots=True)
class Stop:
    """One side of the yoke: F = stiffness d**exponent + damping d', never negative, d the penetration in m.

    For effects from outside: a soft `pad` (share of the stiffness, depth in m), a `pull` in N that fades over
    `REACH`, a gap that grows by `drift` of itself in a second.
    """

    gap: float
    stiffness: float
    damping: float
    exponent: float = 1.0
    pad: tuple[float, float] | None = None
    pull: float = 0.0
    drift: float = 0.0


REACH = 10e-6


@dataclass(frozen=True, slots=True)
class Yoke:
    """The yoke's mass on spring and damper: kg, Hz, damping ratio."""

    mass: float
    frequency: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class Tone:
    """Part of the drive: amplitude in N, frequency in Hz, phase in rad at the start of the motion."""

    amplitude: float
    frequency: float
    phase: float


@dataclass(frozen=True, slots=True)
class Rig:
    """One rig in one run. `leak`: m/s2 of base acceleration for each N; `head`: Hz of the impedance head.

    For effects from outside: `second_head` (Hz, share), `cross_talk` (share), `cubic` (N/m3) and `drag`
    (N s/m) at the tip, `foreign` (a force at the drive point that is not the drive's).
    `start`: deflection of the tip at the start, m.
    """

    beam: Beam
    upper: Stop
    lower: Stop
    tones: tuple[Tone, ...]
    start: float
    leak: float
    head: float
    yoke: Yoke | None = None
    pivot_torque: float = 0.0
    foreign: tuple[Tone, ...] = ()
    cubic: float = 0.0
    drag: float = 0.0
    cross_talk: float = 0.0
    second_head: tuple[float, float] | None = None

    def force(self, t: Array) -> Array:
        """The drive's force at the times `t` in s."""
        parts = (tone.amplitude * np.sin(2 * np.pi * tone.frequency * t + tone.phase) for tone in self.tones)
        return np.asarray(sum(parts))


_BEAMS = {
    "steel": (Beam(0.28, 0.019, 0.00635, 207e9, 7800.0, flexure=0.16), 1.5e7, 20.0),
    "aluminium": (Beam(0.28, 0.019, 0.00318, 70e9, 2700.0, clamped=True), 9.6e6, 7.0),
}


def nominal(scenario: Mapping[str, Any]) -> Rig:
    """The rig that the scenario speaks of, at rest, drive from zero upwards."""
    beam, stiffness, damping = _BEAMS[scenario["beam"]]
    stop = Stop(scenario["clearance"], stiffness, damping)
    drive = Tone(scenario["amplitude"], scenario["frequency"], 0.0)
    return Rig(beam, stop, stop, (drive,), start=0.0, leak=0.0, head=700.0)


def jittered(rig: Rig, rng: np.random.Generator, wider: float = 1.0) -> Rig:
    """`rig` as a healthy one may be, of tolerances so many times `wider`."""
    beam = rig.beam
    ratios = 0.01 * _spread(rng, 0.12 * wider) * np.array([_spread(rng, 0.09 * wider) for _ in range(MODES)])
    beam = replace(
        beam,
        modulus=beam.modulus * _spread(rng, 0.01 * wider),
        density=beam.density * _spread(rng, 0.005 * wider),
        length=beam.length * _spread(rng, 0.003 * wider),
        width=beam.width * _spread(rng, 0.003 * wider),
        thickness=beam.thickness * _spread(rng, 0.003 * wider),
        damping=tuple(ratios.tolist()),
    )
    stiffness = rig.upper.stiffness * _spread(rng, 0.05 * wider)
    damping = rig.upper.damping * _spread(rng, 0.2 * wider)
    stop = replace(rig.upper, stiffness=stiffness, damping=damping)
    return replace(
        rig,
        beam=beam,
        upper=stop,
        lower=stop,
        leak=rng.uniform(0, 1e-3),
        head=rig.head * _spread(rng, 0.02 * wider),
    )


def set_up(rig: Rig, rng: np.random.Generator) -> Rig:
    """`rig` with clearance and drive as they are set for one run; any phase, any start within the gap."""
    stop = replace(rig.upper, gap=rig.upper.gap * _spread(rng, 0.02))
    drive = replace(
        rig.tones[0],
        amplitude=rig.tones[0].amplitude * _spread(rng, 0.01),
        frequency=rig.tones[0].frequency * _spread(rng, 2e-4),
        phase=rng.uniform(0, 2 * np.pi),
    )
    return replace(rig, upper=stop, lower=stop, tones=(drive,), start=stop.gap * rng.uniform(-0.9, 0.9))


def _spread(rng: np.random.Generator, sigma: float) -> float:
    """About 1; at most three sigma away, so that nothing turns negative."""
    return 1 + sigma * float(np.clip(rng.standard_normal(), -3, 3))
