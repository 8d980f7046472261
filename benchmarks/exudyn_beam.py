"""The impact beam in Exudyn, set up to be as fast as it can be.

Its build without range checks; the beam as one object of 15 modal coordinates, turned so that the tip's
deflection is one of them; the drive's sine as one more oscillator in the same object; the contact as compiled
limit stops. No Python runs in its loop, and nothing is written. Needs the optional extra `peers`.
"""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.rigs.impact_beam.structure import structure_of

# Solver and step in us; velocity Verlet becomes unstable from 5.5 us on, RK33 from 8 us.
METHODS = (
    ("VelocityVerlet", 4.0),
    ("VelocityVerlet", 5.0),
    ("RK33", 5.0),
    ("RK44", 4.0),
    ("TrapezoidalIndex2", 5.0),
    ("GeneralizedAlpha", 2.5),
    ("GeneralizedAlpha", 5.0),
    ("GeneralizedAlpha", 10.0),
)


@dataclass(frozen=True, slots=True)
class Turned:
    """M = I; K, D with the drive's oscillator last; tip deflection = `tip` times the first coordinate."""

    K: NDArray[np.float64]
    D: NDArray[np.float64]
    tip: float
    rig: ImpactBeam
    omega: float


def turned_beam(rig: ImpactBeam, drive: SineDrive) -> Turned:
    """The twin's modal beam, in coordinates of which the first is along the tip's mode shape values."""
    s, omega = structure_of(rig), 2 * np.pi * drive.frequency
    n = len(s.K)
    turn, _ = np.linalg.qr(np.column_stack([s.contact, np.eye(n)[:, 1:]]))
    K, D = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    K[:n, :n], D[:n, :n] = turn.T @ s.K @ turn, turn.T @ s.C @ turn
    K[:n, n] = -drive.amplitude * (turn.T @ s.drive)
    K[n, n] = omega**2
    return Turned(K, D, float(s.contact @ turn[:, 0]), rig, omega)


def load_exudyn() -> ModuleType:
    """Import the build without range checks; it has to be asked for before the import."""
    sys.exudynFast = True  # type: ignore[attr-defined]
    warnings.simplefilter("ignore", DeprecationWarning)
    import exudyn

    return exudyn


def exudyn_system(exu: ModuleType, beam: Turned) -> tuple[Any, int]:
    """Return an assembled system and the number of its force sensor."""
    item: Any = import_module("exudyn.itemInterface")
    size = len(beam.K)
    system = exu.SystemContainer().AddSystem()
    start = [0.0] * (size - 1) + [beam.omega]
    coordinates = system.AddNode(
        item.NodeGenericODE2(
            numberOfODE2Coordinates=size,
            referenceCoordinates=[0.0] * size,
            initialCoordinates=[0.0] * size,
            initialCoordinates_t=start,
        )
    )
    system.AddObject(
        item.ObjectGenericODE2(
            nodeNumbers=[coordinates],
            massMatrix=np.eye(size),
            stiffnessMatrix=beam.K,
            dampingMatrix=beam.D,
        )
    )
    ground = system.AddNode(item.NodePointGround())
    ends = [
        system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        for node in (ground, coordinates)
    ]
    state = system.AddNode(item.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0] * 3))
    stops = system.AddObject(
        item.CoordinateSpringDamperExt(
            markerNumbers=ends,
            nodeNumber=state,
            factor1=beam.tip,
            useLimitStops=True,
            limitStopsUpper=beam.rig.clearance,
            limitStopsLower=-beam.rig.clearance,
            limitStopsStiffness=beam.rig.contact_stiffness,
            limitStopsDamping=beam.rig.contact_damping,
        )
    )
    sensor = system.AddSensor(
        item.SensorObject(
            objectNumber=stops, storeInternal=True, outputVariableType=exu.OutputVariableType.Force
        )
    )
    system.Assemble()
    return system, int(sensor)


def run_exudyn(
    exu: ModuleType, beam: Turned, method: tuple[str, float], seconds: float, watched: bool
) -> tuple[float, NDArray[np.float64]]:
    """Return the processor's time in s and, if `watched`, the contact force at every step."""
    system, sensor = exudyn_system(exu, beam)
    solver, step_us = method
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps = round(seconds / step_us * 1e6)
    integration.endTime = seconds
    integration.stepInformation = 0
    integration.adaptiveStep = False
    # With the default the solver cuts its step to the floor at the first contact.
    integration.discontinuous.useRecommendedStepSize = False
    integration.discontinuous.ignoreMaxIterations = True
    integration.explicit.useLieGroupIntegration = False
    integration.explicit.eliminateConstraints = False
    integration.explicit.computeEndOfStepAccelerations = False
    integration.explicit.computeMassMatrixInversePerBody = True
    settings.parallel.numberOfThreads = 1
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = step_us * 1e-6 if watched else seconds
    begin = time.process_time()
    system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
    spent = time.process_time() - begin
    force = np.array(system.GetSensorStoredData(sensor))[:, 1]
    return spent, force if watched else np.zeros(0)


def first_peak(force: NDArray[np.float64]) -> float:
    """Largest magnitude of the first contact in a signed force, N."""
    touching = np.flatnonzero(np.abs(force) > 0)
    if not len(touching):
        return 0.0
    signed = force[touching[0] :] * np.sign(force[touching[0]])
    ended = np.flatnonzero(signed <= 0)
    return float(signed[: ended[0] if len(ended) else None].max())
