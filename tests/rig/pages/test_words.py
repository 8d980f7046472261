"""Numbers as people read them."""

from __future__ import annotations

import math

import pytest

from rig.pages.words import DASH, difference


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
