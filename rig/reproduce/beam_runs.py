"""Runs of the impact beam: contact forces from the solver, and the statistics of their half cycles."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from daq.signals.impacts import HalfCycles, half_cycles
from rig.reproduce.figure import Sample
from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive, nominal
from sim_twin.status import Status
from sim_twin.switched.simulation import Simulation

Array = NDArray[np.float64]
RATE = 204_800.0
DRIVE_N = 9.0
SETTLE_S = 1.0
_BASE = 2
_FEWEST = 3


class Forces(NamedTuple):
    """Upper and lower contact force in N and base acceleration in m/s2, each of shape (n,), RATE a second."""

    upper: Array
    lower: Array
    base: Array


def forces(rig: ImpactBeam, drive: SineDrive, duration: float, settle: float = SETTLE_S) -> Forces:
    """Motion from rest, the first `settle` s left out; raises SimulationFailed."""
    simulation = Simulation(assemble(rig), 1 / RATE)
    simulation.drive(drive.phasors()[1:2], 2 * np.pi * drive.frequency)
    if settle > 0:
        simulation.advance(round(settle * RATE))
    outputs = simulation.advance(round(duration * RATE)).outputs
    if not np.isfinite(simulation.state).all():
        raise SimulationFailed("the impact beam's motion is not finite", Status.DIVERGED.advice)
    return Forces(outputs[0], outputs[1], outputs[_BASE])


def whole_half_cycles(run: Forces) -> HalfCycles:
    """Half cycles without the two that the ends of the record may cut."""
    found = half_cycles(run.upper, run.lower, RATE)
    return HalfCycles(*(getattr(found, name)[1:-1] for name in HalfCycles.__slots__))


def peaks_of(run: Forces) -> Sample:
    """*First* of every whole half cycle in N; raises SimulationFailed where there are under three."""
    cycles = whole_half_cycles(run)
    if len(cycles) < _FEWEST:
        what = f"the beam met its stops in {len(cycles)} half cycles of {len(run.upper) / RATE:g} s"
        raise SimulationFailed(what, "drive it harder or longer")
    return Sample(cycles.first_n)


def first_peaks(
    rig: ImpactBeam, frequency: float, duration: float, amplitude: float = DRIVE_N, settle: float = SETTLE_S
) -> Sample:
    """*First* in N of every whole half cycle of a run of `duration` s."""
    return peaks_of(forces(rig, SineDrive(amplitude, frequency), duration, settle))


Material: TypeAlias = Literal["steel", "aluminium"]


def beam(clearance_mm: float = 0.127, material: Material = "steel") -> ImpactBeam:
    """The source's rig with one of its beams, rigid base, at a clearance in mm."""
    return replace(nominal(material), clearance=1e-3 * clearance_mm)


WHAT_IF_AMPLITUDE_N = 8.9


def what_if_beam(clearance_mm: float) -> ImpactBeam:
    """The steel beam as the source may have cut it, with a small electrodynamic shaker on it."""
    rig = replace(nominal(modes=4, modal_damping=0.02), clearance=1e-3 * clearance_mm)
    return replace(rig, shaker_mass=0.020, shaker_stiffness=3e3, shaker_damping=20.0)
