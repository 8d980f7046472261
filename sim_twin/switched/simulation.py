"""What a switched linear system is, in the words of mechanics; and one in motion.

In each regime r the state x = [q, q'] obeys x' = A x + B u + c, where u are harmonic or constant excitations.
A regime ends where one of its events becomes positive; x carries over to the next regime unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sim_twin.switched.tables import Tables

Array = NDArray[np.float64]
_MOST_SWITCHES_A_STEP = 0.5


@dataclass(frozen=True, slots=True)
class Row:
    """A scalar of the motion: position . x + rate . x' + drive . u + residual R + constant.

    `position` and `rate` have shape (2 n,), `drive` one entry for each excitation; R is the regime's residual
    force (what it adds to x' through `rate` is counted by itself).
    """

    position: Array
    constant: float = 0.0
    rate: Array | None = None
    drive: Array | None = None
    residual: float = 0.0


@dataclass(frozen=True, slots=True)
class Event:
    """The regime ends for `target` as soon as `condition`, and `also` if there is one, is positive."""

    condition: Row
    target: int
    also: Row | None = None


@dataclass(frozen=True, slots=True)
class Output:
    """A recorded scalar that exists in this regime (elsewhere it is 0); `index` is its row in the trace."""

    index: int
    row: Row


@dataclass(frozen=True, slots=True)
class Residual:
    """A force beyond the linear law: `stiffness` d^1.5 - `linear` d, where d = `penetration` > 0.

    It acts on x' through `direction`, shape (2 n,).
    """

    stiffness: float
    linear: float
    penetration: Row
    direction: Array


@dataclass(frozen=True, slots=True)
class Regime:
    """x' = A x + B u + c, its events and its outputs.

    Where a `constraint` holds a part of x, A, B and c are those of the part y that still moves.
    """

    A: Array
    B: Array
    c: Array
    events: tuple[Event, ...]
    outputs: tuple[Output, ...] = ()
    residual: Residual | None = None
    constraint: Constraint | None = None


@dataclass(frozen=True, slots=True)
class Constraint:
    """A held scalar a = `captured` . x: x = `basis` y + `direction` a, y' = A y + B u + c + `coupling` a."""

    basis: Array
    captured: Array
    direction: Array
    coupling: Array


@dataclass(frozen=True, slots=True)
class SwitchedSystem:
    """Regimes of one state vector of size `states`, driven by inputs of some `orders`, giving `outputs` rows.

    Input k is Re(U_k exp(i `orders`[k] omega t)); order 0 is a constant. U may change during a run.
    """

    states: int
    orders: tuple[int, ...]
    regimes: tuple[Regime, ...]
    outputs: int
    rest_regime: int = 0


@dataclass(frozen=True, slots=True)
class Trace:
    """Outputs at times start + k `step`, shape (outputs, n), and the switches in between (s since rest)."""

    start: float
    step: float
    outputs: NDArray[np.float64]
    switch_times: NDArray[np.float64]
    switch_regimes: NDArray[np.int64]
    switches: int


class Simulation:
    """One run of `system` from rest at t = 0, sampled every `step` seconds.

    The excitations are U_k exp(i order_k (omega (t - t0) + phase)); `drive` may change them at any time.
    """

    def __init__(self, system: SwitchedSystem, step: float) -> None:
        self.system, self.step = system, step
        self.time = 0.0
        self._samples = 0
        self._x = np.zeros(system.states)
        self._regime = system.rest_regime
        self._amplitudes = np.zeros(len(system.orders), dtype=complex)
        self._omega, self._phase, self._reference = 1.0, 0.0, 0.0
        self._tables: Tables | None = None

    def drive(
        self,
        amplitudes: NDArray[np.complex128],
        omega: float,
        phase: float = 0.0,
        reference: float | None = None,
    ) -> None:
        """Set the excitations from now on; the motion itself stays continuous.

        `omega` in rad/s; `phase` in rad is the fundamental's at time `reference` in s (default: now).
        """
        if omega != self._omega:
            self._tables = None
        self._amplitudes = np.asarray(amplitudes, dtype=complex)
        self._omega, self._phase = omega, phase
        self._reference = self.time if reference is None else reference

    def advance(self, count: int) -> Trace:
        """Advance by `count` steps; the trace starts now and ends one step before the new present."""
        # The compiler is loaded by what moves, not by what only looks whether a system can be set up.
        from sim_twin.switched.kernel import run
        from sim_twin.switched.tables import build_tables

        if self._tables is None:
            self._tables = build_tables(self.system, self._omega, self.step)
        out = np.zeros((max(1, self.system.outputs), count))
        room = 64 + int(count * _MOST_SWITCHES_A_STEP)
        times, regimes = np.zeros(room), np.zeros(room, dtype=np.int64)
        angle = self._omega * (self.time - self._reference) + self._phase
        u = np.asarray(self._amplitudes * np.exp(1j * np.array(self.system.orders) * angle))
        start = self.time
        self._regime, switches = run(
            self._tables, self._x, self._regime, u.real.copy(), u.imag.copy(), out, times, regimes
        )
        self._samples += count
        self.time = self._samples * self.step
        kept = min(switches, room)
        return Trace(start, self.step, out, start + times[:kept] * self.step, regimes[:kept], switches)

    @property
    def samples(self) -> int:
        """How many steps it has been advanced by."""
        return self._samples

    @property
    def state(self) -> NDArray[np.float64]:
        """The present state x = [q, q'], a copy of shape (states,)."""
        return self._x.copy()
