"""How well chaotic motion is predicted: by point and in distribution, against the rig's own scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import wasserstein_distance

from sim_twin.surrogates.samples import Samples, about_the_mean_cycle

Array = NDArray[np.float64]
_LEAST_FLOOR = 1e-3
"""Of a standard deviation: two halves of a run are never taken to be closer."""

_FLOORS, _HARDLY = 2.0, 0.05
"""Of floors, and of standard deviations: up to where a distribution is right."""

_WHOLE = 0.9 * 2 * np.pi
"""Rad that the samples of a revolution span at least; the first and the last of a record may be cut."""


@dataclass(frozen=True, slots=True)
class Score:
    """Of one channel, in standard deviations of what was measured; the mean over runs.

    `rmse` point by point, `rmse_floor` what the run's mean revolution leaves, were it known without error:
    only what has learnt points of the very revolution comes below it. `distance` is Wasserstein's between the
    distributions of values (how far a value has to be moved, on average), `distance_floor` that of the odd
    from the even whole revolutions in which they lie; 0 where there are not two.
    """

    rmse: float
    rmse_floor: float
    distance: float
    distance_floor: float

    @property
    def rmse_over_floor(self) -> float:
        return self.rmse / max(self.rmse_floor, _LEAST_FLOOR)

    @property
    def distance_over_floor(self) -> float:
        return self.distance / max(self.distance_floor, _LEAST_FLOOR)

    @property
    def distribution_right(self) -> bool:
        """Not farther off than twice what the run's own revolutions are, or than hardly anything."""
        return self.distance <= max(_FLOORS * self.distance_floor, _HARDLY)


def scores(measured: Samples, predicted: Array, all_measured: Samples | None = None) -> list[Score]:
    """One for each channel of `measured`, shape of `predicted` (n, channels).

    `all_measured`: what `measured` is part of, which tells the mean revolutions.
    """
    each, whole = [], measured if all_measured is None else all_measured
    for run in np.unique(measured.runs):
        here = measured.runs == run
        each.append(_scores(measured[here], predicted[here], whole[whole.runs == run]))
    return [mean_of(rows) for rows in zip(*each, strict=True)]


def _scores(measured: Samples, predicted: Array, whole: Samples) -> list[Score]:
    """Of one run."""
    odd, even = _alternate(whole[np.isin(whole.turns, measured.turns)])
    left = np.sqrt(about_the_mean_cycle(whole, measured))
    found = []
    for number, (shown, guess) in enumerate(zip(measured.outputs.T, predicted.T, strict=True)):
        unit = float(shown.std()) or 1.0
        halves = odd.outputs[:, number], even.outputs[:, number]
        found.append(
            Score(
                float(np.sqrt(np.mean((shown - guess) ** 2))) / unit,
                float(left[number]) / unit,
                float(wasserstein_distance(shown, guess)) / unit,
                float(wasserstein_distance(*halves)) / unit if len(odd) else 0.0,
            )
        )
    return found


def _alternate(samples: Samples) -> tuple[Samples, Samples]:
    """The odd and as many even whole revolutions of a run; none where there are not two."""
    angle = samples.column("angle")
    each = np.unique(samples.turns)
    whole = each[[np.ptp(angle[samples.turns == turn]) > _WHOLE for turn in each]]
    whole = whole[: len(whole) // 2 * 2]
    return samples[np.isin(samples.turns, whole[::2])], samples[np.isin(samples.turns, whole[1::2])]


def mean_of(each: Sequence[Score]) -> Score:
    """Their mean, figure by figure."""
    rows = np.array([(one.rmse, one.rmse_floor, one.distance, one.distance_floor) for one in each])
    return Score(*(float(value) for value in rows.mean(axis=0)))
