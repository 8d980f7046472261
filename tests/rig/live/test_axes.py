import numpy as np
import pytest

from rig.live.axes import AxesPicture, Frame, decades, from_zero, round_step


@pytest.mark.parametrize(("least", "step"), [(1.0, 1.0), (1.1, 2.0), (2.1, 2.5), (0.03, 0.05), (610, 1000)])
def test_steps_are_round(least: float, step: float) -> None:
    assert round_step(least) == pytest.approx(step)


def test_a_linear_axis_holds_what_it_is_for() -> None:
    axis = from_zero(133.0)
    assert [text for _, text in axis.ticks] == ["0", "50", "100", "150"]
    assert axis.share([0.0, 75.0, 150.0]).tolist() == [0.0, 0.5, 1.0]


def test_a_logarithmic_axis_ends_at_a_decade() -> None:
    axis = decades(33.0, 4, every=2)
    assert (axis.low, axis.high) == pytest.approx((0.01, 100.0))
    assert [text for _, text in axis.ticks] == ["1e2", "1e0", "1e-2"]
    assert axis.share(np.array([0.01, 1.0, 100.0])) == pytest.approx([0.0, 0.5, 1.0])


class Kept:
    """A recording that keeps what is logged where."""

    def __init__(self) -> None:
        self.paths: list[str] = []

    def log(self, path: str, _: object) -> None:
        self.paths.append(path)


def test_axes_are_drawn_again_now_and_then_for_a_page_that_is_opened_late() -> None:
    kept = Kept()
    picture = AxesPicture(kept, "here", Frame())  # type: ignore[arg-type]
    for _ in range(11):
        picture.fit(from_zero(1.0), from_zero(2.0))
    assert kept.paths.count("here/axes") == 3
    picture.fit(from_zero(1.0), from_zero(3.0))
    assert kept.paths.count("here/axes") == 4
