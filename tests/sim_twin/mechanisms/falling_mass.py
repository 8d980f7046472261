"""The least mechanism: a mass that falls on a floor. For measuring contact laws, and as a pattern for others.

State: height (m), speed (m/s), energy lost (J).
"""

from __future__ import annotations

from typing import NamedTuple

from sim_twin.compiled import mechanical
from sim_twin.contact import ContactLaw, contact_forces
from sim_twin.lane_array import in_lanes
from sim_twin.mechanisms.integrator import integrate
from sim_twin.mechanisms.lane_integrator import advance_lanes, begin_lanes
from sim_twin.mechanisms.lane_run import LaneRun, Lanes
from sim_twin.mechanisms.lanes import Kernel
from sim_twin.mechanisms.run import Real, Run, StepLimits
from sim_twin.vector import touches


class FallingMass(NamedTuple):
    """`mass` kg under `gravity` m/s2, and the floor's `law`."""

    mass: float
    gravity: float
    law: ContactLaw


@mechanical
def rates(p: FallingMass, t: float, y: Real, v0: Real, dy: Real, force: Real) -> None:
    """Newton's law."""
    force[0], elastic = 0.0, 0.0
    if touches(v0[0]):
        force[0], elastic = contact_forces(p.law, -y[0], -y[1], v0[0])
    dy[0], dy[1] = y[1], force[0] / p.mass - p.gravity
    dy[2] = -(force[0] - elastic) * y[1]


@mechanical
def depths(p: FallingMass, t: float, y: Real, d: Real, rate: Real) -> None:
    """Penetration of the floor and its rate."""
    d[0], rate[0] = -y[0], -y[1]


@mechanical
def observe(p: FallingMass, t: float, y: Real, v0: Real, out: Real, column: int) -> None:
    """Height, speed, and the floor's force in N."""
    out[0, column], out[1, column], out[2, column] = y[0], y[1], 0.0
    if touches(v0[0]):
        out[2, column], _ = contact_forces(p.law, -y[0], -y[1], v0[0])


@mechanical
def run(p: FallingMass, state: Run, limits: StepLimits, dt: float, out: Real, episodes: Real) -> int:
    """`integrate` for this mechanism."""
    return integrate(rates, depths, observe, p, state, limits, dt, out, episodes)


@mechanical
def begin(like: FallingMass, table: Lanes, state: LaneRun, limits: StepLimits) -> None:
    """`begin_lanes` for this mechanism."""
    begin_lanes(rates, depths, in_lanes(table, like), state, limits)


@mechanical
def advance(
    like: FallingMass, table: Lanes, each: Lanes, state: LaneRun, limits: StepLimits, dt: float, first: int,
    out: Real,
) -> None:  # fmt: skip
    """`advance_lanes` for this mechanism."""
    advance_lanes(rates, depths, observe, like, table, each, state, limits, dt, first, out)


SIDE_BY_SIDE = Kernel(begin, advance, contacts=1, outputs=3)
