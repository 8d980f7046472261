"""Responses between simulated ones: a known smooth function from noisy values of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_twin.diagnosis.emulator import fitted

Array = NDArray[np.float64]
COUNT, OUTPUTS = 100, 12


def smooth(x: Array) -> Array:
    """Some waves over a line or a plane, of an amplitude of 8 scatters."""
    rng = np.random.default_rng(0)
    slope, bend = rng.normal(size=(2, x.shape[1], OUTPUTS))
    return np.asarray(8 * np.sin(x @ slope + 0.5) + 4 * x @ bend)


def simulated(dimensions: int, seed: int, scatter: float = 1.0) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (COUNT, dimensions))
    return x, smooth(x) + scatter * rng.standard_normal((COUNT, OUTPUTS))


@pytest.mark.parametrize("dimensions", [1, 2])
def test_a_smooth_function_is_predicted_better_than_one_simulation_shows_it(dimensions: int) -> None:
    emulator = fitted(*simulated(dimensions, 1))
    x = np.random.default_rng(2).uniform(-0.9, 0.9, (200, dimensions))
    mean, excess = emulator(x)
    assert mean.shape == excess.shape == (200, OUTPUTS)
    # 100 noisy values over some five (twenty) degrees of freedom: sqrt(5/100), sqrt(20/100), and half more
    assert np.sqrt(np.mean((mean - smooth(x)) ** 2)) < (0.35 if dimensions == 1 else 0.65)


@pytest.mark.parametrize("dimensions", [1, 2])
def test_what_is_left_out_scatters_as_the_simulations_do(dimensions: int) -> None:
    x, y = simulated(dimensions, 3)
    emulator = fitted(x, y)
    # 1200 values of variance 1 (4 % standard error), and the uncertainty of their prediction on top
    uncertain = np.mean((emulator(x)[0] - smooth(x)) ** 2)
    assert np.mean(emulator.left_out**2) == pytest.approx(1 + uncertain, abs=0.2)


def test_a_resonance_that_is_narrow_beside_the_range_is_resolved() -> None:
    def resonance(x: Array) -> Array:
        return np.asarray(np.linspace(4, 12, OUTPUTS) / (1 + ((x - 0.3) / 0.05) ** 2))

    rng = np.random.default_rng(11)
    x = rng.uniform(-1, 1, (4 * COUNT, 1))
    emulator = fitted(x, resonance(x) + rng.standard_normal((4 * COUNT, OUTPUTS)))
    peak = np.linspace(0.2, 0.4, 41)[:, None]
    # twenty simulations of scatter 1 within a half-width of it; a curve too smooth for it is off by several
    assert np.sqrt(np.mean((emulator(peak)[0] - resonance(peak)) ** 2)) < 1.0


def test_left_out_residuals_are_those_of_a_fit_without_each() -> None:
    x, y = simulated(2, 4)
    emulator = fitted(x, y)
    kernel = replace(emulator, weights=np.eye(COUNT))(x)[0]
    for k in (0, 17, 99):
        kept = np.delete(np.arange(COUNT), k)
        for output, noise in enumerate(emulator.noises):
            inverse = np.linalg.inv(kernel[np.ix_(kept, kept)] + noise * np.eye(COUNT - 1))
            without = kernel[k, kept] @ inverse @ y[kept, output]
            assert emulator.left_out[k, output] == pytest.approx(y[k, output] - without, abs=1e-6)


def test_the_stated_variance_covers_the_errors() -> None:
    x = np.random.default_rng(5).uniform(-0.9, 0.9, (200, 1))
    ratios = []
    for seed in range(6):
        mean, excess = fitted(*simulated(1, seed))(x)
        ratios.append(np.mean((mean - smooth(x)) ** 2) / np.mean(excess))
    # lengths and noises are chosen from few values, and residuals that scatter by more than 1 count too: the
    # variance is right within a factor, not to per cents
    assert 0.1 < np.mean(ratios) < 2


def test_far_from_what_was_simulated_it_says_that_it_does_not_know() -> None:
    emulator = fitted(*simulated(1, 6))
    near, far = (np.mean(emulator(np.array([[x]]))[1]) for x in (0.0, 5.0))
    assert far > 10 * near


def test_the_excess_is_larger_where_residuals_were_larger() -> None:
    rng = np.random.default_rng(7)
    x = rng.uniform(-1, 1, (COUNT, 1))
    y = smooth(x) + np.where(x > 0, 4.0, 1.0) * rng.standard_normal((COUNT, OUTPUTS))
    quiet, loud = fitted(x, y)(np.array([[-0.9], [0.9]]))[1].mean(axis=1)
    # 16 in place of 1, weighed with what lies to the other side and with a prior of 1
    assert loud > 2 * quiet + 2


def test_every_output_has_a_noise_of_its_own() -> None:
    rng = np.random.default_rng(10)
    x = rng.uniform(-1, 1, (COUNT, 1))
    y = np.hstack([300 * np.sin(3 * x), np.zeros_like(x)]) + rng.standard_normal((COUNT, 2))
    emulator = fitted(x, y)
    assert emulator.noises[0] < emulator.noises[1]
    here = np.array([[0.35]])
    # one scatter in 300, and nothing where there is nothing
    assert emulator(here)[0][0] == pytest.approx([300 * np.sin(1.05), 0.0], abs=1.0)


def test_no_response_at_all_is_predicted_as_none() -> None:
    rng = np.random.default_rng(8)
    x, y = rng.uniform(-1, 1, (COUNT, 1)), rng.standard_normal((COUNT, OUTPUTS))
    mean, _ = fitted(x, y)(np.linspace(-1, 1, 50)[:, None])
    # a level and a slope, and where it happens to fit better a bend: three of a hundred degrees of freedom
    assert np.sqrt(np.mean(mean**2)) < 2 * np.sqrt(3 / COUNT)


def test_four_simulations_are_enough_to_begin_with() -> None:
    x = np.array([[0.0], [1.0], [2.0], [3.0]])
    mean, _ = fitted(x, np.hstack([x, 2 * x]))(np.array([[1.5]]))
    # between two values that differ by 1 and 2
    assert mean[0] == pytest.approx([1.5, 3.0], abs=0.5)


def test_a_coordinate_that_never_changed_does_no_harm() -> None:
    x, y = simulated(1, 9)
    mean, excess = fitted(np.hstack([x, np.ones_like(x)]), y)(np.array([[0.2, 1.0]]))
    assert np.isfinite(excess).all()
    assert mean[0] == pytest.approx(smooth(np.array([[0.2]]))[0], abs=1.0)  # one scatter
