"""Crank angle between the marks of a once-per-revolution marker."""

from __future__ import annotations

from dataclasses import dataclass
from math import tau

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.angle.marker import Marks


@dataclass(frozen=True, slots=True)
class CrankAngle:
    """Crank angle in rad, unwrapped, NaN where no revolution was seen whole; shape (n,).

    `certain` is False there and in revolutions that begin or end with a mark that was put in.
    """

    angle_rad: NDArray[np.float64]
    certain: NDArray[np.bool_]


def crank_angle(marks: Marks, samples: ArrayLike) -> CrankAngle:
    """Angle at sample indices of shape (n,) (whole or not, on the marks' count), even within a revolution."""
    at = np.asarray(samples, np.float64)
    if len(marks) < 2:
        return CrankAngle(np.full(at.shape, np.nan), np.zeros(at.shape, np.bool_))
    turn = np.clip(np.searchsorted(marks.position, at, side="right") - 1, 0, len(marks) - 2)
    start, end = marks.position[turn], marks.position[turn + 1]
    seen = (at >= marks.position[0]) & (at <= marks.position[-1]) & ~marks.restart[turn + 1]
    angle = tau * (marks.turn[turn] + (at - start) / (end - start))
    put_in = marks.interpolated[turn] | marks.interpolated[turn + 1]
    return CrankAngle(np.where(seen, angle, np.nan), seen & ~put_in)
