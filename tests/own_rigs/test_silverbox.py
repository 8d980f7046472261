"""Truths of the Silverbox's twin, and what the diagnosis makes of the measured one."""

from __future__ import annotations

import numpy as np
import pytest

from sim_twin.own_rig import Draw
from tests.own_rigs import Verdict, needs_measured_sets
from tests.own_rigs.conftest import Answer
from tests.own_rigs.silverbox import RATE, Circuit, Silverbox

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

LINEAR = Circuit(68.0, 0.05, 1.0)
TIMES = np.arange(8640) / RATE
TONE = 0.1 * np.sin(2 * np.pi * 40 * TIMES) * np.sin(np.pi * TIMES / TIMES[-1]) ** 2
"""V; it begins and ends softly."""


def test_linear_circuit_answers_a_tone_by_its_frequency_response() -> None:
    ratio = 40 / LINEAR.frequency
    expected = 1 / abs(1 - ratio**2 + 2j * LINEAR.damping * ratio)
    middle = LINEAR.respond(TONE, RATE)[4000:4640]
    # 42 periods long, in which the tone's amplitude changes by 0.7 %
    assert middle.std() / TONE[4000:4640].std() == pytest.approx(expected, rel=0.005)


def test_healthy_circuit_lacks_no_force() -> None:
    exact = Silverbox(LINEAR, TONE[None])
    left = exact.fingerprints(TONE[None], LINEAR.respond(TONE, RATE)[None])
    # of the input's root mean square: what Runge and Kutta's steps and the edges leave
    assert np.abs(left).max() < 2e-3


def test_cubic_spring_shows_as_force_over_response() -> None:
    cubic = Circuit(68.0, 0.05, 1.0, cubic=4.0)
    response = cubic.respond(TONE, RATE)
    [left] = Silverbox(LINEAR, TONE[None]).fingerprints(TONE[None], response[None])
    over_response = left[:9]
    largest = response[(response > 1.8 * 0.055) & (response < 2.4 * 0.055)]
    # the cubed response has its third harmonic below 150 Hz, but not its fifth: about (4 y2)2 / 16
    assert over_response[-1] == pytest.approx(4.0 * np.mean(largest**3) / TONE.std(), rel=0.02)
    assert over_response[0] == pytest.approx(-over_response[-1], rel=0.02)  # odd, but for the samples' places


def test_a_spring_that_lets_go_is_a_failed_run() -> None:
    subject = Silverbox(Circuit(68.0, 0.05, 1.0, cubic=-5.0), 4 * TONE[None])
    assert subject.observe([Draw((), 1, ((), ()))]) == [(None, None)]


@needs_measured_sets
def test_measured_circuit_has_a_cubic_spring(answer: Answer) -> None:
    assert answer("silverbox") == Verdict(("cubic_stiffness",), ("cubic_stiffness",))
