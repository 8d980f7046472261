"""Time skew of an encoder against the card, from the once-per-revolution mark that the card sampled.

An encoder that is late by s and mounted at an angle p shows at the mark p - omega s. At one speed the two
cannot be told apart; at two, the slope over the speed is the skew. How late it is differs from recording to
recording, for each places the encoder's clock against the card's anew: two speeds in one recording tell its
own skew as closely as the marks allow, and the mounting angle that they give tells that of every other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, tau

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]

_HALF_WINDOW = 1 / 16
"""Of a revolution, on either side of the mark: over it the encoder's counts average out."""
_FEWEST_READINGS = 6
_STEADY = 0.02
"""By how much the speed may change from mark to mark for both to belong to one dwell."""
_FEWEST_MARKS = 3
_SPEEDS_APART = 1.1
"""Largest over smallest speed from which they count as two: nearer, any lag that grows with speed by other
ways (eccentric coupling, filter) is as large as what the skew adds."""
_RATE_OFF = 1e-4
"""Standard deviation of the rate by which an encoder's time may still be off: two crystals, generously."""
_LEAST_SCATTER = 1e-6
"""rad: of marks that were computed and not measured."""
_ANYWHERE = 10.0
"""Standard deviation, in rad or s, of what is not known beforehand."""
_COVERED = 0.95


@dataclass(frozen=True, slots=True)
class AtMark:
    """What an encoder showed at the marks of one recording, arrays of shape (m,).

    `time_s` of the marks, `speed_rad_s`, and `angle_rad` past the mark. `counts_rad`: standard uncertainty of
    an angle by the encoder's counts; `mark_s`: of a mark's time, which the marks of a dwell may share: where
    a revolution is a whole number of samples, each falls alike between them. `placed_s`: standard
    uncertainty of where the recording places the encoder's clock.
    """

    time_s: Array
    speed_rad_s: Array
    angle_rad: Array
    counts_rad: float
    mark_s: float
    placed_s: float = 0.0

    @property
    def middle_s(self) -> float:
        """Mean time of the marks, s; 0 without any."""
        return float(np.mean(self.time_s)) if len(self.time_s) else 0.0


@dataclass(frozen=True, slots=True)
class RecordingSkew:
    """How late the encoder was in one recording at `at_s` of its marks' time; None where that cannot be told.

    `rate` is by how much it grew later, in s for each s: what the recording's placing of it left undone.
    """

    skew_s: float | None
    skew_uncertainty_s: float | None
    rate: float | None
    at_s: float
    speeds_rad_s: tuple[float, ...]
    revolutions: int


@dataclass(frozen=True, slots=True)
class Skew:
    """An encoder against the marker: it shows the angle of `skew_s` ago, turned by `angle_rad`.

    `skew_s` is the encoder's own, with the travel time of its fastest frame, which no arrival can tell from a
    lag, and less what delays the marker and was not taken out of its times; `recordings` has that of each,
    with how it placed the encoder's clock.
    Uncertainties are half widths of 95 % intervals. At one speed skew and angle are None, and only
    `at_mark_rad`, what the encoder shows at the mark at `speed_rad_s`, is known: angle less speed times skew.
    """

    skew_s: float | None
    skew_uncertainty_s: float | None
    angle_rad: float | None
    angle_uncertainty_rad: float | None
    at_mark_rad: float
    at_mark_uncertainty_rad: float
    speed_rad_s: float
    revolutions: int
    recordings: tuple[RecordingSkew, ...]

    def __str__(self) -> str:
        if self.skew_s is None or self.skew_uncertainty_s is None:
            return (
                f"at {self.speed_rad_s:.1f} rad/s alone, skew and mounting angle cannot be told apart: "
                f"angle - speed x skew = {self.at_mark_rad:.5f} +- {self.at_mark_uncertainty_rad:.5f} rad; "
                "record a second speed"
            )
        return f"encoder late by {late(self.skew_s, self.skew_uncertainty_s)}"


def late(skew_s: float, uncertainty_s: float) -> str:
    """A skew in words."""
    return f"{skew_s * 1e6:.1f} +- {uncertainty_s * 1e6:.1f} us"


def fastest_rad_s(period_s: float) -> float:
    """Speed in rad/s up to which an encoder that sends every `period_s` shows enough around a mark."""
    return tau * 2 * _HALF_WINDOW / ((_FEWEST_READINGS + 1) * period_s)


def angles_at_marks(
    encoder_s: Array,
    encoder_rad: Array,
    mark_s: Array,
    count_rad: float,
    mark_uncertainty_s: float,
    placed_s: float = 0.0,
) -> AtMark:
    """What the encoder shows at each mark that was seen.

    `encoder_s` (n,), `mark_s` (m,): times on the time base, in order; `encoder_rad` (n,): unwrapped;
    `count_rad`: one count of the encoder; `mark_uncertainty_s`: standard uncertainty of a mark's time (a
    rectangular mark: the card's sample interval over root 12; one behind an anti-alias filter: some 0.03 of
    it); `placed_s`: see `AtMark`. A straight line through the readings around a mark gives its angle; marks
    with too few around them are left out.
    """
    found: list[tuple[float, float, float]] = []
    readings = []
    gaps = np.diff(mark_s, prepend=-inf, append=inf)
    shorter = np.minimum(gaps[:-1], gaps[1:])  # of the intervals before and after each mark
    for at, turn_s in zip(mark_s, np.where(np.isfinite(shorter), shorter, 0.0), strict=True):
        low, high = np.searchsorted(encoder_s, [at - _HALF_WINDOW * turn_s, at + _HALF_WINDOW * turn_s])
        if high - low < _FEWEST_READINGS or low == 0 or high == len(encoder_s):
            continue
        speed, angle = np.polyfit(encoder_s[low:high] - at, encoder_rad[low:high], 1)
        found.append((float(at), float(speed), float(np.mod(angle, tau))))
        readings.append(high - low)
    time_s, speed_rad_s, angle_rad = np.array(found).reshape(-1, 3).T
    counts_rad = count_rad / float(np.sqrt(12 * np.median(readings))) if readings else 0.0
    return AtMark(time_s, speed_rad_s, angle_rad, counts_rad, mark_uncertainty_s, placed_s)


def find_skew(recordings: Sequence[AtMark]) -> Skew | None:
    """Skew and mounting angle from one recording or several, between which the encoder kept both.

    The encoder has to count the way the shaft turns. None where no mark lay within the encoder's readings.
    """
    dwells = []
    for at, marks in enumerate(recordings):
        # cut where the speed changes; marks that are fewer than a dwell has were passed on a ramp
        speed = marks.speed_rad_s
        cuts = np.flatnonzero(np.abs(np.diff(speed)) > _STEADY * np.abs(speed[:-1])) + 1
        for part in np.split(np.arange(len(speed)), cuts):
            if len(part) >= _FEWEST_MARKS:
                dwells.append(_Dwell(at, marks.time_s[part], speed[part], marks.angle_rad[part]))
    if not dwells:
        return None
    every = np.concatenate([dwell.speed_rad_s for dwell in dwells])
    model = _Model(recordings, dwells)
    at_mark = _wrapped(model.told(model.angle_at(float(every.mean()))))
    told_apart = np.max(np.abs(every)) >= _SPEEDS_APART * np.min(np.abs(every))
    each = []
    for at, recording in enumerate(recordings):
        own = [dwell.speed_rad_s for dwell in dwells if dwell.recording == at]
        told: tuple[float | None, float | None] = None, None
        rate = None
        if told_apart and own:
            told, rate = model.told(model.skew_of(at)), model.told(model.rate_of(at))[0]
        speeds = tuple(float(speed.mean()) for speed in own)
        each.append(RecordingSkew(*told, rate, recording.middle_s, speeds, sum(map(len, own))))
    if not told_apart:
        return Skew(None, None, None, None, *at_mark, float(every.mean()), len(every), tuple(each))
    angle = _wrapped(model.told(model.angle_at(0.0)))
    return Skew(*model.told(model.own_skew), *angle, *at_mark, float(every.mean()), len(every), tuple(each))


@dataclass(frozen=True, slots=True)
class _Dwell:
    """Marks at a speed that stays, of the recording with this number; arrays of shape (m,)."""

    recording: int
    time_s: Array
    speed_rad_s: Array
    angle_rad: Array


class _Model:
    """Angles at marks as a linear model: the mounting angle, the encoder's own skew, and what differs.

    By recording: how it places the encoder's clock, and by how much its rate is off. By dwell: where the
    marks fall between the card's samples, and the counts. The last ones are held near zero by what is known
    of them, and the scatter of the marks is what a fit leaves that takes each recording as it comes.
    """

    def __init__(self, recordings: Sequence[AtMark], dwells: Sequence[_Dwell]) -> None:
        count = len(recordings)
        self._place, self._rate = 2, 2 + count
        width = 2 + 2 * count + 2 * len(dwells)
        speed = np.concatenate([dwell.speed_rad_s for dwell in dwells])
        angle = np.concatenate([dwell.angle_rad for dwell in dwells])
        angle = angle[0] + np.mod(angle - angle[0] + tau / 2, tau) - tau / 2
        design = np.zeros((len(speed), width))
        design[:, 0], design[:, 1] = 1.0, -speed
        known = np.full(width, _ANYWHERE)
        row = 0
        for at, dwell in enumerate(dwells):
            here, recording = slice(row, row := row + len(dwell.speed_rad_s)), recordings[dwell.recording]
            design[here, self._place + dwell.recording] = -dwell.speed_rad_s
            since = dwell.time_s - recording.middle_s
            design[here, self._rate + dwell.recording] = -dwell.speed_rad_s * since
            shared = 2 + 2 * count + 2 * at
            design[here, shared], design[here, shared + 1] = -dwell.speed_rad_s, 1.0
            known[shared], known[shared + 1] = recording.mark_s, recording.counts_rad
        known[self._place : self._rate] = [each.placed_s for each in recordings]
        known[self._rate : self._rate + count] = _RATE_OFF
        self._design = design
        # least squares with what is known beforehand; columns of nothing unknown drop out
        scaled = design * known
        freedom = max(len(angle) - int(np.linalg.matrix_rank(scaled)), 1)
        # of a mark's angle about the best fit, rad
        left = angle - scaled @ (np.linalg.pinv(scaled, rcond=1e-12) @ angle)
        scatter = max(float(np.sqrt(left @ left / freedom)), _LEAST_SCATTER)
        inverse = np.linalg.pinv(np.vstack([scaled / scatter, np.eye(len(known))]))
        self._values = known * (inverse[:, : len(angle)] @ angle) / scatter
        self._covariance = inverse @ inverse.T * known[:, None] * known
        self._quantile = float(stdtrit(freedom, (1 + _COVERED) / 2))

    def told(self, combination: Array) -> tuple[float, float]:
        """A combination of the unknowns and the half width of its interval."""
        variance = float(combination @ self._covariance @ combination)
        return float(combination @ self._values), self._quantile * float(np.sqrt(variance))

    @property
    def own_skew(self) -> Array:
        return self._unit(1)

    def skew_of(self, recording: int) -> Array:
        return self._unit(1, self._place + recording)

    def rate_of(self, recording: int) -> Array:
        return self._unit(self._rate + recording)

    def angle_at(self, speed_rad_s: float) -> Array:
        combination = self._unit(0)
        combination[1] = -speed_rad_s
        return combination

    def _unit(self, *places: int) -> Array:
        combination = np.zeros(self._design.shape[1])
        combination[list(places)] = 1.0
        return combination


def _wrapped(angle: tuple[float, float]) -> tuple[float, float]:
    return float(np.mod(angle[0] + tau / 2, tau) - tau / 2), angle[1]
