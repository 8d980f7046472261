"""Gap figures: healthy rigs are 1 on average, and what shrinks is counted from there."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm, wasserstein_distance

from sim_twin.diagnosis.fingerprint import SLICES, Cell, Layout, of_cycles
from sim_twin.diagnosis.gap import gap_measure, shrink_of
from sim_twin.diagnosis.space import Moments

Array = NDArray[np.float64]
CELLS = 40
LAYOUT = Layout(tuple(of_cycles(0, "a" if k < 20 else "b", "mean") for k in range(CELLS)))


def rigs(count: int, seed: int, moved: float = 0.0) -> list[Array]:
    """Two blocks of each rig: what belongs to the rig, and what scatters from block to block."""
    rng = np.random.default_rng(seed)
    own = moved + rng.normal(size=(count, 1, CELLS, 1))
    block = rng.normal(size=(count, 2, CELLS, 1)) + 0.5 * np.linspace(-1, 1, SLICES)
    return list((own + block).reshape(count, 2, LAYOUT.size))


def test_healthy_rigs_that_the_measure_never_saw_are_1_on_average() -> None:
    measure = gap_measure(rigs(100, 1), LAYOUT)
    totals = [measure.total(measure.cells(each)) for each in rigs(100, 2)]
    own = [measure.total(measure.cells(each)) for each in rigs(100, 1)]
    assert np.sqrt(np.mean(np.square(own))) == pytest.approx(1.0)
    # a hundred rigs, each of 40 cells that scatter by a half: 1 %; and the twin's own error of 1 / 100
    assert np.mean(totals) == pytest.approx(1.0, abs=0.05)
    assert np.std(totals) < 0.2


def test_the_gap_grows_with_the_distance() -> None:
    measure = gap_measure(rigs(100, 1), LAYOUT)
    totals = [measure.total(measure.cells(rigs(1, 3, moved)[0])) for moved in (0, 2, 4, 8, 16)]
    assert np.all(np.diff(totals[1:]) > 0)
    # far away the distance is the shift, in floors: mean |x| of a bell of variance 2, over the healthy unit
    assert totals[-1] == pytest.approx(16 / (2 / np.sqrt(np.pi)) / measure.unit, rel=0.1)


def test_two_runs_lie_as_far_apart_as_what_a_rig_shows_otherwise_in_them() -> None:
    layout = Layout(tuple(replace(cell, run=run) for run in (0, 1) for cell in LAYOUT.cells))
    healthy = [np.concatenate([each, each], axis=1) for each in rigs(100, 1)]
    measure = gap_measure(healthy, layout)
    one = rigs(1, 3)[0]
    other = np.concatenate([one, one + 4.0], axis=1)
    assert measure.apart(healthy[0], 0, 1) == pytest.approx({"mean of a": 0.0, "mean of b": 0.0}, abs=1e-9)
    # wherever the two lie: as far as a rig that is off by as much from the twin itself
    off = measure.cells((measure.twin + 4.0)[None]).reshape(2, 2, CELLS // 2)
    for pair in ((0, 1), (1, 0)):
        rms = np.sqrt(np.mean(off[pair[0]] ** 2, axis=1))
        assert [*measure.apart(other, *pair).values()] == pytest.approx(list(rms))
    assert measure.of_runs(other)[0] < 2.0 < measure.of_runs(other)[1]
    assert measure.course(other) == [[measure.of_runs(each[None])[run] for each in other] for run in (0, 1)]


def test_two_runs_are_held_against_each_other_by_what_is_looked_at_in_both() -> None:
    """Bands begin and end where the measured frequency has them."""

    def of_run(run: int, channel: str, times: float) -> list[Cell]:
        edges = times * np.array([20.0, 40.0, 80.0])
        return [of_cycles(run, channel, "energy", (low, high)) for low, high in pairwise(edges.tolist())]

    layout = Layout(
        (*of_run(0, "a", 1.0), *of_run(0, "b", 1.0), *of_run(1, "a", 1.002), *of_run(1, "b", 1.2))
    )
    healthy = np.random.default_rng(1).normal(size=(20, 1, layout.size))
    measure = gap_measure(list(healthy), layout)
    assert measure.apart(healthy[0], 0, 1).keys() == {"energy of a"}
    apart = layout.only(lambda cell: (cell.run, cell.channel) in ((0, "a"), (1, "b")))[0]
    assert (
        gap_measure(list(healthy[:, :, : apart.size]), apart).apart(healthy[0, :, : apart.size], 0, 1) == {}
    )


def test_a_cell_is_the_wasserstein_distance_of_its_distributions() -> None:
    middles = (np.arange(SLICES) + 0.5) / SLICES
    one, other = norm.ppf(middles), 3 + 2 * norm.ppf(middles)
    measure = gap_measure([one[None] + 1, one[None] - 1], Layout((of_cycles(0, "a", "mean"),)))
    # the healthy rigs lie 1 to either side of the twin, so that is the floor
    assert measure.cells(other[None])[0] == pytest.approx(wasserstein_distance(one, other))


def test_one_cell_says_no_more_than_forty_floors_and_one_that_never_changes_nothing() -> None:
    healthy = [each.copy() for each in rigs(50, 4)]
    for each in healthy:
        each[:, :SLICES] = 0.0
    measure = gap_measure(healthy, LAYOUT)
    cells = measure.cells(healthy[0] + 1e9)
    assert cells[0] == 0
    assert cells[1:] == pytest.approx(np.full(CELLS - 1, 40.0))


def test_a_part_of_the_cells_has_a_gap_of_its_own() -> None:
    measure = gap_measure(rigs(100, 1), LAYOUT)
    moved = rigs(1, 5)[0]
    moved[:, : 20 * SLICES] += 10
    cells = measure.cells(moved)
    one = measure.total(cells, lambda cell: cell.channel == "a")
    other = measure.total(cells, lambda cell: cell.channel == "b")
    assert one > 5 * other
    assert measure.total(cells) == pytest.approx(np.sqrt((one**2 + other**2) / 2))
    assert measure.total(cells, lambda _: False) == 0


def test_a_tolerance_of_other_programs_is_in_the_floor() -> None:
    layout = Layout((of_cycles(0, "a", "energy"), of_cycles(0, "a", "mean")))
    quiet = [np.tile(1e-3 * sign, (1, 2 * SLICES)) for sign in (-1.0, 1.0)]
    measure = gap_measure(quiet, layout)
    allowed = Moments(layout).tolerance[0]  # the space of the search allows the same
    assert allowed > 0.01
    assert measure.floor == pytest.approx([np.hypot(allowed, 1e-3), 1e-3])


def repaired(count: int, seed: int, scatter: float = 1.0) -> Array:
    """One block of each of some rigs about the same twin; the first half of the cells scatters otherwise."""
    blocks = np.concatenate([each[:1] for each in rigs(count, seed)])
    middle = np.tile(0.5 * np.linspace(-1, 1, SLICES), CELLS)
    sizes = np.repeat(np.where(np.arange(CELLS) < CELLS // 2, scatter, 1.0), SLICES)
    return np.asarray(middle + sizes * (blocks - middle))


def test_a_repaired_twin_that_is_the_nominal_one_measures_the_same() -> None:
    measure = gap_measure(rigs(100, 1), LAYOUT)
    mended = measure.of_repaired(repaired(60, 6))
    ratios = [mended.total(mended.cells(b)) / measure.total(measure.cells(b)) for b in rigs(30, 7)]
    # floors are estimates of 60 rigs, and its unit is of single blocks, so that two lie a little nearer
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)


def test_a_healthy_rig_with_the_effect_in_is_1_from_the_twin_that_has_it_however_much_it_scatters() -> None:
    measure = gap_measure(rigs(100, 1), LAYOUT)
    mended = measure.of_repaired(repaired(60, 6, scatter=5.0))
    others = repaired(60, 8, scatter=5.0)
    assert np.mean([mended.total(mended.cells(b[None])) for b in others]) == pytest.approx(1.0, abs=0.05)
    assert np.mean([measure.total(measure.cells(b[None])) for b in others]) > 3


def test_a_repaired_twin_that_scatters_less_keeps_the_healthy_floor() -> None:
    measure = gap_measure(rigs(100, 1), LAYOUT)
    mended = measure.of_repaired(repaired(60, 6, scatter=0.01))
    assert np.all(mended.floor >= measure.floor)
    assert np.array_equal(mended.floor[: CELLS // 2], measure.floor[: CELLS // 2])


@pytest.mark.parametrize(
    ("before", "after", "shrink"),
    [
        (7.4, 1.1, 1 - 0.1 / 6.4),
        (7.4, 0.8, 1.0),
        (7.4, 7.4, 0.0),
        (3.0, 5.0, -1.0),
        (1.0, 1.0, None),
        (0.7, 0.5, None),
    ],
)
def test_shrink_counts_from_the_floor_and_means_nothing_below_it(
    before: float, after: float, shrink: float | None
) -> None:
    assert shrink_of(before, after) == (None if shrink is None else pytest.approx(shrink))
