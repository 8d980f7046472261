"""A network that has learnt from recordings what a rig's channels show, and how far that may be trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.model_selection import GridSearchCV, GroupKFold

from sim_twin.surrogates.judging import Score, scores
from sim_twin.surrogates.networks import NETWORKS
from sim_twin.surrogates.samples import COLUMNS, SETTINGS, Over, Samples, slack

Array = NDArray[np.float64]
Kind = Literal["rbf", "grnn"]
_WIDTHS: Final[Mapping[str, Sequence[float]]] = {
    "rbf": (0.5, 1.0, 2.0),
    "grnn": (0.003, 0.01, 0.03, 0.1, 0.3, 1.0),
}
"""That are tried: of a unit's distance to its neighbours, and of the inputs' standard deviations."""
_FOLDS, _TRIED_ON = 3, 3000
_TESTED_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class Features:
    """What a network takes of inputs in these `ranges`: no input that was constant while it learnt."""

    over: Over
    ranges: Mapping[str, tuple[float, float]]

    @classmethod
    def of_samples(cls, samples: Samples, over: Over) -> Self:
        names = [*([over] if over == "time" else []), *SETTINGS]
        columns = {name: samples.column(name) for name in names}
        return cls(over, {name: (float(each.min()), float(each.max())) for name, each in columns.items()})

    @property
    def constants(self) -> tuple[str, ...]:
        """Inputs that were the same in all samples."""
        return tuple(
            name
            for name, (low, high) in self.ranges.items()
            if high - low <= slack(name, max(abs(low), abs(high)))
        )

    def of(self, inputs: Array) -> Array:
        """Shape (n, features), of inputs of shape (n, 6); an angle as its cosine and sine."""
        names = list(COLUMNS)
        columns = [inputs[:, names.index(name)] for name in self.ranges if name not in self.constants]
        if self.over == "angle":
            angle = inputs[:, names.index("angle")]
            columns = [np.cos(angle), np.sin(angle), *columns]
        return np.column_stack(columns) if columns else np.empty((len(inputs), 0))


@dataclass(frozen=True, slots=True)
class Surrogate:
    """Predicts `channels` of a `rig` over the crank's angle, or time, and how the rig is set.

    `ranges` are those of all inputs while it learnt, by name; one that was constant then is none of the
    `network`'s. `mean` and `scale` are of its inputs, shape (features,). `learnt_from`: SHA-256 of the logs,
    by name; `tested` how it does on the last revolutions of each, which it has not learnt, by channel.
    """

    rig: str
    channels: tuple[str, ...]
    over: Over
    kind: Kind
    network: Any
    ranges: Mapping[str, tuple[float, float]]
    mean: Array
    scale: Array
    learnt_from: Mapping[str, str] = field(default_factory=dict)
    tested: Mapping[str, Score] = field(default_factory=dict)

    @property
    def features(self) -> Features:
        return Features(self.over, self.ranges)

    def predict(self, inputs: Array) -> Array:
        """What the channels show, shape (n, channels), for `inputs` of shape (n, 6)."""
        found: Array = self.network.predict((self.features.of(inputs) - self.mean) / self.scale)
        return found

    def outside(self, inputs: Array) -> dict[str, tuple[float, float]]:
        """Inputs that lie outside of what was learnt, by name: least and largest that is asked for.

        `inputs` have shape (n, 6).
        """
        found = {}
        for name, (low, high) in self.ranges.items():
            column = inputs[:, list(COLUMNS).index(name)]
            off = slack(name, max(abs(low), abs(high)))
            if column.min() < low - off or column.max() > high + off:
                found[name] = float(column.min()), float(column.max())
        return found

    @property
    def stands_in(self) -> bool:
        """Whether it may stand for simulations, by its own test: every channel's distribution is right."""
        return bool(self.tested) and all(each.distribution_right for each in self.tested.values())


def learnt(
    samples: Samples,
    rig: str,
    channels: tuple[str, ...],
    over: Over,
    kind: Kind,
    seed: int = 0,
    width: float | None = None,
    by_points: bool = False,
    **given: Any,
) -> Surrogate:
    """Learn from `samples`; without a `width`, the one that does best on revolutions that it did not see;
    `by_points`: on points that it did not see, as where it will be asked for points between those it learnt.

    `given` are parameters of the network. Raises ValueError where there is too little to learn from.
    """
    check(samples, channels)
    taken = Features.of_samples(samples, over)
    features = taken.of(samples.inputs)
    if not features.shape[1] or not np.ptp(features, axis=0).any():
        raise ValueError("every input is the same in all samples: there is nothing to predict from")
    mean, scale = features.mean(axis=0), features.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    network = NETWORKS[kind](random_state=seed, **given)
    scaled = (features - mean) / scale
    if width is None:
        groups = np.arange(len(samples)) if by_points else _groups(samples)
        rows = np.random.default_rng(seed).permutation(len(samples))[:_TRIED_ON]
        if len(np.unique(groups[rows])) < _FOLDS:
            raise ValueError(f"fewer than {_FOLDS} revolutions: too few to find a width by cross-validation")
        search = GridSearchCV(
            network,
            {"width": list(_WIDTHS[kind])},
            scoring="neg_mean_squared_error",
            cv=GroupKFold(_FOLDS),
            refit=False,
            error_score="raise",
        )
        width = float(
            search.fit(scaled[rows], samples.outputs[rows], groups=groups[rows]).best_params_["width"]
        )
    network.set_params(width=width).fit(scaled, samples.outputs)
    return Surrogate(rig, channels, over, kind, network, taken.ranges, mean, scale)


def learnt_and_tested(samples: Samples, *args: Any, **given: Any) -> Surrogate:
    """Like `learnt`, from all but the last revolutions of each run, on which it is tested."""
    late = samples.late_turns(_TESTED_SHARE)
    found = learnt(samples[~late], *args, **given)
    tested = samples[late]
    judged = scores(tested, found.predict(tested.inputs), samples)
    return replace(found, tested=dict(zip(found.channels, judged, strict=True)))


def check(samples: Samples, channels: Sequence[str]) -> None:
    """Raise ValueError where nothing can be learnt from samples of these channels."""
    if len(samples) < _LEAST:
        raise ValueError(f"{len(samples)} samples are too few to learn from: {_LEAST} at least")
    for name, column in zip(channels, samples.outputs.T, strict=True):
        if not np.isfinite(column).all():
            raise ValueError(f"{name}: values that are not finite; a network can learn nothing from them")
    for name in COLUMNS:
        if not np.isfinite(samples.column(name)).all():
            raise ValueError(f"{name}: not known for every sample")


_LEAST = 50


def _groups(samples: Samples) -> NDArray[np.int64]:
    """A number for each revolution of each run, shape (n,)."""
    return np.asarray(samples.runs * (int(np.ptp(samples.turns)) + 1) + samples.turns - samples.turns.min())
