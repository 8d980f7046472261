"""When a result agrees, differs, or leaves a question open."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.reproduce.figure import (
    Claim,
    Sample,
    Statement,
    Verdict,
    about,
    above,
    against,
    below,
    between,
    ratio,
    tally,
)

TEXT, PLACE = "what it says", "where"


@pytest.mark.parametrize(
    ("claim", "ours", "error", "verdict"),
    [
        (about(34.0, TEXT, PLACE), 34.0, None, Verdict.AGREES),
        (about(34.0, TEXT, PLACE), 37.3, None, Verdict.AGREES),  # 9.7 %
        (about(34.0, TEXT, PLACE), 37.5, None, Verdict.DIFFERS),  # 10.3 %
        (
            about(34.0, TEXT, PLACE),
            37.3,
            5.0,
            Verdict.AGREES,
        ),  # a wide error leaves a number no question open
        (about(-2.0, TEXT, PLACE), -2.1, None, Verdict.AGREES),
        (between(150.0, 200.0, TEXT, PLACE), 170.0, None, Verdict.AGREES),
        (between(150.0, 200.0, TEXT, PLACE), 140.0, None, Verdict.DIFFERS),
        (above(1.0, TEXT, PLACE), 1.05, 0.01, Verdict.AGREES),
        (above(1.0, TEXT, PLACE), 1.01, 0.01, Verdict.OPEN),
        (above(1.0, TEXT, PLACE), 0.99, 0.01, Verdict.OPEN),
        (above(1.0, TEXT, PLACE), 0.97, 0.01, Verdict.DIFFERS),
        (below(1.0, TEXT, PLACE), 0.9, None, Verdict.AGREES),
    ],
)
def test_verdicts(claim: Claim, ours: float, error: float | None, verdict: Verdict) -> None:
    assert Statement("subject", claim, ours, error=error).verdict is verdict


def test_deviations_are_from_the_texts_value_or_the_nearer_end() -> None:
    assert about(34.0, TEXT, PLACE).deviation(17.0) == pytest.approx(-0.5)
    assert about(34.0, TEXT, PLACE).deviation(34.34) == pytest.approx(0.01)
    assert between(150.0, 200.0, TEXT, PLACE).deviation(140.0) == pytest.approx(-10 / 150)
    assert between(150.0, 200.0, TEXT, PLACE).deviation(220.0) == pytest.approx(0.1)
    assert between(150.0, 200.0, TEXT, PLACE).deviation(170.0) is None
    assert above(0.0, TEXT, PLACE).deviation(-1.0) is None


def test_mean_deviation_and_error_of_a_sample() -> None:
    sample = Sample(np.array([1.0, 2.0, 3.0, 4.0]))
    assert sample.mean == 2.5
    assert sample.deviation == pytest.approx(math.sqrt(5 / 3))
    assert sample.error == pytest.approx(math.sqrt(5 / 12))


def test_the_error_of_a_ratio_is_that_of_many_drawn_ratios() -> None:
    rng = np.random.default_rng(1)
    over, under = rng.normal(30.0, 3.0, 400), rng.normal(20.0, 2.0, 400)
    value, error, _ = ratio(Sample(over), Sample(under))
    drawn = rng.normal(30.0, 3.0 / 20, 20_000) / rng.normal(20.0, 2.0 / 20, 20_000)
    # The error's own scatter: deviations from 400 values are good to 3.5 %, twice.
    assert error == pytest.approx(float(drawn.std()), rel=0.15)
    assert value == pytest.approx(1.5, abs=5 * error)


@pytest.mark.parametrize(
    ("statement", "ours", "deviation", "words"),
    [
        (
            against("s", about(34.0, TEXT, PLACE), Sample(np.array([22.0, 24.0])), "N"),
            "23.0 ± 1.4 N", "−32\u00a0%", "differs by −32\u00a0%",
        ),
        (Statement("s", about(430.0, TEXT, PLACE), 428.9, "Hz"), "429 Hz", "−0.3\u00a0%", "agrees"),
        (Statement("s", above(1.0, TEXT, PLACE), 1.2345, error=0.012), "1.234 ± 0.012", "–", "agrees"),
        (
            Statement("s", above(1.0, TEXT, PLACE), 0.9999, error=0.0011),
            "0.9999 ± 0.0011", "0.0\u00a0%", "open: within our scatter",
        ),
        (Statement("s", above(10.0, TEXT, PLACE), 128.0, deviation=40.0), "128 ± 40", "–", "agrees"),
    ],
)  # fmt: skip
def test_rows_read_as_people_write_them(statement: Statement, ours: str, deviation: str, words: str) -> None:
    assert statement.ours_words == ours
    assert statement.gap_words == deviation
    assert statement.verdict_words == words


def test_what_ifs_do_not_count() -> None:
    claim = about(1.0, TEXT, PLACE)
    rows = [Statement("s", claim, 1.0), Statement("s", claim, 2.0), Statement("s", claim, 1.0, what_if=True)]
    assert tally(rows) == {Verdict.AGREES: 1, Verdict.OPEN: 0, Verdict.DIFFERS: 1}
