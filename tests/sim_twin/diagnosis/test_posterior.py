"""Evidence and posterior against closed forms, in the unit cube."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from sim_twin.diagnosis.posterior import Posterior, integrate

Array = NDArray[np.float64]


def bell(centre: Array, width: Array) -> float:
    """Logarithm of the integral of exp(-0.5 sum(((u - centre) / width)^2)) over the cube."""
    inside = norm.cdf((1 - centre) / width) - norm.cdf(-centre / width)
    return float(np.sum(np.log(width * np.sqrt(2 * np.pi) * inside)))


def found(centre: Array, width: Array, seed: int) -> Posterior:
    def log_likelihood(u: Array) -> Array:
        return np.asarray(-0.5 * np.sum(((u - centre) / width) ** 2, axis=1))

    return integrate(log_likelihood, len(centre), np.random.default_rng(seed))


def uncertainty(posterior: Posterior) -> float:
    """Of the logarithm of an evidence: the relative error of a sum of so many effective weights."""
    return float(np.sqrt(np.sum(posterior.weights**2)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("centre", "width"),
    [
        ((0.4,), (0.1,)),
        ((0.4,), (0.0005,)),
        ((0.0,), (0.05,)),
        ((0.5,), (10.0,)),
        ((0.3, 0.6), (0.1, 0.02)),
        ((0.3, 0.999), (0.005, 0.005)),
        ((0.2, 0.5, 0.8), (0.05, 0.05, 0.05)),
    ],
    ids=["plain", "narrow", "at the edge", "flat", "two", "two at the edge", "three"],
)
def test_evidence_of_a_bell_is_its_integral(
    centre: tuple[float, ...], width: tuple[float, ...], seed: int
) -> None:
    posterior = found(np.array(centre), np.array(width), seed)
    exact = bell(np.array(centre), np.array(width))
    # four standard errors
    assert posterior.log_evidence == pytest.approx(exact, abs=4 * uncertainty(posterior))
    assert uncertainty(posterior) < 0.15


def test_weights_sum_to_one_and_moments_are_the_bell_s() -> None:
    centre, width = np.array([0.3, 0.6]), np.array([0.05, 0.02])
    posterior = found(centre, width, 1)
    assert posterior.weights.sum() == pytest.approx(1.0)
    mean = posterior.weights @ posterior.places
    spread = np.sqrt(posterior.weights @ (posterior.places - mean) ** 2)
    assert np.abs(mean - centre) / width == pytest.approx(0, abs=4 * uncertainty(posterior))
    assert spread == pytest.approx(width, rel=4 * uncertainty(posterior))


def along_a_bend(u: Array) -> Array:
    return np.asarray(-0.5 * ((u[:, 1] - 0.1 - 3 * (u[:, 0] - 0.5) ** 2) / 0.02) ** 2)


def medians(posterior: Posterior) -> Array:
    order = np.argsort(posterior.places, axis=0)
    middles = []
    for places, at in zip(posterior.places.T, order.T, strict=True):
        below = np.cumsum(posterior.weights[at])
        middles.append(places[at][np.searchsorted(below, 0.5)])
    return np.array(middles)


@pytest.mark.parametrize("seed", range(3))
def test_what_stands_for_a_bell_is_its_middle_and_for_a_bend_a_place_on_it(seed: int) -> None:
    of_bell = found(np.array([0.3, 0.6, 0.4]), np.array([0.05, 0.02, 0.1]), seed)
    middle = medians(of_bell)
    assert of_bell.central(middle) is middle
    bent = integrate(along_a_bend, 2, np.random.default_rng(seed))
    middle = medians(bent)
    # what counts lies within a deviation or two, the middle of each by itself far beside it
    assert along_a_bend(middle[None])[0] < -8
    central = bent.central(middle)
    assert along_a_bend(central[None])[0] > -1
    assert 0.2 < central[0] < 0.8


def test_what_stands_for_two_peaks_lies_in_one_of_them() -> None:
    def log_likelihood(u: Array) -> Array:
        return np.asarray(np.logaddexp(*(-0.5 * ((u[:, 0] - at) / 0.01) ** 2 for at in (0.2, 0.9))))

    posterior = integrate(log_likelihood, 1, np.random.default_rng(5))
    assert min(abs(posterior.central(np.array([0.5]))[0] - at) for at in (0.2, 0.9)) < 0.02


def test_both_of_two_peaks_are_found_with_their_shares() -> None:
    def log_likelihood(u: Array) -> Array:
        left = -0.5 * ((u[:, 0] - 0.2) / 0.01) ** 2
        right = np.log(3) - 0.5 * ((u[:, 0] - 0.9) / 0.01) ** 2
        return np.asarray(np.logaddexp(left, right))

    posterior = integrate(log_likelihood, 1, np.random.default_rng(5))
    right = posterior.weights[posterior.places[:, 0] > 0.5].sum()
    assert right == pytest.approx(0.75, abs=4 * uncertainty(posterior))
    assert posterior.log_evidence == pytest.approx(
        np.log(4 * 0.01 * np.sqrt(2 * np.pi)), abs=4 * uncertainty(posterior)
    )


def test_without_parameters_the_evidence_is_the_likelihood() -> None:
    posterior = integrate(lambda u: np.full(len(u), -7.5), 0, np.random.default_rng(0))
    assert posterior.log_evidence == -7.5
    assert posterior.places.shape == (1, 0)


def test_what_is_forbidden_takes_its_share_of_the_evidence() -> None:
    posterior = integrate(lambda u: np.where(u[:, 0] < 0.25, -1e12, 0.0), 1, np.random.default_rng(2))
    assert posterior.log_evidence == pytest.approx(np.log(0.75), abs=4 * uncertainty(posterior))
    assert posterior.weights[posterior.places[:, 0] < 0.25].max() == 0


def test_samples_come_as_often_as_they_weigh() -> None:
    places = np.array([[0.1], [0.5], [0.9]])
    posterior = Posterior(places, np.array([0.2, 0.8, 0.0]), 0.0)
    some = posterior.sample(10_000, np.random.default_rng(4))
    assert np.mean(some == 0.1) == pytest.approx(0.2, abs=4 * np.sqrt(0.2 * 0.8 / 1e4))
    assert not np.any(some == 0.9)


def test_flattened_lets_more_places_count_and_keeps_their_order() -> None:
    posterior = found(np.array([0.4]), np.array([0.001]), 1)
    flat = posterior.flattened(400)
    assert flat.weights.sum() == pytest.approx(1.0)
    assert 1 / np.sum(flat.weights**2) >= 400
    order = np.argsort(posterior.weights)
    assert np.all(np.diff(flat.weights[order]) >= 0)
    assert posterior.flattened(2) == posterior or np.array_equal(
        posterior.flattened(2).weights, posterior.weights
    )


def test_tempered_weights_are_a_power_of_the_posterior_s() -> None:
    tempered = Posterior(np.array([[0.1], [0.9]]), np.array([0.2, 0.8]), 0.0).tempered(0.5)
    assert tempered.weights == pytest.approx([1 / 3, 2 / 3])


def test_the_same_seed_gives_the_same_bits() -> None:
    one, other = (found(np.array([0.3, 0.6]), np.array([0.05, 0.02]), 9) for _ in range(2))
    assert one.log_evidence == other.log_evidence
    assert np.array_equal(one.places, other.places)


def test_the_likeliest_place_is_none_that_was_drawn_where_few_were() -> None:
    places = np.array([[0.2], [0.5], [0.51]])
    drawn = Posterior(places, np.array([0.6, 0.2, 0.2]), 0.0, logs=np.array([-3.0, -0.1, 0.0]))
    assert drawn.likeliest == 2
    assert Posterior(places, np.array([0.2, 0.6, 0.2]), 0.0).likeliest == 1
