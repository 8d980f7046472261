"""Truths of the falling ball's twin, and what the diagnosis makes of the filmed ones."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.own_rig import Draw
from tests.own_rigs import Verdict, needs_measured_sets
from tests.own_rigs.ball_drop import HEIGHT, SUBJECT, TIME, fall, fingerprint
from tests.own_rigs.conftest import Answer

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

TIMES = np.arange(41) / 15
LIGHT = (
    *(f"{colour} basketball" for colour in ("blue", "green")),
    *("tennis ball", "volleyball", "orange whiffle ball", "yellow whiffle ball"),
    *(f"whiffle ball {number}" for number in (1, 2)),
)
RIGHT = ({"drag"}, {"drag", "scaled_gravity"})


def test_ball_falls_freely_without_drag() -> None:
    depth = fall(271, 0.01, 1.0, 9.81, np.inf, 2.0)
    times = 0.01 * np.arange(271)
    assert depth == pytest.approx(times + 0.5 * 9.81 * times**2, abs=1e-9)  # the midpoint rule is exact here


def test_ball_with_drag_nears_its_terminal_speed() -> None:
    depth = fall(271, 0.01, 0.0, 9.81, 12.0, 2.0)
    times = 0.01 * np.arange(271)
    exact = 12.0**2 / 9.81 * np.log(np.cosh(9.81 * times / 12.0))
    assert depth == pytest.approx(exact, abs=1e-3)  # of 23 m; far below a pixel


def test_start_of_a_drop_leaves_no_trace() -> None:
    later = TIMES + 0.3
    left = fingerprint({TIME: TIMES, HEIGHT: 47 - 0.7 * later - 0.5 * 9.81 * later**2})[HEIGHT]
    assert left == pytest.approx(0, abs=1e-9)


def test_blocks_are_drops_of_the_same_ball() -> None:
    filmed = {"Drop #": np.repeat([1, 2, 3], len(TIMES)), TIME: np.tile(TIMES, 3)}
    ball, drops = SUBJECT.measured([{**filmed, HEIGHT: np.zeros(3 * len(TIMES))}])
    assert len(drops) == 3
    [(blocks,)] = ball.observe([Draw((("drag", {"terminal_speed": 12.0, "power": 2.0}),), 3, blocks=2)])
    assert blocks is not None
    assert blocks.shape == (2, ball.layout.size)
    # they differ by errors of decimetres, and from free fall by metres
    assert np.abs(blocks[0] - blocks[1]).max() < 1.5 < np.abs(blocks).max(axis=1).min()


@needs_measured_sets
def test_drag_is_found_on_at_least_six_of_eight_light_balls(answer: Answer) -> None:
    found = {name: answer(name) for name in LIGHT}
    right = [name for name, given in found.items() if len(given.selected) == 1 and set(given.alike) in RIGHT]
    assert len(right) >= 6, found


@needs_measured_sets
def test_nothing_is_missing_on_the_bowling_ball(answer: Answer) -> None:
    assert answer("bowling ball") == Verdict((), ("none",))
