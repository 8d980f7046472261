import numpy as np
import pytest
from numpy.typing import NDArray

from daq.signals.impacts import find_impacts, half_cycles

RATE = 51_200.0


def force(*pulses: tuple[float, float], seconds: float = 1.0, contact_s: float = 1e-3) -> NDArray[np.float64]:
    """Half-sine contacts (start in s, peak in N) in noise of 0.05 N."""
    values = np.random.default_rng(3).normal(scale=0.05, size=round(seconds * RATE))
    for start_s, peak_n in pulses:
        count = round(contact_s * RATE)
        first = round(start_s * RATE)
        values[first : first + count] += peak_n * np.sin(np.pi * np.arange(count) / count)
    return values


def test_an_impact_has_the_peak_impulse_and_duration_of_its_pulse() -> None:
    found = find_impacts(force((0.2, 40.0), (0.5, 20.0)), RATE)
    # Noise of 0.05 N adds up to three of its deviations to a peak that is flat over some samples.
    assert found.peak_n == pytest.approx([40.0, 20.0], abs=0.2)
    assert found.index / RATE == pytest.approx([0.2005, 0.5005], abs=1e-4)
    # A half sine of peak F and duration T has the impulse 2 F T / pi; 2 % of it lies below the release level.
    assert found.impulse_ns == pytest.approx([2 * 40e-3 / np.pi, 2 * 20e-3 / np.pi], rel=0.02)
    assert found.contact_s == pytest.approx([1e-3, 1e-3], abs=1e-4)


def test_a_contact_counts_from_fifteen_hundredths_of_the_largest_force() -> None:
    values = force((0.2, 40.0), (0.5, 5.5), (0.7, 6.5))
    assert find_impacts(values, RATE).peak_n == pytest.approx([40.0, 6.5], abs=0.2)
    assert len(find_impacts(values, RATE, largest=100.0)) == 1


def test_noise_alone_is_no_impact() -> None:
    assert len(find_impacts(force(), RATE)) == 0
    assert len(half_cycles(force(), force(), RATE)) == 0


@pytest.mark.parametrize("values", [np.empty(0), np.full(100, np.nan), np.zeros(100)])
def test_a_record_without_force_has_no_impacts(values: np.ndarray) -> None:
    assert len(find_impacts(values, RATE)) == 0


def test_contact_at_both_ends_of_the_record_is_found() -> None:
    values = np.zeros(100)
    values[:5] = 10.0
    values[-5:] = 20.0
    found = find_impacts(values, RATE)
    assert found.start.tolist() == [0, 95]
    assert found.end.tolist() == [5, 100]


def test_samples_that_are_missing_end_a_contact() -> None:
    values = np.zeros(100)
    values[40:60] = 30.0
    values[50] = np.nan
    assert find_impacts(values, RATE).end.tolist() == [50, 60]


def test_half_cycles_change_with_the_side_and_know_first_and_max() -> None:
    upper = force((0.10, 20.0), (0.11, 30.0), (0.12, 7.0), (0.50, 25.0))
    lower = force((0.30, 40.0), (0.31, 10.0), (0.70, 15.0), (0.71, 35.0))
    found = half_cycles(upper, lower, RATE)
    assert found.side.tolist() == [1, -1, 1, -1]
    assert found.first_n == pytest.approx([20.0, 40.0, 25.0, 15.0], abs=0.2)
    assert found.max_n == pytest.approx([30.0, 40.0, 25.0, 35.0], abs=0.2)
    assert found.contacts.tolist() == [3, 2, 1, 2]
    assert found.max_index / RATE == pytest.approx([0.1105, 0.3005, 0.5005, 0.7105], abs=1e-4)


def test_a_faint_touch_does_not_end_a_half_cycle() -> None:
    upper, lower = force((0.1, 40.0), (0.3, 30.0)), force((0.2, 3.0))
    assert half_cycles(upper, lower, RATE).contacts.tolist() == [2]


def test_one_side_alone_is_one_half_cycle() -> None:
    assert len(half_cycles(force((0.1, 40.0), (0.5, 30.0)), force(), RATE)) == 1
