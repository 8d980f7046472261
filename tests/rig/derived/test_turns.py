import numpy as np
import pytest
from numpy.typing import NDArray

from rig.derived.turns import EncoderTurns, MarkerTurns, Turns, turns_from
from tests.rig.derived.turning import COUNTS, RATE, encoder_rad, in_blocks, marker_v, turns


def followed(follower: Turns, values: NDArray[np.floating], length: int = 2560) -> Turns:
    for block in in_blocks(follower.channel, values, length):
        follower.add(block)
    return follower


def test_the_encoder_comes_first_then_the_marker() -> None:
    assert isinstance(
        turns_from(("crank.marker", "crank.angle"), "crank.angle", "crank.marker", 1.0), EncoderTurns
    )
    assert isinstance(turns_from(("crank.marker",), "crank.angle", "crank.marker", 1.0), MarkerTurns)
    assert turns_from(("motor.tachometer",), "crank.angle", "crank.marker", 1.0) is None


def test_an_encoders_steps_are_smoothed() -> None:
    way = turns(2.0, fluctuation=0.05)
    follower = followed(EncoderTurns("crank.angle"), encoder_rad(way))
    inner = np.arange(200, follower.known_until)
    error = follower.at(inner) - (way[inner] - 0.5 / COUNTS)  # the last whole count is half a count behind
    # A count is uniformly distributed: rms 0.29. Over 103 samples a cubic leaves 0.29 (9 / 4 / 103)^0.5 of
    # independent ones; neighbours share counts, so somewhat more.
    assert np.sqrt(np.mean(error**2)) < 0.1 / COUNTS
    assert len(way) - follower.known_until < 0.0025 * RATE


@pytest.mark.parametrize("length", [256, 1000, 51_200])
def test_how_an_angle_is_cut_makes_no_difference(length: int) -> None:
    way = turns(2.0)
    whole, cut = (followed(EncoderTurns("crank.angle"), encoder_rad(way), n) for n in (len(way), length))
    known = np.arange(200, min(whole.known_until, cut.known_until))  # the first block's edge is fitted anew
    assert np.allclose(cut.at(known), whole.at(known), rtol=0, atol=1e-9)


def test_a_marker_tells_the_turns_between_two_marks() -> None:
    way = turns(3.0)
    follower = followed(MarkerTurns("crank.marker"), marker_v(way))
    first, last = np.flatnonzero(np.diff(np.floor(way)))[[0, -1]] + 1
    assert abs(follower.known_until - last) <= 1
    inner = np.arange(first + 1, last - 1)
    # A rectangular mark lies up to a sample off: 1.3e-4 turns at 200 rpm.
    assert follower.at(inner) == pytest.approx(
        way[inner] - way[first].round(), abs=1.5 * way[1] - 1.5 * way[0]
    )
    assert np.isnan(follower.at(np.array([first - 2, last + 2]))).all()


def test_a_mark_comes_at_the_angle_that_the_bench_says() -> None:
    way = turns(3.0)
    plain, turned = (followed(MarkerTurns("crank.marker", at), marker_v(way)) for at in (0.0, np.pi / 2))
    known = np.arange(len(way) // 2, plain.known_until)
    assert turned.at(known) - plain.at(known) == pytest.approx(0.25)


@pytest.mark.parametrize("kind", [EncoderTurns, MarkerTurns])
def test_after_a_hole_turns_are_known_again(kind: type[EncoderTurns] | type[MarkerTurns]) -> None:
    follower, way = kind("crank"), turns(6.0)
    values = encoder_rad(way) if kind is EncoderTurns else marker_v(way)
    half = len(way) // 2
    for block in (*in_blocks("crank", values[: half - 5000]), *in_blocks("crank", values[half:], first=half)):
        follower.add(block)
    later = np.arange(half + 10_000, len(way) - 10_000)
    found = follower.at(later)
    assert found - found[0] == pytest.approx(way[later] - way[later[0]], abs=1e-3)  # a few counts or samples
    assert np.isnan(follower.at(np.array([half - 2000]))).all()


def test_samples_that_are_no_numbers_leave_a_straight_line() -> None:
    way = turns(1.0)
    angle = encoder_rad(way)
    angle[5000:5050] = np.nan
    follower = followed(EncoderTurns("crank.angle"), angle)
    inner = np.arange(4000, 6000)
    assert follower.at(inner) == pytest.approx(way[inner], abs=1.5 / COUNTS)  # one count at either end
    follower.add(next(in_blocks("crank.angle", np.full(2560, np.nan), first=len(way))))
    assert follower.known_until <= len(way)
