"""Exudyn's items that the mechanism is built of, with the few arguments that matter here."""

from __future__ import annotations

import contextlib
import io
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]


@cache
def load_exudyn() -> Any:
    """Import the build without range checks, which has to be asked for before the import; silenced."""
    sys.exudynFast = True  # type: ignore[attr-defined]
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        exudyn = import_module("exudyn")
        import_module("exudyn.advancedUtilities")
    exudyn.config.printToConsole = False
    # A friction that falls with speed is one that is always there less one that sets in slowly.
    exudyn.special.exceptions.parameterRangeChecks = False
    return exudyn


class Parts:
    """A system being assembled in the plane. Items are known by their numbers; vectors are x, y, angle."""

    def __init__(self) -> None:
        self.exu, self.item = load_exudyn(), import_module("exudyn.itemInterface")
        self._container = self.exu.SystemContainer()
        self.mbs = self._container.AddSystem()
        self._expressions: list[Any] = []
        self._ground_node = self.mbs.AddNode(self.item.NodePointGround())
        self.ground = self.mbs.AddObject(self.item.ObjectGround())

    def body(
        self,
        place: Sequence[float],
        moved: Sequence[float],
        velocity: Sequence[float],
        mass: float,
        inertia: float,
    ) -> tuple[int, int]:
        """Return a rigid body and its node; coordinates count from `place`, start at `moved`."""
        node = self.mbs.AddNode(
            self.item.NodeRigidBody2D(
                referenceCoordinates=list(place),
                initialCoordinates=list(moved),
                initialVelocities=list(velocity),
            )
        )
        return self.mbs.AddObject(
            self.item.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)
        ), node

    def slider(self, place: Sequence[float], moved: float, velocity: float, mass: float) -> tuple[int, int]:
        """Return a mass that only moves along x, and its node."""
        node = self.mbs.AddNode(
            self.item.Node1D(
                referenceCoordinates=[0.0], initialCoordinates=[moved], initialVelocities=[velocity]
            )
        )
        return self.mbs.AddObject(
            self.item.ObjectMass1D(mass=mass, nodeNumber=node, referencePosition=[*place, 0.0])
        ), node

    def weight(self, body: int, gravity: float) -> None:
        """Gravity along -y."""
        marker = self.mbs.AddMarker(self.item.MarkerBodyMass(bodyNumber=body))
        self.mbs.AddLoad(self.item.LoadMassProportional(markerNumber=marker, loadVector=[0.0, -gravity, 0.0]))

    def point(self, body: int, x: float, y: float = 0.0) -> int:
        """A marker on a body, in the body's frame."""
        return int(self.mbs.AddMarker(self.item.MarkerBodyRigid(bodyNumber=body, localPosition=[x, y, 0.0])))

    def spring(self, node: int, coordinate: int, stiffness: float, damping: float) -> Any:
        """Spring (N/m) and damper (N s/m) between ground and one coordinate of a node, as Exudyn's index."""
        markers = [
            self.mbs.AddMarker(self.item.MarkerNodeCoordinate(nodeNumber=number, coordinate=which))
            for number, which in ((self._ground_node, 0), (node, coordinate))
        ]
        return self.mbs.AddObject(
            self.item.CoordinateSpringDamper(markerNumbers=markers, stiffness=stiffness, damping=damping)
        )

    def law(self, spring: Any, force: Callable[..., Any]) -> None:
        """Give a spring a law of its own, as an expression that Exudyn evaluates without Python."""
        create = import_module("exudyn.advancedUtilities").CreateSymbolicUserFunction
        # Exudyn only borrows the expression.
        self._expressions.append(create(self.mbs, force, "springForceUserFunction", spring))
        self.mbs.SetObjectParameter(spring, "springForceUserFunction", self._expressions[-1])

    def contact(self, inner: int, outer: int, radii: Sequence[float], **law: Any) -> int:
        """A contact of spheres between two markers."""
        data = self.mbs.AddNode(
            self.item.NodeGenericData(numberOfDataCoordinates=4, initialCoordinates=[0.0] * 4)
        )
        return int(
            self.mbs.AddObject(
                self.item.ObjectContactSphereSphere(
                    markerNumbers=[inner, outer], nodeNumber=data, spheresRadii=list(radii), **law
                )
            )
        )

    def damper(self, inner: int, outer: int, damping: float) -> int:
        """A damper between two markers, the same in x and y, N s/m."""
        return int(
            self.mbs.AddObject(
                self.item.CartesianSpringDamper(
                    markerNumbers=[inner, outer], stiffness=[0.0] * 3, damping=[damping, damping, 0.0]
                )
            )
        )

    def watch_force(self, connector: int) -> int:
        """A sensor of a connector's force, x and y in N."""
        return self._watch(self.item.SensorObject, "Force", objectNumber=connector)

    def watch_coordinates(self, node: int) -> int:
        """A sensor of a node's coordinates."""
        return self._watch(self.item.SensorNode, "Coordinates", nodeNumber=node)

    def _watch(self, kind: Any, quantity: str, **of: int) -> int:
        output = getattr(self.exu.OutputVariableType, quantity)
        return int(self.mbs.AddSensor(kind(storeInternal=True, outputVariableType=output, **of)))

    def solve(self, step: float, count: int) -> None:
        """Go `count` steps of `step` s by velocity Verlet, storing every one."""
        self.mbs.Assemble()
        settings = self.exu.SimulationSettings()
        integration = settings.timeIntegration
        integration.numberOfSteps = count
        integration.endTime = count * step
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
        settings.solution.sensors.writePeriod = step
        self.mbs.SolveDynamic(settings, solverType=self.exu.DynamicSolverType.VelocityVerlet)

    def forget(self) -> None:
        """Let go of what the sensors stored, hundreds of MB, which Exudyn holds on to."""
        self._container.Reset()

    def stored(self, sensor: int) -> Array:
        """What a sensor stored at each step, shape (n, columns)."""
        return np.array(self.mbs.GetSensorStoredData(sensor))[:, 1:]
