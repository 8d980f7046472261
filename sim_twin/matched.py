"""What a calibration has found of a rig's tolerances: where each lies, and how far that is still open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from sim_twin.twin import DriveT, RigT, Twin

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """Tolerances in `names` are normal, with `mean` (n,) and `covariance` (n, n) in their own deviations.

    Before anything is known, means are 0 and the covariance is the identity.
    """

    names: tuple[str, ...]
    mean: Array
    covariance: Array

    @property
    def deviation(self) -> Array:
        """Of each tolerance, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    def mean_of(self, name: str) -> float:
        """Where the tolerance `name` lies; 0 for one that was not looked at."""
        return float(self.mean[self.names.index(name)]) if name in self.names else 0.0

    def only(self, names: Sequence[str]) -> Matched:
        """The same for those of `names` that it knows."""
        kept = [k for k, name in enumerate(self.names) if name in names]
        held = tuple(self.names[k] for k in kept)
        return Matched(held, self.mean[kept], self.covariance[np.ix_(kept, kept)])

    def centred(self) -> Matched:
        """What is still open once the means are in."""
        return replace(self, mean=np.zeros_like(self.mean))

    def placed(self, names: Sequence[str], normals: Array) -> Array:
        """Where the tolerances `names` lie for independent standard `normals` (n,); others stay there."""
        places = normals.copy()
        held = [names.index(name) for name in self.names if name in names]
        here = self.only(names)
        places[held] = here.mean + here._root() @ normals[held]
        return places

    def _root(self) -> Array:
        """Symmetric root of the covariance, so that what is not known is drawn as if without it."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)


def _nothing_known() -> Matched:
    return Matched((), np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True, slots=True)
class MatchedTwin(Twin[RigT, DriveT], Generic[RigT, DriveT]):
    """A twin that was matched to its rig; `known` is what that has left open of its tolerances."""

    known: Matched = field(default_factory=_nothing_known)
