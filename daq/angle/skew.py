"""Time skew of an encoder against the card, from the once-per-revolution mark that the card sampled.

An encoder that is late by s and mounted at an angle p shows at the mark p - omega s. At one speed the two
cannot be told apart; at two, the slope over the speed is the skew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import tau

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]

_HALF_WINDOW = 1 / 16
"""Of a revolution, on either side of the mark: over it the encoder's counts average out."""
_FEWEST_READINGS = 6
_SPEEDS_APART = 1.1
"""Largest over smallest speed from which they count as two: nearer, any lag that grows with speed by other
ways (eccentric coupling, filter) is as large as what the skew adds."""
_COVERED = 0.95


@dataclass(frozen=True, slots=True)
class AtMark:
    """What an encoder showed at marks, every array of shape (m,): speed in rad/s, angle past the mark in rad.

    `shared_rad` is a standard uncertainty that all of the angles may share: where a revolution is a whole
    number of samples, each mark falls alike between them, and no number of marks makes that better.
    """

    speed_rad_s: Array
    angle_rad: Array
    shared_rad: float


@dataclass(frozen=True, slots=True)
class Skew:
    """An encoder against the marker: it shows the angle of `skew_s` ago, turned by `angle_rad`.

    Uncertainties are half widths of 95 % intervals. At one speed both are None, and only `at_mark_rad`,
    what the encoder shows at the mark at `speed_rad_s`, is known: the angle less speed times skew.
    """

    skew_s: float | None
    skew_uncertainty_s: float | None
    angle_rad: float | None
    angle_uncertainty_rad: float | None
    at_mark_rad: float
    at_mark_uncertainty_rad: float
    speed_rad_s: float
    revolutions: int

    @property
    def separable(self) -> bool:
        """Whether the speeds told skew and angle apart."""
        return self.skew_s is not None

    def __str__(self) -> str:
        if self.skew_s is None or self.skew_uncertainty_s is None:
            return (
                f"at {self.speed_rad_s:.1f} rad/s alone, skew and mounting angle cannot be told apart: "
                f"angle - speed x skew = {self.at_mark_rad:.5f} +- {self.at_mark_uncertainty_rad:.5f} rad; "
                "record a second speed"
            )
        return f"encoder late by {self.skew_s * 1e6:.1f} +- {self.skew_uncertainty_s * 1e6:.1f} us"


def angles_at_marks(
    encoder_s: Array, encoder_rad: Array, mark_s: Array, count_rad: float, mark_uncertainty_s: float
) -> AtMark:
    """What the encoder shows at each mark that was seen.

    `encoder_s` (n,), `mark_s` (m,): times on the time base, in order; `encoder_rad` (n,): unwrapped;
    `count_rad`: one count of the encoder; `mark_uncertainty_s`: standard uncertainty of a mark's time (a
    rectangular mark: the card's sample interval over root 12; one behind an anti-alias filter: some 0.03 of
    it). A straight line through the readings around a mark gives its angle; marks with too few around them
    are left out.
    """
    speeds, angles, readings = [], [], []
    turn_s = float(np.median(np.diff(mark_s))) if len(mark_s) > 1 else 0.0
    for at in mark_s:
        low, high = np.searchsorted(encoder_s, [at - _HALF_WINDOW * turn_s, at + _HALF_WINDOW * turn_s])
        if high - low < _FEWEST_READINGS or low == 0 or high == len(encoder_s):
            continue
        speed, angle = np.polyfit(encoder_s[low:high] - at, encoder_rad[low:high], 1)
        speeds.append(speed)
        angles.append(angle)
        readings.append(high - low)
    speed_rad_s = np.array(speeds)
    usual = float(np.median(np.abs(speed_rad_s))) if speeds else 0.0
    counts_rad = count_rad / np.sqrt(12 * np.median(readings)) if speeds else 0.0
    return AtMark(speed_rad_s, np.mod(angles, tau), float(np.hypot(counts_rad, usual * mark_uncertainty_s)))


def find_skew(recordings: Sequence[AtMark]) -> Skew | None:
    """Skew and mounting angle from one recording or several, between which the encoder kept both.

    The encoder has to count the way the shaft turns. None where no mark lay within the encoder's readings.
    """
    speed = np.concatenate([each.speed_rad_s for each in recordings])
    if not len(speed):
        return None
    angle = np.concatenate([each.angle_rad for each in recordings])
    angle = angle[0] + np.mod(angle - angle[0] + tau / 2, tau) - tau / 2
    shared = [np.repeat([0.0, each.shared_rad, 0.0], lengths) for each, lengths in _places(recordings)]
    apart = float(np.max(np.abs(speed)) / np.min(np.abs(speed)))
    design = np.column_stack([np.ones(len(speed)), speed - speed.mean()])
    design = design if apart >= _SPEEDS_APART and len(speed) > 2 else design[:, :1]
    values, covariance, quantile = _fit(design, angle, np.array(shared))
    mean, speed_mean = float(np.mod(values[0] + tau / 2, tau) - tau / 2), float(speed.mean())
    at_mark = (mean, quantile * float(np.sqrt(covariance[0, 0])), speed_mean, len(speed))
    if design.shape[1] == 1:
        return Skew(None, None, None, None, *at_mark)
    to_zero = np.array([1.0, -speed_mean])
    return Skew(
        -float(values[1]),
        quantile * float(np.sqrt(covariance[1, 1])),
        mean - speed_mean * float(values[1]),
        quantile * float(np.sqrt(to_zero @ covariance @ to_zero)),
        *at_mark,
    )


def _places(recordings: Sequence[AtMark]) -> list[tuple[AtMark, tuple[int, int, int]]]:
    """Each recording with how many marks come before, in and after it."""
    lengths = [len(each.speed_rad_s) for each in recordings]
    before = np.cumsum([0, *lengths])
    return [
        (each, (int(before[at]), lengths[at], int(before[-1] - before[at + 1])))
        for at, each in enumerate(recordings)
    ]


def _fit(design: Array, angle: Array, shared: Array) -> tuple[Array, Array, float]:
    """Least squares; the covariance has the scatter of the marks and, whole, what each recording's share."""
    inverse = np.linalg.pinv(design)
    values = inverse @ angle
    freedom = max(len(angle) - design.shape[1], 1)
    residual = angle - design @ values
    common = inverse @ shared.T
    covariance = residual @ residual / freedom * (inverse @ inverse.T) + common @ common.T
    return values, covariance, float(stats.t.ppf((1 + _COVERED) / 2, freedom))
