"""The motion by Exudyn: reduced beam, stops and drive as compiled symbolic functions; velocity Verlet."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from io import StringIO
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.blind.beam.rig import REACH, Rig, Stop, Tone
from benchmarks.blind.beam.structure import DRIVE, PIN, TIP, Array, reduced

STEP = 1 / 409_600
"""s; half of it changes the first peaks by 0.3 % (the stops' damping acts at once)."""
EVERY = 2
"""Steps for each fine sample."""
_STICKING, _STICKING_DAMPING = 2e4, 0.02  # N m/rad, N m s/rad


@dataclass(frozen=True, slots=True)
class Truth:
    """Finely sampled: force of each stop in N, positive in compression; the yoke's acceleration in m/s2."""

    rate: float
    upper: Array
    lower: Array
    yoke_acceleration: Array | None


@cache
def load_exudyn() -> ModuleType:
    """Import the build without range checks; it has to be asked for before the import."""
    sys.exudynFast = True  # type: ignore[attr-defined]
    with warnings.catch_warnings(), redirect_stdout(StringIO()):
        warnings.simplefilter("ignore", DeprecationWarning)
        import exudyn

        import_module("exudyn.utilities")
    exudyn.config.printToConsole = False
    return exudyn


class _System:
    """One rig in Exudyn: everything on one line of deflection."""

    def __init__(self, rig: Rig) -> None:
        self.exu = load_exudyn()
        self.item: Any = import_module("exudyn.itemInterface")
        self.container = self.exu.SystemContainer()
        self.mbs: Any = self.container.AddSystem()
        self.kept: list[Any] = []
        self.rig = rig

    def assemble(self) -> dict[str, int]:
        """Add all parts; return the numbers of the sensors."""
        rig, ground = self.rig, self._marker(self.mbs.AddNode(self.item.NodePointGround()))
        beam = self._beam()
        tip = self._marker(beam, TIP)
        yoke_node = None if rig.yoke is None else self._yoke(ground)
        yoke = ground if yoke_node is None else self._marker(yoke_node)
        self._drive(self._marker(beam, DRIVE))
        upper = self._connector((yoke, tip), lambda t, u, v: _force(self.sym, rig.upper, t, u, v))
        lower = self._connector((yoke, tip), lambda t, u, v: -_force(self.sym, rig.lower, t, -u, -v))
        if rig.cubic:
            self._connector((ground, tip), lambda t, u, v: rig.cubic * u * u * u)
        if rig.drag:
            self._connector((ground, tip), lambda t, u, v: rig.drag * v)
        if rig.pivot_torque:
            self._friction((ground, self._marker(beam, PIN)))
        sensors = {"upper": self._sensor(upper), "lower": self._sensor(lower)}
        if yoke_node is not None:
            sensors["position"] = self._node_sensor(yoke_node, "Coordinates")
            sensors["velocity"] = self._node_sensor(yoke_node, "Coordinates_t")
        self.mbs.Assemble()
        return sensors

    @property
    def sym(self) -> Any:
        return self.exu.symbolic

    def _marker(self, node: int, coordinate: int = 0) -> int:
        return int(self.mbs.AddMarker(self.item.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate)))

    def _beam(self) -> int:
        system = reduced(self.rig.beam)
        size = len(system.M)
        node = self.mbs.AddNode(
            self.item.NodeGenericODE2(
                numberOfODE2Coordinates=size,
                referenceCoordinates=[0.0] * size,
                initialCoordinates=(self.rig.start * system.pendulum).tolist(),
                initialCoordinates_t=[0.0] * size,
            )
        )
        self.mbs.AddObject(
            self.item.ObjectGenericODE2(
                nodeNumbers=[node], massMatrix=system.M, stiffnessMatrix=system.K, dampingMatrix=system.D
            )
        )
        return int(node)

    def _yoke(self, ground: int) -> int:
        yoke = self.rig.yoke
        assert yoke is not None
        omega = 2 * np.pi * yoke.frequency
        node = self.mbs.AddNode(
            self.item.Node1D(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[0.0])
        )
        self.mbs.AddObject(self.item.ObjectMass1D(mass=yoke.mass, nodeNumber=node))
        self.mbs.AddObject(
            self.item.CoordinateSpringDamper(
                markerNumbers=[ground, self._marker(node)],
                stiffness=yoke.mass * omega**2,
                damping=2 * yoke.damping_ratio * yoke.mass * omega,
            )
        )
        return int(node)

    def _drive(self, marker: int) -> None:
        tones, sine = (*self.rig.tones, *self.rig.foreign), self.sym.sin

        def load(mbs: Any, t: Any, load: Any) -> Any:
            first, *others = (_tone(sine, tone, t) for tone in tones)
            return sum(others, first)

        number = self.mbs.AddLoad(self.item.LoadCoordinate(markerNumber=marker, load=1.0))
        self.mbs.SetLoadParameter(
            number, "loadUserFunction", self._symbolic(load, "loadUserFunction", number)
        )

    def _connector(self, markers: tuple[int, int], law: Callable[[Any, Any, Any], Any]) -> int:
        def force(mbs: Any, t: Any, number: Any, u: Any, v: Any, k: Any, d: Any, offset: Any) -> Any:
            return law(t, u, v)

        number = self.mbs.AddObject(self.item.CoordinateSpringDamper(markerNumbers=list(markers)))
        name = "springForceUserFunction"
        self.mbs.SetObjectParameter(number, name, self._symbolic(force, name, number))
        return int(number)

    def _symbolic(self, function: Callable[..., Any], name: str, number: int) -> Any:
        """Exudyn compiles the function into an expression; it must live as long as the system."""
        create = import_module("exudyn.utilities").CreateSymbolicUserFunction
        self.kept.append(create(self.mbs, function, name, number))
        return self.kept[-1]

    def _friction(self, markers: tuple[int, int]) -> None:
        state = self.mbs.AddNode(
            self.item.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0] * 3)
        )
        self.mbs.AddObject(
            self.item.CoordinateSpringDamperExt(
                markerNumbers=list(markers),
                nodeNumber=state,
                dynamicFrictionForce=self.rig.pivot_torque,
                stickingStiffness=_STICKING,
                stickingDamping=_STICKING_DAMPING,
                frictionProportionalZone=0.0,
            )
        )

    def _sensor(self, number: int) -> int:
        kind = self.exu.OutputVariableType.Force
        sensor = self.item.SensorObject(objectNumber=number, storeInternal=True, outputVariableType=kind)
        return int(self.mbs.AddSensor(sensor))

    def _node_sensor(self, node: int, kind: str) -> int:
        variable = getattr(self.exu.OutputVariableType, kind)
        sensor = self.item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=variable)
        return int(self.mbs.AddSensor(sensor))

    def solve(self, samples: int) -> None:
        """Integrate over `samples` fine samples."""
        settings = self.exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps = samples * EVERY
        integration.endTime = samples * EVERY * STEP
        integration.stepInformation = 0
        integration.adaptiveStep = False
        integration.verboseMode = 0
        # With the default the solver cuts its step to the floor at the first contact.
        integration.discontinuous.useRecommendedStepSize = False
        integration.discontinuous.ignoreMaxIterations = True
        integration.explicit.useLieGroupIntegration = False
        integration.explicit.eliminateConstraints = False
        integration.explicit.computeEndOfStepAccelerations = False
        integration.explicit.computeMassMatrixInversePerBody = False
        settings.parallel.numberOfThreads = 1
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = EVERY * STEP
        self.mbs.SolveDynamic(settings, solverType=self.exu.DynamicSolverType.VelocityVerlet)

    def stored(self, sensor: int) -> Array:
        return np.array(self.mbs.GetSensorStoredData(sensor))[:, 1]


def simulate(rig: Rig, samples: int) -> Truth:
    """The motion of `rig` from its start, `samples` fine samples at 204.8 kHz."""
    system = _System(rig)
    sensors = system.assemble()
    system.solve(samples)
    found = {name: system.stored(number)[:samples] for name, number in sensors.items()}
    # Exudyn holds on to what its sensors stored: 50 MB for ten seconds.
    system.container.Reset()
    upper, lower = found["upper"], -found["lower"]
    acceleration = None
    if rig.yoke is not None:
        omega = 2 * np.pi * rig.yoke.frequency
        spring = omega**2 * found["position"] + 2 * rig.yoke.damping_ratio * omega * found["velocity"]
        acceleration = (upper - lower) / rig.yoke.mass - spring
    return Truth(1 / (EVERY * STEP), upper, lower, acceleration)


def _force(sym: Any, stop: Stop, t: Any, u: Any, v: Any) -> Any:
    """Force of one stop that is touched at u = its gap; u and v towards it."""
    zero = sym.Real(0.0)
    gap = stop.gap * sym.max(1 + stop.drift * t, sym.Real(0.1)) if stop.drift else stop.gap
    depth = u - gap
    push = sym.max(_elastic(sym, stop, sym.max(depth, zero)) + stop.damping * v, zero)
    if not stop.pull:
        return sym.IfThenElse(depth > 0, push, zero)
    return sym.IfThenElse(depth > 0, push - stop.pull, -stop.pull * sym.max(1 + depth / REACH, zero))


def _elastic(sym: Any, stop: Stop, depth: Any) -> Any:
    if stop.pad is not None:
        share, thickness = stop.pad
        depth = share * depth + (1 - share) * sym.max(depth - thickness, sym.Real(0.0))
    return stop.stiffness * (depth if stop.exponent == 1 else sym.pow(depth, sym.Real(stop.exponent)))


def _tone(sine: Callable[[Any], Any], tone: Tone, t: Any) -> Any:
    return tone.amplitude * sine(2 * np.pi * tone.frequency * t + tone.phase)
