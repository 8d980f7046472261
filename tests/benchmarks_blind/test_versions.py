"""What is said of another version beside this one, and what it is held to."""

from __future__ import annotations

import pytest

from benchmarks.versions import DIAGNOSED, NAMES, within

A_THIRD = [(10.0, 31.0), (11.0, 33.0), (9.0, 30.0)]


@pytest.mark.parametrize("name", DIAGNOSED)
def test_of_a_diagnosis_median_and_longest_are_told_and_held(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert within(name, A_THIRD)
    median, longest = capsys.readouterr().out.splitlines()
    assert median == f"{name}: median 10.00 s here, 31.00 there; ratio 0.323 (0.300 to 0.333; bar 0.3333)"
    assert longest == f"{name}: longest 11.00 s here, 33.00 there; ratio 0.333 (bar 0.3333)"
    # one that takes long, of which the median knows nothing
    assert not within(name, [*A_THIRD, (16.0, 31.0)])
    assert "longest 16.00 s here, 33.00 there; ratio 0.485" in capsys.readouterr().out
    # and the other way round: the longest alone would pass
    assert not within(name, [(10.0, 20.0), (10.0, 20.0), (10.0, 90.0)])


def test_of_anything_else_the_median_alone_is_held(capsys: pytest.CaptureFixture[str]) -> None:
    for name in NAMES:
        if name not in DIAGNOSED:
            assert within(name, [(1.0, 1.0), (1.0, 1.0), (5.0, 1.0)])
            assert "longest" not in capsys.readouterr().out
            assert not within(name, [(1.2, 1.0)] * 3)
            capsys.readouterr()
