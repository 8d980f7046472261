"""Where each sample lies in the cycle of a drive or the revolution of a crank, counted in turns.

A turn is one cycle of the drive from the rising zero of its sine, or one revolution from crank angle 0. All
cyclic functions (averages, resampling, orders, figures of a cycle) take the turns of their samples: float64,
unwrapped, one a sample, on the same clock. The whole part is the number of the cycle, the rest the phase in
it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, signal

_CUBIC = 3


def angle_turns(angle: NDArray[np.floating]) -> NDArray[np.float64]:
    """Turns of samples whose unwrapped crank angle in rad, shape (n,), was taken with them."""
    return np.asarray(angle, dtype=np.float64) / (2 * np.pi)


def turns_at(
    times: NDArray[np.floating], known_times: NDArray[np.floating], known_turns: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Turns at `times` in s, shape (n,), from those known at other times, both of shape (k,).

    A cubic spline through the known ones, exact up to an angular acceleration that grows evenly; NaN before
    the first and after the last. `known_times` must grow. With a mark each revolution `known_turns` is 0, 1,
    2 ...: a straight line between marks would be off by (acceleration x interval^2)/8, 3 to 4 degrees early
    in a run-up from 300 to 1500 rpm within 10 s.
    """
    if len(known_times) <= 1:
        return np.full(len(times), np.nan)
    spline = interpolate.CubicSpline(known_times, known_turns, extrapolate=False)
    return np.asarray(spline(times), dtype=np.float64)


def smooth_turns(turns: NDArray[np.floating], samples: int) -> NDArray[np.float64]:
    """Turns less the steps of an encoder that counts: local cubics over an odd number of `samples`.

    The stretch should hold tens of counts and be short against the fastest change of speed that is to stay.
    Savitzky and Golay 1964, doi:10.1021/ac60214a047.
    """
    return np.asarray(signal.savgol_filter(np.asarray(turns, dtype=np.float64), samples, _CUBIC))
