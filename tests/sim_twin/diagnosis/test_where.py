"""What does not fit is told; something outside the catalogue is placed by what it resembles, or nowhere."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.fingerprint import Cell, Layout, of_cycles
from sim_twin.diagnosis.gap import GapMeasure, gap_measure
from sim_twin.diagnosis.library import Library, learned, order_of
from sim_twin.diagnosis.space import Moments
from sim_twin.diagnosis.where import NOT_KNOWN, alone_off, not_fitting, where_unknown
from tests.sim_twin.diagnosis.toy import CELLS, CHANNELS, SIZE, Blocks, Toy, healthy_rig, recording, shown

OF_ONE = (np.arange(CELLS) % len(CHANNELS) == 0).astype(float)
PLUG = Cause("plug", "sensor", (SIZE,), "one", sensing=True)
OTHER = Cause("plug", "sensor", (SIZE,), "two", sensing=True)
WIDE = Cause("wide", "everywhere", (SIZE,))
NOTHING = np.zeros(1)


@cache
def measure() -> GapMeasure:
    return gap_measure([recording((), seed, 2) for seed in range(60)], Toy().layout)


def rig(seed: int, moved: np.ndarray, blocks: int = 1) -> Blocks:
    return shown(healthy_rig(seed, blocks) + moved)


def library() -> Library:
    """Rigs of which a plug shows in one channel each, and something wide in all."""
    found = Library()
    for cause, pattern in {PLUG: OF_ONE, OTHER: np.roll(OF_ONE, 1), WIDE: np.ones(CELLS)}.items():
        order = order_of({(cause,): np.full((8, 1), 2.0)}, np.random.default_rng(0), together=1)
        found.add(order, [(rig(k, 6 * pattern),) for k in range(len(order))])
    return found


@pytest.mark.parametrize(("moved", "channel"), [(OF_ONE, "one"), (np.roll(OF_ONE, 2), "three")])
def test_a_channel_that_alone_is_off_is_named(moved: np.ndarray, channel: str) -> None:
    assert alone_off((measure(),), rig(500, 6 * moved, 4)) == channel


def test_no_channel_is_named_where_several_or_none_are_off() -> None:
    assert alone_off((measure(),), rig(500, 6 * np.ones(CELLS), 4)) == ""
    assert [alone_off((measure(),), rig(500 + k, np.zeros(CELLS), 4)) for k in range(20)] == [""] * 20


def test_figures_that_do_not_fit_are_those_that_no_rig_like_it_has() -> None:
    cells = tuple(of_cycles(0, CHANNELS[k % 4], f"height {k // 24}") for k in range(CELLS))
    like = np.array([rig(k, np.zeros(CELLS))[0] for k in range(30)])
    late = OF_ONE * (np.arange(CELLS) >= 24)
    [(found, times)] = not_fitting(Layout(cells), rig(500, 6 * late, 4), like)
    assert (found.channel, found.what) == ("one", "height 1")
    assert found.deviation == pytest.approx(6.0, abs=0.5)
    assert times > 3
    assert not_fitting(Layout(cells), rig(500, 6 * late, 4), like[:5]) == ()  # too few to tell
    healthy = [not_fitting(Layout(cells), rig(500 + k, np.zeros(CELLS), 4), like) for k in range(20)]
    assert sum(map(len, healthy)) <= 1  # of 160


def test_what_is_quiet_else_counts_as_much_as_what_is_loud() -> None:
    cells = tuple(Cell(0, "force", "rms", phase=(k / 8, (k + 1) / 8)) for k in range(8))
    sizes, rng = np.array([1.0] * 7 + [0.01]), np.random.default_rng(3)
    like = sizes * rng.standard_normal((40, 8))
    off = sizes * rng.standard_normal((4, 8)) / 10 + np.array([0.0] * 7 + [0.2])
    [(found, times)] = not_fitting(Layout(cells), off, like)
    assert (found.channel, found.what) == ("force", "rms")
    assert times > 3


def test_a_channel_may_be_off_beside_what_is_explained() -> None:
    both = rig(500, 6 * np.ones(CELLS) + 6 * OF_ONE, 4)
    explained = np.concatenate([rig(k, 6 * np.ones(CELLS)) for k in range(20)]).astype(np.float64)
    assert alone_off((measure(), measure().of_repaired(explained)), both) == "one"


def test_something_unknown_sits_where_what_resembles_it_does() -> None:
    found = library()
    healthy = order_of({(): np.zeros((60, 0))}, np.random.default_rng(1), blocks=2)
    found.add(healthy, [(rig(200 + k, np.zeros(CELLS), 2),) for k in range(60)])
    attribution = learned(found, Moments(Toy().layout), [4.0])
    causes = (PLUG, OTHER, WIDE)
    twisted = OF_ONE * np.linspace(0.5, 1.5, CELLS)  # no plug does that
    shares = where_unknown(attribution, rig(500, 6 * twisted, 4), NOTHING, causes, found)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda each: shares[each]) == "sensor"
    shares = where_unknown(attribution, rig(500, 6 * np.linspace(0.5, 1.5, CELLS), 4), NOTHING, causes, found)
    assert max(shares, key=lambda each: shares[each]) == "everywhere"
    explained = attribution.place(rig(501, 6 * np.ones(CELLS), 4)).mean(axis=0)
    both = rig(500, 6 * np.ones(CELLS) + 6 * twisted, 4)
    shares = where_unknown(attribution, both, explained, causes, found)
    assert max(shares, key=lambda each: shares[each]) == "sensor"
    nothing_like_it = np.roll(OF_ONE, 2) - np.roll(OF_ONE, 3)
    assert where_unknown(attribution, rig(500, 6 * nothing_like_it, 4), NOTHING, causes, found) == {
        NOT_KNOWN: 1.0
    }
