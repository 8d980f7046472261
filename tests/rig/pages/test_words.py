"""Numbers as people read them."""

from __future__ import annotations

import math

import pytest

from rig.pages.words import DASH, difference, estimate, number, numbers, probability, signed, span


@pytest.mark.parametrize(
    ("predicted", "measured", "told"),
    [
        (110.0, 100.0, "+10.0 %"),
        (90.0, 100.0, "−10.0 %"),
        (99.99, 100.0, "0.0 %"),
        (100.01, 100.0, "0.0 %"),
        (1.0, 0.0, DASH),
        (math.nan, 1.0, DASH),
    ],
)
def test_a_difference_has_its_sign_and_none_is_none(predicted: float, measured: float, told: str) -> None:
    assert difference(predicted, measured) == told


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [
        (1234.5678, "N", "1235 N"),
        (0.0012345, "", "0.001234"),
        (1.2345e-4, "m", "1.234e-04 m"),
        (123456.7, "N/m", "123457 N/m"),
        (0.0, "N", "0 N"),
        (math.inf, "N", DASH),
        (None, "N", DASH),
    ],
)
def test_what_was_measured_has_four_digits(value: float | None, unit: str, told: str) -> None:
    assert number(value, unit) == told


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [
        (62e-6, "s", "62 µs"),
        (0.0123, "s", "12.3 ms"),
        (1.0, "s", "1 s"),
        (431.26, "Hz", "431 Hz"),
        (2.5e7, "N/m", "2.5e7 N/m"),
        (3.21e-7, "", "3.21e-7"),
    ],
)
def test_what_was_estimated_has_three_digits(value: float, unit: str, told: str) -> None:
    assert estimate(value, unit) == told


def test_a_span_says_its_unit_once_unless_its_ends_have_two() -> None:
    assert span(419.2, 444.4, "Hz") == "419 to 444 Hz"
    assert span(50e-6, 2e-3, "s") == "50 µs to 2 ms"


def test_no_probability_is_called_certain() -> None:
    assert [probability(share) for share in (0.0, 0.004, 0.5, 0.994, 0.9999)] == [
        "< 1 %", "< 1 %", "50 %", "99 %", "> 99 %",
    ]  # fmt: skip


def test_numbers_of_a_row_are_written_alike() -> None:
    assert numbers([0.1234, 0.000123456, math.nan]) == ["0.1234", "0.0001235", DASH]
    assert numbers([1234.5, 0.4, 0.0]) == ["1234", "0.4", "0"]
    assert numbers([2e-5, 3e-7]) == ["2.000e-05", "3.000e-07"]
    assert numbers([0.0, 0.0]) == ["0", "0"]
    assert numbers([]) == []


def test_what_rounds_to_0_has_no_sign() -> None:
    assert [signed(each) for each in (0.5, -0.5, -0.001)] == ["+0.50", "−0.50", "0.00"]
