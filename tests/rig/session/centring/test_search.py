"""The middle between two touches, for beams whose middle is known, and for rigs that have none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rig.session.centring import Middle, NoCentre, Sine, Touched, find_middle, what_is_touched

REACH = 0.26
PRECISION = 0.01
RATE = 51_200.0


def beam(
    middle: float, reach: float = REACH, gain: float = 0.3 * REACH / 0.06
) -> Callable[[float, float], Touched]:
    """Touches where offset and sine together reach a stop; `gain` is what the sine counts for."""

    def touched(offset: float, amplitude: float) -> Touched:
        above = offset - middle + gain * amplitude > reach
        below = offset - middle - gain * amplitude < -reach
        return "both" if above and below else "upper" if above else "lower" if below else "nothing"

    return touched


def found(touched: Callable[[float, float], Touched], amplitude: float = 0.06) -> Middle:
    return find_middle(touched, Sine(amplitude, 0.036), REACH, PRECISION, 3.0)


@pytest.mark.parametrize("middle", [0.0, 0.08, -0.15, 0.25, -0.6, 1.3])
@pytest.mark.parametrize("stiffer", [0.5, 1.0, 3.0])
def test_the_middle_is_found_within_what_is_stated(middle: float, stiffer: float) -> None:
    answer = found(beam(middle, REACH * stiffer))
    assert abs(answer.offset - middle) <= answer.uncertainty
    assert answer.uncertainty <= PRECISION / 2
    assert answer.probes <= 25


def test_a_sine_that_touches_both_is_made_smaller() -> None:
    answer = found(beam(0.1, gain=6.0))
    assert answer.amplitude == 0.036
    with pytest.raises(NoCentre, match="the least sine touches both stops"):
        found(beam(0.0, gain=90.0))


def test_a_beam_without_room_between_the_touches_still_has_a_middle() -> None:
    """A sine as large as the clearance: one side or the other, and hardly anything between."""
    answer = found(beam(0.07, gain=0.999 * REACH / 0.06))
    assert abs(answer.offset - 0.07) <= answer.uncertainty <= PRECISION / 2


def test_a_dead_sensor_is_told_by_its_side() -> None:
    healthy = beam(0.05)

    def deaf(offset: float, amplitude: float) -> Touched:
        touched = healthy(offset, amplitude)
        return "nothing" if touched == "lower" else touched

    with pytest.raises(NoCentre, match=r"nothing touches the lower stop up to an offset of -2\.6 N"):
        found(deaf)


def test_swapped_sensors_are_not_taken_for_a_middle() -> None:
    healthy, swap = beam(0.3), {"upper": "lower", "lower": "upper"}

    def swapped(offset: float, amplitude: float) -> Touched:
        touched = healthy(offset, amplitude)
        return swap.get(touched, touched)  # type: ignore[return-value]

    with pytest.raises(NoCentre, match=r"nothing touches|contradict"):
        found(swapped)


def test_a_beam_that_answers_at_random_is_refused() -> None:
    answers = np.random.default_rng(2)

    def loose(offset: float, amplitude: float) -> Touched:
        return str(answers.choice(["nothing", "upper", "lower"]))  # type: ignore[return-value]

    with pytest.raises(NoCentre, match=r"contradict|nothing touches"):
        found(loose)


def test_no_offset_is_tried_beyond_the_farthest() -> None:
    tried: list[float] = []

    def nothing(offset: float, amplitude: float) -> Touched:
        tried.append(offset)
        return "nothing"

    with pytest.raises(NoCentre, match="upper stop"):
        find_middle(nothing, Sine(0.06, 0.036), REACH, PRECISION, 1.0)
    assert max(map(abs, tried)) <= 1.0


def forces(upper_n: float, lower_n: float, cycles: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """One contact of half a millisecond in each cycle of 0.1 s on each side, in noise."""
    rng, count = np.random.default_rng(6), round(cycles * 0.1 * RATE)
    pulse = np.sin(np.linspace(0, np.pi, 26))
    both = []
    for newtons, at_s in ((upper_n, 0.02), (lower_n, 0.07)):
        force = 0.05 * rng.standard_normal(count)
        for cycle in range(cycles):
            first = round((cycle * 0.1 + at_s) * RATE)
            force[first : first + 26] += newtons * pulse
        both.append(force)
    return both[0], both[1]


@pytest.mark.parametrize(
    ("upper_n", "lower_n", "expected"),
    [(2.0, 0.0, "upper"), (0.0, 2.0, "lower"), (2.0, 2.0, "both"), (0.0, 0.0, "nothing")],
)
def test_a_stop_is_touched_where_its_force_shows_it_cycle_after_cycle(
    upper_n: float, lower_n: float, expected: Touched
) -> None:
    assert what_is_touched(*forces(upper_n, lower_n), RATE, 10.0, 0.06) == expected


def test_one_knock_is_no_touch() -> None:
    upper, lower = forces(0.0, 0.0)
    upper[20_000:20_026] += 50.0
    assert what_is_touched(upper, lower, RATE, 10.0, 0.06) == "nothing"


def test_a_tip_that_leans_on_a_stop_more_gently_than_the_noise_is_seen_by_the_sine() -> None:
    """0.02 N of the sine in 0.05 N of noise; the sensor shows nothing of the constant force."""
    upper, lower = forces(0.0, 0.0)
    leaning = 0.02 * np.sin(2 * np.pi * 10.0 * np.arange(len(upper)) / RATE + 1.0)
    assert what_is_touched(upper + leaning, lower, RATE, 10.0, 0.06) == "upper"
    assert what_is_touched(upper, lower - leaning, RATE, 10.0, 0.06) == "lower"
