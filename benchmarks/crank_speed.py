"""The planar slider-crank's solver against Exudyn: same mechanism and accuracy, one core, one run.

Ours is held against the fastest way of Exudyn that has both first peaks within the tolerance, run about,
several times, in time of the processor. There are two measures of what Exudyn's peaks are:

- its own: the largest force that it gives at its steps, as the reference table has them. This is what a user
  reads from it, and what the exit code follows;
- interpolated: the summit of the parabola through the highest force and its neighbours. This asks only
  whether the motion is right, and lets longer steps pass, as our own peaks come from within our steps.

Neither writes anything while it is timed (ours lists its contacts all the same); what 25.6 kHz of forces cost
ours is printed beside.

Exudyn is set up to be as fast as it can be: its build without range checks; no constraint and no load in
Python: the crank is a body so heavy that it keeps its speed, the piston a mass with one coordinate; the
joints are its contacts of a sphere in a hollow sphere.

Needs the optional extra `peers`. Usage: python -m benchmarks.crank_speed [repetitions]
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

from sim_twin.mechanisms.run import CONTACT, PEAK
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.planar_slider_crank.model import nominal
from sim_twin.rigs.planar_slider_crank.motion import simulation, step_limits

FIRST_PEAKS = (9079.3, 14918.8)
"""N, at crank pin and piston pin: the reference values."""
TOLERANCE = 0.005
BAR = 30.0
RATE = 25_600.0
SPEED = 200 * np.pi / 30
_PEAKS_END_BY = 0.02  # s
_OUR_SECONDS, _PEER_SECONDS = 20.0, 0.6
_OUR_TOLERANCE = 1e-5
_UNWATCHED = 5.0  # Hz; 100 samples in all, so that the list of contacts has room
_RIG = nominal()
_HEAVY = 1e12  # kg and kg m2

# Solver and step in us.
METHODS = (
    ("VelocityVerlet", 5.0),
    ("VelocityVerlet", 10.0),
    ("VelocityVerlet", 15.0),
    ("VelocityVerlet", 20.0),
    ("VelocityVerlet", 25.0),
    ("VelocityVerlet", 30.0),
    ("RK33", 10.0),
    ("RK44", 5.0),
    ("RK44", 10.0),
    ("RK44", 20.0),
    ("GeneralizedAlpha", 5.0),
    ("GeneralizedAlpha", 10.0),
)


@dataclass(frozen=True, slots=True)
class System:
    """An assembled system and the numbers of the force sensors of both joints."""

    mbs: Any
    sensors: tuple[int, int]


def load_exudyn() -> ModuleType:
    """Import the build without range checks; it has to be asked for before the import."""
    sys.exudynFast = True  # type: ignore[attr-defined]
    warnings.simplefilter("ignore", DeprecationWarning)
    import exudyn

    return exudyn


def exudyn_system(exu: ModuleType) -> System:
    """The mechanism with centred joints and the velocities of ideal ones, crank along x."""
    item: Any = import_module("exudyn.itemInterface")
    mbs = exu.SystemContainer().AddSystem()
    r, L = _RIG.crank_length, _RIG.rod_length
    spin = -r * SPEED / L
    crank = _body(mbs, item, _HEAVY, _HEAVY, [0.0, 0.0], [0.0, 0.0, SPEED])
    rod = _body(mbs, item, _RIG.rod_mass, _RIG.rod_inertia, [r + L / 2, 0.0], [0.0, r * SPEED / 2, spin])
    slide = mbs.AddNode(
        item.Node1D(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[0.0])
    )
    piston = mbs.AddObject(
        item.ObjectMass1D(physicsMass=_RIG.piston_mass, nodeNumber=slide, referencePosition=[r + L, 0.0, 0.0])
    )
    weight = mbs.AddMarker(item.MarkerBodyMass(bodyNumber=rod))
    mbs.AddLoad(item.LoadMassProportional(markerNumber=weight, loadVector=[0.0, -_RIG.gravity, 0.0]))
    first = _joint(mbs, item, exu, (rod, [-L / 2, 0.0, 0.0]), (crank, [r, 0.0, 0.0]), 0)
    second = _joint(mbs, item, exu, (rod, [L / 2, 0.0, 0.0]), (piston, [0.0, 0.0, 0.0]), 1)
    mbs.Assemble()
    return System(mbs, (first, second))


def _body(mbs: Any, item: Any, mass: float, inertia: float, place: list[float], speed: list[float]) -> int:
    node = mbs.AddNode(
        item.NodeRigidBody2D(
            referenceCoordinates=[*place, 0.0], initialCoordinates=[0.0] * 3, initialVelocities=speed
        )
    )
    return int(
        mbs.AddObject(item.ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=node))
    )


def _joint(
    mbs: Any, item: Any, exu: ModuleType, bearing: tuple[int, list[float]], journal: tuple[int, list[float]],
    which: int,
) -> int:  # fmt: skip
    # The second marker, numbered 1, is the hollow sphere's.
    markers = [
        mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=place))
        for body, place in (journal, bearing)
    ]
    data = mbs.AddNode(item.NodeGenericData(numberOfDataCoordinates=4, initialCoordinates=[0.0] * 4))
    clearance = (_RIG.clearance_1, _RIG.clearance_2)[which]
    contact = mbs.AddObject(
        item.ObjectContactSphereSphere(
            markerNumbers=markers,
            nodeNumber=data,
            spheresRadii=[_RIG.journal_radius, _RIG.journal_radius + clearance],
            isHollowSphere1=True,
            dynamicFriction=_RIG.friction,
            frictionProportionalZone=_RIG.friction_v_1,
            contactStiffness=_RIG.contact_stiffnesses[which],
            contactStiffnessExponent=1.5,
            # Its factor 3 (1 - e) / 2 (Hunt and Crossley) is made the 3 (1 - e^2) / 4 of the rig.
            restitutionCoefficient=1 - (1 - _RIG.restitution**2) / 2,
            minimumImpactVelocity=_RIG.approach_floor,
            impactModel=1,
        )
    )
    return int(
        mbs.AddSensor(
            item.SensorObject(
                objectNumber=contact, storeInternal=True, outputVariableType=exu.OutputVariableType.Force
            )
        )
    )


def run_exudyn(
    exu: ModuleType, method: tuple[str, float], seconds: float, watched: bool
) -> tuple[float, list[NDArray[np.float64]]]:
    """Return the processor's time in s and, if `watched`, the joints' forces in N at every step."""
    system = exudyn_system(exu)
    solver, step_us = method
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps = round(seconds / step_us * 1e6)
    integration.endTime = seconds
    integration.stepInformation = 0
    integration.verboseMode = 0
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
    system.mbs.SolveDynamic(settings, solverType=getattr(exu.DynamicSolverType, solver))
    spent = time.process_time() - begin
    if not watched:
        return spent, []
    stored = (np.array(system.mbs.GetSensorStoredData(sensor)) for sensor in system.sensors)
    return spent, [np.linalg.norm(table[:, 1:], axis=1) for table in stored]


def first_peak(force: NDArray[np.float64], interpolated: bool) -> float:
    """Largest value of the first contact in a force, N; or the summit of the parabola about it."""
    touching = np.flatnonzero(force > 0)
    if not len(touching):
        return 0.0
    contact = force[touching[0] :]
    ended = np.flatnonzero(contact <= 0)
    contact = contact[: ended[0] if len(ended) else None]
    k = int(np.argmax(contact))
    if not interpolated or not 0 < k < len(contact) - 1:
        return float(contact[k])
    before, top, after = contact[k - 1 : k + 2]
    return float(top - (after - before) ** 2 / (8 * (before - 2 * top + after)))


def our_speed(seconds: float, rate: float) -> tuple[float, tuple[float, float]]:
    """Simulated s per processor's s with outputs at `rate` Hz, and both first peaks."""
    run = simulation(_RIG, SpeedDrive(SPEED), 0.0, 1 / rate, step_limits(_RIG, _OUR_TOLERANCE))
    begin = time.process_time()
    episodes = run.advance(round(seconds * rate)).episodes
    spent = time.process_time() - begin
    crank, piston = (float(episodes[episodes[:, CONTACT] == joint][0, PEAK]) for joint in (0, 1))
    return seconds / spent, (crank, piston)


def fastest_methods(exu: ModuleType) -> tuple[tuple[str, float], tuple[str, float]]:
    """Print peaks and one speed of each method; the fastest by its own peaks, and by interpolated ones."""
    speeds: dict[bool, dict[tuple[str, float], float]] = {False: {}, True: {}}
    for method in METHODS:
        forces = run_exudyn(exu, method, _PEAKS_END_BY, watched=True)[1]
        speed = max(_PEER_SECONDS / run_exudyn(exu, method, _PEER_SECONDS, False)[0] for _ in range(2))
        for interpolated in (False, True):
            peaks = tuple(first_peak(force, interpolated) for force in forces)
            within = all(abs(p / text - 1) < TOLERANCE for p, text in zip(peaks, FIRST_PEAKS, strict=True))
            name = f"  interpolated{'':17s}" if interpolated else f"Exudyn {method[0]} {method[1]:g} us"
            _row(name, peaks, f"{speed:8.2f}", "" if within else "  too far off")
            if within:
                speeds[interpolated][method] = speed
    own, interpolated_too = (max(found, key=lambda method: found[method]) for found in speeds.values())
    return own, interpolated_too


def _row(name: str, peaks: tuple[float, ...], speed: str, remark: str = "") -> None:
    found = "  ".join(
        f"{peak:9.1f} N {100 * (peak / text - 1):+6.2f} %"
        for peak, text in zip(peaks, FIRST_PEAKS, strict=True)
    )
    print(f"{name:32s} {found} {speed} sim-s/s{remark}", flush=True)


def main(repetitions: int) -> int:
    """Print the table and both ratios; return 0 if the one by Exudyn's own peaks reaches the bar."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    exu = load_exudyn()
    our_speed(0.1, RATE)
    print(f"200 rpm, 1 mm, one core; first peaks {FIRST_PEAKS} N; Exudyn {exu.__version__}")
    for name, rate in (("forces at 25.6 kHz", RATE), ("nothing written", _UNWATCHED)):
        speed, peaks = max(our_speed(_OUR_SECONDS, rate) for _ in range(3))
        _row(f"ours, {name}", peaks, f"{speed:8.2f}")
    contenders = fastest_methods(exu)
    ratios: list[list[float]] = [[], []]
    for _ in range(repetitions):
        before = our_speed(_OUR_SECONDS, _UNWATCHED)[0]
        peers = [_PEER_SECONDS / run_exudyn(exu, method, _PEER_SECONDS, False)[0] for method in contenders]
        mine = (before + our_speed(_OUR_SECONDS, _UNWATCHED)[0]) / 2
        for found, peer in zip(ratios, peers, strict=True):
            found.append(mine / peer)
        print(f"ours {mine:7.1f}, Exudyn {peers[0]:6.2f} and {peers[1]:6.2f} sim-s/s", flush=True)
    for of, method, found in zip(("its own", "interpolated"), contenders, ratios, strict=True):
        print(
            f"ratio to {method[0]} {method[1]:g} us, the fastest by {of} peaks: median"
            f" {statistics.median(found):.1f}, range {min(found):.1f} to {max(found):.1f}; bar {BAR:g}"
        )
    return 0 if statistics.median(ratios[0]) >= BAR else 1


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 7))
