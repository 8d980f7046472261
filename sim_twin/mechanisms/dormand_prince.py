"""One Dormand-Prince 5(4) step and its dense output (10.1016/0771-050X(80)90013-3).

Dense output of fourth order: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.6.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sim_twin.compiled import generic, mechanical
from sim_twin.mechanisms.run import Real, Run

Rates = Callable[..., None]
"""rates(p, t, y, v0, dy, force)"""

_C2, _C3, _C4, _C5 = 1 / 5, 3 / 10, 4 / 5, 8 / 9
LATE = _C4
"""Fraction of the step that `Run.late_force` belongs to."""
_A21 = 1 / 5
_A31, _A32 = 3 / 40, 9 / 40
_A41, _A42, _A43 = 44 / 45, -56 / 15, 32 / 9
_A51, _A52, _A53, _A54 = 19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729
_A61, _A62, _A63, _A64, _A65 = 9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656
_B1, _B3, _B4, _B5, _B6 = 35 / 384, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84
_E1, _E3, _E4, _E5 = 71 / 57600, -71 / 16695, 71 / 1920, -17253 / 339200
_E6, _E7 = 22 / 525, -1 / 40
_D1, _D3, _D4 = -12715105075 / 11282082432, 87487479700 / 32700410799, -10690763975 / 1880347072
_D5, _D6, _D7 = 701980252875 / 199316789632, -1453857185 / 822651844, 69997945 / 29380423


@generic
def attempt(rates: Rates, p: Any, run: Run, t: float, h: float) -> None:
    """Take a step of `h` s from `run.y` at `t` into `run.trial`, with its slopes (the first is there)."""
    y, trial, k, v0, force = run.y, run.trial, run.slopes, run.latched, run.new_force
    n = y.size
    for i in range(n):
        trial[i] = y[i] + h * _A21 * k[0, i]
    rates(p, t + _C2 * h, trial, v0, k[1], force)
    for i in range(n):
        trial[i] = y[i] + h * (_A31 * k[0, i] + _A32 * k[1, i])
    rates(p, t + _C3 * h, trial, v0, k[2], force)
    for i in range(n):
        trial[i] = y[i] + h * (_A41 * k[0, i] + _A42 * k[1, i] + _A43 * k[2, i])
    rates(p, t + _C4 * h, trial, v0, k[3], run.late_force)
    for i in range(n):
        trial[i] = y[i] + h * (_A51 * k[0, i] + _A52 * k[1, i] + _A53 * k[2, i] + _A54 * k[3, i])
    rates(p, t + _C5 * h, trial, v0, k[4], force)
    for i in range(n):
        slope = _A61 * k[0, i] + _A62 * k[1, i] + _A63 * k[2, i] + _A64 * k[3, i] + _A65 * k[4, i]
        trial[i] = y[i] + h * slope
    rates(p, t + h, trial, v0, k[5], force)
    for i in range(n):
        slope = _B1 * k[0, i] + _B3 * k[2, i] + _B4 * k[3, i] + _B5 * k[4, i] + _B6 * k[5, i]
        trial[i] = y[i] + h * slope
    rates(p, t + h, trial, v0, k[6], force)


@mechanical
def squared_error(k: Real, h: float, tolerance: Real) -> float:
    """Mean square of the step's error over `tolerance`."""
    total = 0.0
    for i in range(tolerance.size):
        slope = _E1 * k[0, i] + _E3 * k[2, i] + _E4 * k[3, i] + _E5 * k[4, i]
        ratio = h * (slope + _E6 * k[5, i] + _E7 * k[6, i]) / tolerance[i]
        total += ratio * ratio
    return total / tolerance.size


@mechanical
def set_dense(run: Run, h: float) -> None:
    """Work out the coefficients of the dense output of the step from `run.y` to `run.trial`."""
    y, trial, k, c = run.y, run.trial, run.slopes, run.dense
    for i in range(y.size):
        change = trial[i] - y[i]
        bend = h * k[0, i] - change
        last = _D1 * k[0, i] + _D3 * k[2, i] + _D4 * k[3, i] + _D5 * k[4, i] + _D6 * k[5, i] + _D7 * k[6, i]
        c[0, i], c[1, i], c[2, i] = y[i], change, bend
        c[3, i], c[4, i] = change - h * k[6, i] - bend, h * last


@mechanical
def dense(c: Real, x: float, y: Real) -> None:
    """Write the state at the fraction `x` of the step to `y` (n,)."""
    rest = 1.0 - x
    for i in range(y.size):
        y[i] = c[0, i] + x * (c[1, i] + rest * (c[2, i] + x * (c[3, i] + rest * c[4, i])))
