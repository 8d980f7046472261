"""What a switched linear system is, in the words of mechanics.

In each regime r the state x = [q, q'] obeys x' = A x + B u + c, where u are harmonic or constant excitations.
A regime ends where one of its events becomes positive; x carries over to the next regime unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Excitation:
    """One input u = Re(U exp(i `order` omega t)); order 0 is a constant. U may change during a run."""

    order: int


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
    """Regimes of one state vector of size `states`, driven by `excitations`, giving `outputs` rows."""

    states: int
    excitations: tuple[Excitation, ...]
    regimes: tuple[Regime, ...]
    outputs: int
    rest_regime: int = 0
