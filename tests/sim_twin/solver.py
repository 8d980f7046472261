"""The twin's solver without sensors, as the tests ask for it."""

from __future__ import annotations

import numpy as np

from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive
from sim_twin.switched.simulation import Simulation, Trace

RATE = 204_800.0
ORDERS = (0, 1, 2, 3)


def driven(
    rig: ImpactBeam, drive: SineDrive, rate: float = RATE, orders: tuple[int, ...] = ORDERS
) -> Simulation:
    simulation = Simulation(assemble(rig, orders), 1 / rate)
    simulation.drive(drive.phasors()[list(orders)], 2 * np.pi * drive.frequency)
    return simulation


def solve(rig: ImpactBeam, drive: SineDrive, seconds: float, rate: float = RATE) -> Trace:
    """From rest, `seconds` long."""
    return driven(rig, drive, rate).advance(round(seconds * rate))
