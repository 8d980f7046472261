"""Energy: what comes in at the drive is stored, or lost in modes and contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson

from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive, nominal
from sim_twin.switched import Simulation

RATE = 204_800.0


class Ledger:
    """Energies and powers of a state of the rigid-base beam, from its own matrices."""

    def __init__(self, rig: ImpactBeam) -> None:
        self.rig, self.system = rig, assemble(rig, (1,))
        free = self.system.regimes[0]
        self.n = len(free.A) // 2
        self.K, self.C = -free.A[self.n :, : self.n], -free.A[self.n :, self.n :]
        self.drive = free.B[self.n :, 0]
        self.tip = free.events[0].condition.position[: self.n]

    def depths(self, x: np.ndarray) -> np.ndarray:
        """Depth in the upper and in the lower stop, m."""
        w = x[:, : self.n] @ self.tip
        return np.maximum(np.stack([w, -w]) - self.rig.clearance, 0.0)

    def stored(self, x: np.ndarray) -> np.ndarray:
        q, v = x[:, : self.n], x[:, self.n :]
        return 0.5 * np.sum(v**2, axis=1) + 0.5 * np.einsum("ti,ij,tj->t", q, self.K, q)

    def losses(self, x: np.ndarray) -> np.ndarray:
        v = x[:, self.n :]
        return np.einsum("ti,ij,tj->t", v, self.C, v)


def states(simulation: Simulation, count: int) -> tuple[np.ndarray, np.ndarray]:
    """States and outputs at the next `count` steps."""
    x, outputs = [], []
    for _ in range(count):
        x.append(simulation.state)
        outputs.append(simulation.advance(1).outputs[:, 0])
    return np.array(x), np.array(outputs).T


def test_power_balance_over_one_impact() -> None:
    ledger = Ledger(nominal())
    step = 1 / (16 * RATE)
    simulation = Simulation(ledger.system, step)
    omega = 2 * np.pi * 20.0
    simulation.drive(SineDrive(9.0, 20.0).phasors()[1:2], omega)
    simulation.advance(round(4.4e-3 / step))
    times = simulation.time + step * np.arange(round(0.535e-3 / step))
    x, (upper, _, _) = states(simulation, len(times))
    v = x[:, ledger.n :]
    put_in = 9.0 * np.sin(omega * times) * (v @ ledger.drive)
    lost = ledger.losses(x) + upper * (v @ ledger.tip)
    stored = ledger.stored(x)
    assert upper[0] == upper[-1] == 0.0
    assert upper.max() > 28.0
    change = stored[-1] - stored[0]
    given = simpson(put_in - lost, dx=step)
    # The jump of the damper's 2 N at the onset falls within a step of 0.3 us: some 2e-8 J of 0.45 mJ.
    assert change == pytest.approx(given, abs=1e-4 * stored.max())
    assert abs(change) > 0.01 * stored.max()


def test_a_long_run_without_losses_keeps_its_energy() -> None:
    rig = replace(nominal(damping=0.0), contact_damping=0.0)
    ledger = Ledger(rig)
    simulation = Simulation(ledger.system, 1 / RATE)
    simulation.drive(SineDrive(9.0, 20.0).phasors()[1:2], 2 * np.pi * 20.0)
    simulation.advance(round(0.03 * RATE))
    simulation.drive(np.zeros(1, complex), 2 * np.pi * 20.0)
    x, impacts = [simulation.state], 0
    for _ in range(200):
        impacts += simulation.advance(4096).switches
        x.append(simulation.state)
    energy = ledger.stored(np.array(x))
    energy += 0.5 * rig.contact_stiffness * np.sum(ledger.depths(np.array(x)) ** 2, axis=0)
    assert impacts > 1000
    # Each switch is up to 0.3 ns late, which always gains energy: 9e-10 of it in 3,236 switches.
    assert energy / energy[0] == pytest.approx(np.ones(len(energy)), abs=1e-8)


def test_contact_damping_alone_can_only_lose_energy() -> None:
    ledger = Ledger(nominal(damping=0.0))
    simulation = Simulation(ledger.system, 1 / RATE)
    simulation.drive(SineDrive(9.0, 20.0).phasors()[1:2], 2 * np.pi * 20.0)
    simulation.advance(round(0.03 * RATE))
    simulation.drive(np.zeros(1, complex), 2 * np.pi * 20.0)
    x = [simulation.state]
    for _ in range(200):
        simulation.advance(512)
        x.append(simulation.state)
    motion = np.array(x)
    total = ledger.stored(motion)
    total += 0.5 * ledger.rig.contact_stiffness * np.sum(ledger.depths(motion) ** 2, axis=0)
    assert np.diff(total).max() < 1e-6 * total[0]
    assert total[-1] < 0.5 * total[0]
