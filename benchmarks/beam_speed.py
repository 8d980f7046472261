"""The beam's solver against Exudyn: the same modal beam, the same accuracy asked for, one core, one run.

Every way of Exudyn that reaches the first peak within 0.5 % is timed; ours is held against the fastest of
them, run about, several times.

Exudyn is set up to be as fast as it can be: its build without range checks; the beam as one object of 15
modal coordinates, turned so that the tip's deflection is one of them; the drive's sine as one more oscillator
in the same object; the contact as compiled limit stops. No Python runs in its loop, and nothing is written.

Needs the optional extra `peers`. Usage: python -m benchmarks.beam_speed [repetitions]
"""

from __future__ import annotations

import os
import statistics
import sys
import time
import warnings
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.switched import Simulation

FIRST_PEAK = 28.895
"""N, 20 Hz and 0.127 mm: the reference value."""
TOLERANCE = 0.005
BAR = 20.0
RATE = 204_800.0
_PEAK_ENDS_BY = 0.0052  # s
_OUR_SECONDS, _PEER_SECONDS = 4.0, 0.4
_DRIVE = SineDrive(9.0, 20.0)
_RIG = nominal()

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


def turned_beam() -> Turned:
    """The twin's modal beam, in coordinates of which the first is along the tip's mode shape values."""
    free = assemble(_RIG, (1,)).regimes[0]
    n = len(free.A) // 2
    tip = free.events[0].condition.position[:n]
    turn, _ = np.linalg.qr(np.column_stack([tip, np.eye(n)[:, 1:]]))
    K, D = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    K[:n, :n] = -turn.T @ free.A[n:, :n] @ turn
    D[:n, :n] = -turn.T @ free.A[n:, n:] @ turn
    K[:n, n] = -_DRIVE.amplitude * (turn.T @ free.B[n:, 0])
    K[n, n] = (2 * np.pi * _DRIVE.frequency) ** 2
    return Turned(K, D, float(tip @ turn[:, 0]))


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
    start = [0.0] * (size - 1) + [2 * np.pi * _DRIVE.frequency]
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
            limitStopsUpper=_RIG.clearance,
            limitStopsLower=-_RIG.clearance,
            limitStopsStiffness=_RIG.contact_stiffness,
            limitStopsDamping=_RIG.contact_damping,
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
    """Return the wall time in s and, if `watched`, the contact force at every step."""
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
    begin = time.perf_counter()
    system.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
    wall = time.perf_counter() - begin
    force = np.array(system.GetSensorStoredData(sensor))[:, 1]
    return wall, force if watched else np.zeros(0)


def first_peak(force: NDArray[np.float64]) -> float:
    """Largest magnitude of the first contact in a signed force, N."""
    touching = np.flatnonzero(np.abs(force) > 0)
    if not len(touching):
        return 0.0
    signed = force[touching[0] :] * np.sign(force[touching[0]])
    ended = np.flatnonzero(signed <= 0)
    return float(signed[: ended[0] if len(ended) else None].max())


def our_simulation() -> Simulation:
    """From rest, at the rate at which the twin computes its truth."""
    simulation = Simulation(assemble(_RIG, (1,)), 1 / RATE)
    simulation.drive(_DRIVE.phasors()[1:2], 2 * np.pi * _DRIVE.frequency)
    return simulation


def speed_of_ours(simulation: Simulation) -> float:
    """Simulated s per wall s, with both contact forces recorded."""
    begin = time.perf_counter()
    simulation.advance(round(_OUR_SECONDS * RATE))
    return _OUR_SECONDS / (time.perf_counter() - begin)


def accurate_methods(exu: ModuleType, beam: Turned) -> list[tuple[str, float]]:
    """Print the first peak and one speed of each method; return those within the tolerance, fastest first."""
    speeds: dict[tuple[str, float], float] = {}
    for method in METHODS:
        _, force = run_exudyn(exu, beam, method, _PEAK_ENDS_BY, watched=True)
        peak = first_peak(force)
        speed = max(_PEER_SECONDS / run_exudyn(exu, beam, method, _PEER_SECONDS, False)[0] for _ in range(2))
        within = abs(peak / FIRST_PEAK - 1) < TOLERANCE
        _row(f"Exudyn {method[0]} {method[1]:g} us", peak, f"{speed:8.2f}", "" if within else "  too far off")
        if within:
            speeds[method] = speed
    return sorted(speeds, key=lambda method: -speeds[method])


def _row(name: str, peak: float, speed: str, remark: str = "") -> None:
    error = 100 * (peak / FIRST_PEAK - 1)
    print(f"{name:32s} {peak:9.3f} N {error:+7.2f} % {speed} sim-s/s{remark}", flush=True)


def main(repetitions: int) -> int:
    """Print the table and the ratio; return 0 if the ratio reaches the bar."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    exu, beam, ours = load_exudyn(), turned_beam(), our_simulation()
    print(
        f"steel, 20 Hz, g 0.127 mm, 15 modes, one core; first peak {FIRST_PEAK} N; Exudyn {exu.__version__}"
    )
    peak = first_peak(ours.advance(round(_PEAK_ENDS_BY * RATE)).outputs[0])
    _row("ours, forces at 204.8 kHz", peak, f"{max(speed_of_ours(ours) for _ in range(2)):8.2f}")
    contenders = accurate_methods(exu, beam)[:2]
    ratios: list[float] = []
    for _ in range(repetitions):
        before = speed_of_ours(ours)
        peers = [
            _PEER_SECONDS / run_exudyn(exu, beam, method, _PEER_SECONDS, False)[0] for method in contenders
        ]
        mine = (before + speed_of_ours(ours)) / 2
        ratios.append(mine / max(peers))
        print(f"ours {mine:7.1f}, best Exudyn {max(peers):6.2f} sim-s/s, ratio {ratios[-1]:6.1f}", flush=True)
    median = statistics.median(ratios)
    print(f"ratio: median {median:.1f}, range {min(ratios):.1f} to {max(ratios):.1f}; bar {BAR:g}")
    return 0 if median >= BAR else 1


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 7))
