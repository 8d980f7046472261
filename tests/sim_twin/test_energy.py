"""Energy: what comes in at the drive is stored, or lost in modes and contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from sim_twin.rigs.impact_beam.assembly import assemble
from sim_twin.rigs.impact_beam.model import ImpactBeam, SineDrive, nominal
from sim_twin.switched.simulation import Simulation

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


NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)


class Driven:
    """The motion between switches by the matrix exponential of the ledger's own matrices, drive included."""

    def __init__(self, ledger: Ledger, amplitude: float, omega: float) -> None:
        self.ledger, self.amplitude, self.omega = ledger, amplitude, omega
        self.n = ledger.n
        self._turns: dict[tuple[int, float], list[np.ndarray]] = {}

    def turns(self, side: int, span: float) -> list[np.ndarray]:
        """exp(M t) at the quadrature's instants and at the end of `span`, which is rounded to 0.01 ps."""
        key = side, round(span, 14)
        if key not in self._turns:
            instants = (*(NODES + 1) / 2 * key[1], key[1])
            self._turns[key] = [expm(self.rates(side) * instant) for instant in instants]
        return self._turns[key]

    def rates(self, side: int) -> np.ndarray:
        """z' = M z with z = [q, q', sin p, cos p, 1]; `side` +1, -1 in contact, else 0."""
        rig, n = self.ledger.rig, self.n
        k, c, tip = side**2 * rig.contact_stiffness, side**2 * rig.contact_damping, self.ledger.tip
        M = np.zeros((2 * n + 3, 2 * n + 3))
        M[:n, n : 2 * n] = np.eye(n)
        M[n : 2 * n, :n] = -self.ledger.K - k * np.outer(tip, tip)
        M[n : 2 * n, n : 2 * n] = -self.ledger.C - c * np.outer(tip, tip)
        M[n : 2 * n, 2 * n] = self.amplitude * self.ledger.drive
        M[n : 2 * n, -1] = side * k * rig.clearance * tip
        M[2 * n, 2 * n + 1], M[2 * n + 1, 2 * n] = self.omega, -self.omega
        return M

    def power(self, z: np.ndarray, side: int) -> float:
        """What drive, modes and stop put into the beam, W."""
        rig, x = self.ledger.rig, z[None, : 2 * self.n]
        v = x[0, self.n :]
        w, speed = float(x[0, : self.n] @ self.ledger.tip), float(v @ self.ledger.tip)
        push = rig.contact_stiffness * (side * w - rig.clearance) + rig.contact_damping * side * speed
        given = self.amplitude * z[2 * self.n] * float(v @ self.ledger.drive)
        return given - float(self.ledger.losses(x)[0]) - (side * push * speed if side else 0.0)

    def work(self, z: np.ndarray, side: int, span: float) -> tuple[float, np.ndarray]:
        """Work over `span` s from z on, in J, and z at its end. Gauss: the fastest mode turns by 1.2 rad."""
        *within, end = (turn @ z for turn in self.turns(side, span))
        return float(WEIGHTS @ [self.power(each, side) for each in within]) * span / 2, end


def test_power_balance_over_each_impact() -> None:
    ledger = Ledger(nominal())
    omega, step = 2 * np.pi * 20.0, 1 / RATE
    beam, simulation = Driven(ledger, 9.0, omega), Simulation(ledger.system, step)
    simulation.drive(SineDrive(9.0, 20.0).phasors()[1:2], omega)
    simulation.advance(round(4.4e-3 * RATE))
    side, work, begun, open_since, balances, largest = 0, 0.0, 0.0, 0, [], 0.0
    for _ in range(round(2.6e-3 * RATE)):
        x, start = simulation.state, simulation.time
        energy = float(ledger.stored(x[None])[0])
        largest = max(largest, energy)
        if side == 0 and open_since:
            balances.append(energy - begun - work)
            open_since = 0
        if side == 0:
            work, begun = 0.0, energy
        trace = simulation.advance(1)
        z = np.concatenate([x, [np.sin(omega * start), np.cos(omega * start), 1.0]])
        switches = zip(trace.switch_times, trace.switch_regimes, strict=True)
        now = start
        for when, regime in [*switches, (start + step, -1)]:
            done, z = beam.work(z, side, when - now)
            work, now = work + done, when
            if regime >= 0:
                side, open_since = (0, 1, -1)[regime], 1
    assert len(balances) >= 4
    # Closed to a millionth of the largest energy. A switch is at most 0.3 ns late, with 2 N at 0.1 m/s: a
    # tenth of that at most.
    assert np.array(balances) == pytest.approx(np.zeros(len(balances)), abs=1e-6 * largest)


def test_a_whole_run_without_losses_keeps_its_energy() -> None:
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
    # 1e-6 is asked for. Each switch is up to 0.3 ns late, which always gains energy: 9e-10 in 3,236 switches.
    assert energy / energy.max() == pytest.approx(np.full(len(energy), energy[0] / energy.max()), abs=1e-8)


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
