"""Motion of the table and of the mass on it, by the classical Runge-Kutta method.

m x'' = -k (x - y) - c (x' - y') - N
M y'' = F + k (x - y) + c (x' - y') + N - K y - C y'
N = max(0, k_s d + c_s d'), d = x - y - gap > 0
"""

from __future__ import annotations

from math import sin, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.errors import SimulationFailed
from sim_twin.compiled import compiled
from sim_twin.rigs.rig_model import SolverValues
from sim_twin.status import Status
from sim_twin.twin import AnyTwin

Array = NDArray[np.float64]
RATE = 204_800.0


@compiled
def _force(rig: Array, s: Array) -> float:
    deep, fast = s[0] - s[1] - rig[3], s[2] - s[3]
    return max(0.0, rig[4] * deep + rig[5] * fast) if deep > 0.0 else 0.0


@compiled
def _derivative(rig: Array, s: Array, drive: float, d: Array) -> None:
    spring = rig[1] * (s[0] - s[1]) + rig[2] * (s[2] - s[3]) + _force(rig, s)
    d[0], d[1] = s[2], s[3]
    d[2] = -spring / rig[0]
    d[3] = (drive + spring - rig[7] * s[1] - rig[8] * s[3]) / rig[6]


@compiled
def _drive(sine: Array, t: float) -> float:
    p = sine[1] * t + sine[2]
    return sine[3] + sine[0] * (sin(p) + sine[4] * sin(2 * p) + sine[5] * sin(3 * p))


@compiled
def _advance(rig: Array, sine: Array, s: Array, first: int, h: float, outputs: Array) -> None:
    a, b, c, d = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for k in range(outputs.shape[1]):
        t = (first + k) * h
        now, half, after = _drive(sine, t), _drive(sine, t + h / 2), _drive(sine, t + h)
        _derivative(rig, s, now, a)
        outputs[0, k], outputs[1, k], outputs[2, k] = now, _force(rig, s), a[3]
        _derivative(rig, s + h / 2 * a, half, b)
        _derivative(rig, s + h / 2 * b, half, c)
        _derivative(rig, s + h * c, after, d)
        s += h / 6 * (a + 2 * b + 2 * c + d)


class TableTruth:
    """From rest; nothing moves until the first drive."""

    def __init__(self, twin: AnyTwin, rate: float, drive_changes: bool = False) -> None:
        r = twin.rig
        self._rig = np.array(
            (
                *(r.mass, r.stiffness, r.damping, r.gap, r.contact_stiffness, r.contact_damping),
                *(r.table_mass, r.table_stiffness, r.table_damping),
            )
        )
        self._sine, self._state, self._steps, self._rate = np.zeros(6), np.zeros(4), 0, rate

    def change_drive(self, drive: Any, phase: float, reference: float) -> None:
        omega = tau * drive.frequency
        phase_0 = phase - omega * reference
        sine = [drive.amplitude, omega, phase_0, drive.offset, drive.second, drive.third]
        self._sine = np.array(sine)

    def advance(self, steps: int) -> Array:
        outputs = np.zeros((3, steps))
        _advance(self._rig, self._sine, self._state, self._steps, 1 / self._rate, outputs)
        self._steps += steps
        return outputs

    def shape(self) -> Array:
        """Where mass and table are, m, shape (2,)."""
        return self._state[:2].copy()

    @property
    def status(self) -> Status:
        return Status.COMPLETED if np.isfinite(self._state).all() else Status.DIVERGED


def solver_values(twin: AnyTwin, settle: float, duration: float) -> SolverValues:
    """Impacts and the largest force on the stop, over `duration` s after `settle` s."""
    truth = TableTruth(twin, RATE)
    truth.change_drive(twin.drive, 0.0, 0.0)
    force = truth.advance(round((settle + duration) * RATE))[1, round(settle * RATE) :]
    if truth.status is not Status.COMPLETED:
        raise SimulationFailed("the table's motion diverged", truth.status.advice, truth.status)
    touching = force > 0.0
    return {
        "impacts": int(np.count_nonzero(touching[1:] & ~touching[:-1])),
        "largest_n": float(force.max()) if touching.any() else None,
    }
