"""The two networks of Erkaya (2012), 10.1007/s12206-012-0308-8, section 4, as scikit-learn's regressors.

Where the text is misprinted, what its sources have is done: eq. 16 subtracts a unit's whole centre from x in
each coordinate (`x - c_ji` for `x_i - c_ji`); eq. 17 counts to epsilon and names centres to e; eq. 20 and 22
write s for sigma and, though p is the dimension, `(2p)` for `(2 pi)`; eq. 22 sums to n what eq. 20 sums to k.
Eq. 18 has no constant: the mean of the outputs is one here, so that far from all that was learnt it is what
is predicted.
"""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.cluster import MiniBatchKMeans
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

Array = NDArray[np.float64]
_AT_ONCE = 2048
"""Rows that are predicted together: what they take stays in the processor's cache."""
_LOOKED_AT = 1000
"""Samples, at least, by which centres are chosen, and that may become one."""
_RIDGE, _ALIKE = 1e-11, 1e-8
"""Of a unit's largest square: what keeps units that are nearly the same solvable while they are chosen; and
of a unit's own: what it has to add to those that are there."""
_A_CLUSTER = 20
"""Samples by which clusters are found; they count all."""
_SINGULAR = 1e-12
"""Of the largest singular value: below it, units are not told apart by the samples."""


class _Network(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Input and output as scikit-learn has them; `fitted` names all that a fit finds, each an array."""

    fitted: ClassVar[tuple[str, ...]]

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn from samples: X of shape (n, inputs), y of shape (n,) or (n, outputs), two or more."""
        inputs, outputs = validate_data(
            self, X, y, dtype=np.float64, multi_output=True, y_numeric=True, ensure_min_samples=2
        )
        self.flat_ = np.array(outputs.ndim == 1)
        self._learn(inputs, outputs.reshape(len(outputs), -1).astype(np.float64))
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Outputs for X, shape (n, inputs), in the shape of the y that was learnt."""
        check_is_fitted(self)
        inputs = validate_data(self, X, dtype=np.float64, reset=False)
        pieces = [self._answer(inputs[first : first + _AT_ONCE]) for first in range(0, len(inputs), _AT_ONCE)]
        found = np.concatenate(pieces)
        return found[:, 0] if self.flat_ else found

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags

    def _learn(self, X: Array, Y: Array) -> None:
        raise NotImplementedError

    def _answer(self, X: Array) -> Array:
        raise NotImplementedError


class RBFNetwork(_Network):
    """Gaussian units (eq. 15-16) and linear outputs (eq. 18) by least squares.

    Units are added one by one at the sample that leaves the least error (orthogonal least squares: Chen,
    Cowan, Grant 1991, 10.1109/72.80341), until there are `max_units` or the mean squared error, as a share of
    the outputs' variance, is at most `error_goal`.
    A unit's width is `width` times its root mean square distance to the nearest `neighbours` other centres
    (eq. 17), at every step anew. As many units as samples, and no goal, take all of them. `history_`: the
    error with 1, 2, ... units, of the samples by which they were chosen, twice as many as units and 1000 at
    least.
    """

    fitted = ("flat_", "centres_", "widths_", "weights_", "constant_", "history_")

    def __init__(
        self,
        max_units: int = 10,
        error_goal: float = 0.0,
        neighbours: int = 2,
        width: float = 1.0,
        random_state: int | None = None,
    ) -> None:
        self.max_units, self.error_goal = max_units, error_goal
        self.neighbours, self.width, self.random_state = neighbours, width, random_state

    def _learn(self, X: Array, Y: Array) -> None:
        self.constant_ = Y.mean(axis=0)
        scale = Y.std(axis=0)
        shares = (Y - self.constant_) / np.where(scale > 0, scale, 1.0)
        alone = max(float(np.sqrt(X.var(axis=0).sum())), _SINGULAR)
        if self.max_units >= len(X) and self.error_goal <= 0:
            self.centres_, self.history_ = np.unique(X, axis=0), np.empty(0)
            apart = cdist(self.centres_, self.centres_, "sqeuclidean")
            np.fill_diagonal(apart, np.inf)
            self.widths_ = self._rooted(np.sort(apart, axis=1)[:, : self.neighbours], alone)
        else:
            most = max(_LOOKED_AT, 2 * self.max_units)
            rows = check_random_state(self.random_state).permutation(len(X))[:most]
            self._choose(X[rows], shares[rows], alone)
        self.weights_ = _least_squares(_gaussians(X, self.centres_, self.widths_), Y - self.constant_)

    def _choose(self, X: Array, shares: Array, alone: float) -> None:
        """Find centres among X and their widths, and the error with each of them.

        Column j of `units` is always what a unit at X[j] would be, by eq. 17 among those that are chosen.
        """
        squares, chosen, history = cdist(X, X, "sqeuclidean"), list[int](), list[float]()
        near = np.full((len(X), self.neighbours), np.inf)
        widths = self._rooted(near, alone)
        units = np.exp(-0.5 * squares / widths**2)
        norms = np.einsum("ij,ij->j", units, units)
        rest, left = norms, shares
        products = np.empty((min(self.max_units, len(X)), len(X)))  # of the chosen with all
        while len(chosen) < len(products) and (not history or history[-1] > self.error_goal):
            told = rest > _ALIKE * norms
            told[chosen] = False
            if not told.any():
                break
            gain = np.sum((units.T @ left) ** 2, axis=1) / np.where(told, rest, 1.0)
            new = int(np.argmax(np.where(told, gain, -1.0)))
            chosen.append(new)
            nearer = np.where(np.arange(len(X)) == new, np.inf, squares[:, new])
            near = np.sort(np.column_stack([near, nearer]), axis=1)[:, : self.neighbours]
            before, widths = widths, self._rooted(near, alone)
            other = np.flatnonzero(widths != before)
            units[:, other] = np.exp(-0.5 * squares[:, other] / widths[other] ** 2)
            norms[other] = np.einsum("ij,ij->j", units[:, other], units[:, other])
            there, known = units[:, chosen], products[: len(chosen)]
            known[:, other] = there.T @ units[:, other]
            moved = np.flatnonzero(np.isin(chosen, [*other, new]))
            known[moved] = there[:, moved].T @ units
            steady = known[:, chosen] + _RIDGE * len(X) * np.eye(len(chosen))
            factor = scipy.linalg.cholesky(steady, lower=True)
            rest = norms - np.sum(scipy.linalg.solve_triangular(factor, known, lower=True) ** 2, axis=0)
            left = shares - there @ scipy.linalg.cho_solve((factor, True), there.T @ shares)
            history.append(float(np.mean(left**2)))
        self.centres_, self.widths_, self.history_ = X[chosen], widths[chosen], np.array(history)

    def _rooted(self, near: Array, alone: float) -> Array:
        """Eq. 17 of squared distances to the nearest other centres, shape (units, neighbours).

        One that is not there is infinite; a unit without any is `alone` wide.
        """
        there = np.isfinite(near)
        count = there.sum(axis=1)
        mean = np.where(there, near, 0.0).sum(axis=1) / np.maximum(count, 1)
        return np.maximum(self.width * np.where(count > 0, np.sqrt(mean), alone), _SINGULAR)

    def _answer(self, X: Array) -> Array:
        answer: Array = self.constant_ + _gaussians(X, self.centres_, self.widths_) @ self.weights_
        return answer


def _gaussians(X: Array, centres: Array, widths: Array) -> Array:
    """Eq. 15 and 16, shape (samples, units)."""
    squares = cdist(X, centres, "sqeuclidean")
    squares *= -0.5 / widths**2
    return np.exp(squares, out=squares)


def _least_squares(units: Array, outputs: Array) -> Array:
    found: Array = scipy.linalg.lstsq(units, outputs, cond=_SINGULAR, check_finite=False)[0]
    return found


class GRNN(_Network):
    """The general regression network (eq. 22; Specht 1991, 10.1109/72.97934) with one `width` for all inputs.

    Of more samples than `max_prototypes` so many clusters' centres stand for them, each with the number of
    its samples and their mean output (Specht's eq. 12 to 14).
    """

    fitted = ("flat_", "prototypes_", "outputs_", "counts_")

    def __init__(
        self, width: float = 0.1, max_prototypes: int = 1000, random_state: int | None = None
    ) -> None:
        self.width, self.max_prototypes, self.random_state = width, max_prototypes, random_state

    def _learn(self, X: Array, Y: Array) -> None:
        if len(X) <= self.max_prototypes:
            self.prototypes_, self.outputs_, self.counts_ = X, Y, np.ones(len(X))
            return
        means = MiniBatchKMeans(
            self.max_prototypes,
            random_state=self.random_state,
            n_init=1,
            init="random",
            max_iter=5,
            batch_size=4096,
        )
        few = check_random_state(self.random_state).permutation(len(X))[: _A_CLUSTER * self.max_prototypes]
        clusters = means.fit(X[few]).predict(X)
        counts = np.bincount(clusters, minlength=self.max_prototypes)
        used = counts > 0
        self.counts_ = counts[used].astype(np.float64)
        self.prototypes_, self.outputs_ = (
            np.array([np.bincount(clusters, column, self.max_prototypes)[used] for column in rows.T]).T
            / self.counts_[:, None]
            for rows in (X, Y)
        )

    def _answer(self, X: Array) -> Array:
        squares = cdist(X, self.prototypes_, "sqeuclidean")
        squares -= squares.min(axis=1, keepdims=True)  # so that the nearest counts however far it is
        squares *= -0.5 / self.width**2
        near = np.exp(squares, out=squares) * self.counts_
        answer: Array = near @ self.outputs_ / near.sum(axis=1, keepdims=True)
        return answer


NETWORKS: dict[str, Any] = {"rbf": RBFNetwork, "grnn": GRNN}
"""By the names that a command and a file call them."""
