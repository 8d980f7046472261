"""What a healthy rig shows otherwise than its twin: learnt where it is, drawn as wide as that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sim_twin.diagnosis.discrepancy import Discrepancy, drawn, learned
from sim_twin.diagnosis.fingerprint import Cell, Layout

OCTAVES = (100.0, 200.0, 400.0, 800.0)


def cells(run: int) -> list[Cell]:
    bands = [Cell(run, "force", "energy", band=(low, 2 * low)) for low in OCTAVES]
    phases = [Cell(run, "force", "rms", phase=(k / 8, (k + 1) / 8)) for k in range(8)]
    return [*bands, *phases, Cell(run, "force", "coherence", band=(100.0, 200.0), partner="yoke")]


LAYOUT = Layout(tuple(cells(0)))
RIGS, BLOCKS = 60, 2


def rigs(rng: np.random.Generator) -> np.ndarray:
    """Each its own scatter of 0.1, each block half as much again."""
    own = 0.1 * rng.standard_normal((RIGS, 1, LAYOUT.size))
    return own + 0.05 * rng.standard_normal((RIGS, BLOCKS, LAYOUT.size))


def measured(rng: np.random.Generator, off: np.ndarray) -> np.ndarray:
    blocks: np.ndarray = 0.1 * rng.standard_normal(LAYOUT.size) + off
    return blocks + 0.05 * rng.standard_normal((6, LAYOUT.size))


def test_what_is_off_is_learnt_where_it_is_and_how_far() -> None:
    rng, off = np.random.default_rng(3), np.zeros(LAYOUT.size)
    off[2], off[4:12] = 2.0, [1.0, -1.0] * 4
    found = {each.what: each for each in learned(LAYOUT, measured(rng, off), rigs(rng))}
    assert set(found) == {"energy", "rms"}
    assert (found["energy"].octave, found["rms"].octave) == (9, None)
    assert found["energy"].deviation == pytest.approx(2.0, rel=0.2)
    assert found["rms"].deviation == pytest.approx(1.0, rel=0.2)


def test_a_rig_like_its_twin_has_hardly_any() -> None:
    rng = np.random.default_rng(5)
    tries = [learned(LAYOUT, measured(rng, np.zeros(LAYOUT.size)), rigs(rng)) for _ in range(60)]
    groups = len(OCTAVES) + 2
    assert sum(map(len, tries)) <= 0.05 * groups * len(tries)  # one in a hundred each, and few rigs tell that


def test_rigs_differ_by_it_as_much_as_was_learnt_and_in_half_of_it_all_cells_of_a_kind_together() -> None:
    known = Discrepancy("force", "rms", 0.4)
    shifts = np.array([drawn(LAYOUT, [known], seed, [0]) for seed in range(2000)])
    assert not shifts[:, :4].any()
    rms = shifts[:, 4:12]
    assert rms.std(axis=0) == pytest.approx(0.4, rel=0.1)
    assert np.corrcoef(rms[:, 0], rms[:, 5])[0, 1] == pytest.approx(0.5, abs=0.1)
    assert shifts[:, 12].tolist() == [0.0] * len(shifts)


def test_it_holds_for_bands_that_lie_an_octave_off_and_no_farther() -> None:
    shift = drawn(LAYOUT, [Discrepancy("force", "energy", 1.0, octave=10)], 1, [0])
    assert [bool(each) for each in shift[:4]] == [False, False, True, True]


def test_a_run_is_off_alike_whichever_runs_are_with_it() -> None:
    known = [Discrepancy("force", "rms", 0.4), Discrepancy("force", "energy", 0.2, octave=9)]
    both = Layout((*LAYOUT.cells, *(replace(cell, run=1) for cell in LAYOUT.cells)))
    together = drawn(both, known, 7, [0, 1])
    assert together[LAYOUT.size :].tolist() == drawn(LAYOUT, known, 7, [1]).tolist()
    assert together[: LAYOUT.size].tolist() != together[LAYOUT.size :].tolist()
