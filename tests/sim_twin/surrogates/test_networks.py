"""The two networks: scikit-learn's protocol, and the numbers of other programs."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import LinearRegression
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.model_selection import GridSearchCV, KFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from benchmarks.surrogates import LEARNT_WITHIN_S, speed
from sim_twin.surrogates.networks import GRNN, NETWORKS, RBFNetwork

BOTH = [RBFNetwork(), GRNN()]


@pytest.mark.filterwarnings("ignore")
@parametrize_with_checks(BOTH)
def test_it_keeps_the_protocol_of_scikit_learn(estimator, check) -> None:
    check(estimator)


def waves(samples: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Three outputs of two inputs, with some noise."""
    random = np.random.default_rng(seed)
    X = random.uniform(-1, 1, (samples, 2))
    smooth = np.column_stack([np.sin(3 * X[:, 0]), X[:, 0] * X[:, 1], np.cos(2 * X[:, 1])])
    return X, smooth + random.normal(scale=0.01, size=smooth.shape)


def on_a_circle(units: int) -> np.ndarray:
    """Points whose distances to their two neighbours are all the same: so eq. 17 gives one width."""
    way = 2 * np.pi * np.arange(units) / units
    return np.column_stack([np.cos(way), np.sin(way)])


def test_all_samples_as_units_are_kernel_ridge_of_scikit_learn() -> None:
    X, random = on_a_circle(24), np.random.default_rng(1)
    y = random.normal(size=(24, 3))
    ours = RBFNetwork(max_units=24, width=1.0).fit(X, y)
    assert np.ptp(ours.widths_) < 1e-12
    peer = KernelRidge(alpha=1e-14, kernel="rbf", gamma=0.5 / ours.widths_[0] ** 2).fit(X, y - y.mean(axis=0))
    asked = on_a_circle(77)
    answer = peer.predict(asked) + y.mean(axis=0)
    assert ours.predict(asked) == pytest.approx(answer, rel=1e-6, abs=1e-6 * np.abs(answer).max())


def test_outputs_are_linear_regression_on_the_units() -> None:
    X, Y = waves(500)
    ours = RBFNetwork(max_units=10, random_state=0).fit(X, Y)

    def units(asked: np.ndarray) -> np.ndarray:
        pairs = zip(ours.centres_, ours.widths_, strict=True)
        return np.hstack([rbf_kernel(asked, centre[None], gamma=0.5 / width**2) for centre, width in pairs])

    peer = LinearRegression(fit_intercept=False).fit(units(X), Y - Y.mean(axis=0))
    assert ours.weights_ == pytest.approx(peer.coef_.T, rel=1e-6)
    assert ours.predict(X) == pytest.approx(peer.predict(units(X)) + Y.mean(axis=0), rel=1e-6, abs=1e-9)


def test_a_units_width_is_the_rms_distance_to_its_nearest() -> None:
    X, Y = waves(300)
    ours = RBFNetwork(max_units=6, neighbours=3, width=1.5, random_state=0).fit(X, Y)
    for centre, width in zip(ours.centres_, ours.widths_, strict=True):
        apart = np.sort(np.linalg.norm(ours.centres_ - centre, axis=1))[1:4]
        assert width == pytest.approx(1.5 * np.sqrt(np.mean(apart**2)))


def test_units_are_added_until_the_error_is_reached() -> None:
    X, Y = waves(400)
    ours = RBFNetwork(max_units=60, error_goal=0.02, random_state=0).fit(X, Y)
    assert 2 < len(ours.centres_) < 60
    assert len(ours.history_) == len(ours.centres_)
    assert ours.history_[-1] <= 0.02 < ours.history_[-2]
    assert ours.score(X, Y) == pytest.approx(1 - ours.history_[-1], abs=2e-3)


def test_centres_lie_where_they_are_wanted_among_all_that_is_looked_at() -> None:
    """A bump that ten of the samples lie in, and two of any 200 of them."""
    X = np.random.default_rng(0).permutation(np.linspace(0, 1, 1000))[:, None]
    ours = RBFNetwork(max_units=6, width=0.5, random_state=0).fit(X, np.exp(-0.5 * ((X - 0.7) / 0.002) ** 2))
    assert np.count_nonzero(np.abs(ours.centres_ - 0.7) < 0.005) >= 4


@pytest.mark.long
def test_as_many_units_as_are_asked_for_are_there() -> None:
    X, Y = np.random.default_rng(0).normal(size=(2, 2600, 3))  # nothing to be learnt, so all are wanted
    assert len(RBFNetwork(max_units=1200, random_state=0).fit(X, Y).centres_) == 1200


def test_the_general_regression_is_its_closed_form() -> None:
    X, Y = waves(200)
    asked, _ = waves(50, seed=1)
    found = GRNN(width=0.07).fit(X, Y).predict(asked)
    for row, point in zip(found, asked, strict=True):
        near = np.exp(
            -np.sum((X.astype(np.longdouble) - point) ** 2, axis=1) / (2 * np.longdouble(0.07) ** 2)
        )
        closed = near @ Y / near.sum()
        assert row == pytest.approx(closed.astype(float), rel=1e-9)


def test_far_from_all_it_learnt_a_general_regression_says_what_the_nearest_was() -> None:
    X, Y = waves(100)
    far = np.array([[1e3, 1e3]])
    nearest = np.argmin(np.linalg.norm(X - far, axis=1))
    assert GRNN(width=0.01).fit(X, Y).predict(far)[0] == pytest.approx(Y[nearest])


def test_prototypes_stand_for_many_samples() -> None:
    X, Y = waves(5_000)
    few = GRNN(width=0.1, max_prototypes=300, random_state=0).fit(X, Y)
    assert len(few.prototypes_) <= 300
    assert few.counts_.sum() == 5_000
    # clusters are 0.1 apart and the outputs bend by 9 a unit squared
    assert np.abs(few.predict(X) - GRNN(width=0.1, max_prototypes=5_000).fit(X, Y).predict(X)).max() < 0.1


@pytest.mark.parametrize("network", BOTH)
def test_pipelines_clones_and_searches_take_it(network) -> None:
    X, Y = waves(300)
    line = make_pipeline(StandardScaler(), clone(network))
    assert cross_val_score(line, X, Y, cv=3).min() > 0.7
    widths = {"width": [0.05, 0.2, 1.0, 3.0]}
    search = GridSearchCV(clone(network), widths, cv=KFold(3, shuffle=True, random_state=0)).fit(X, Y)
    assert search.best_score_ > 0.7


def test_the_same_state_gives_the_same_network() -> None:
    X, Y = waves(3000)
    for network in (RBFNetwork(random_state=3), GRNN(max_prototypes=50, random_state=3)):
        assert np.array_equal(clone(network).fit(X, Y).predict(X), clone(network).fit(X, Y).predict(X))


@pytest.mark.long
@pytest.mark.parametrize("kind", NETWORKS)
def test_it_learns_100_000_samples_in_half_a_minute_and_predicts_faster_than_real_time(kind) -> None:
    found = speed(kind)
    assert found.learnt_s < LEARNT_WITHIN_S
    assert found.times_real_time > 1
