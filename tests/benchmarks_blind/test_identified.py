"""Rigs whose values lie far off, by the truth engines: what is hidden in them stays there."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from benchmarks.blind.catalogue import CATALOGUE, CRANK, SPATIAL, EffectEntry
from benchmarks.blind.crank.effects import CATALOGUE as OF_CRANK
from benchmarks.blind.crank.record import real_rig as real_crank
from benchmarks.blind.operating_points import points
from benchmarks.blind.spatial.effects import CATALOGUE as OF_SPATIAL
from benchmarks.blind.spatial.record import real_rig as real_spatial
from benchmarks.blind.spatial.rig import Spatial
from benchmarks.identified.rigs import BUILT, drawn_values, lies_off

REAL: dict[str, Any] = {CRANK: real_crank, SPATIAL: real_spatial}
MOVING = [*((CRANK, name) for name in OF_CRANK), *((SPATIAL, name) for name in OF_SPATIAL)]


@pytest.mark.parametrize(("rig", "name"), MOVING)
def test_an_effect_outlives_the_values_of_the_rig(rig: str, name: str) -> None:
    rng = np.random.default_rng(3)
    (point,) = points(rig, 1, rng)
    values = drawn_values(rig, point, rng)
    effect = CATALOGUE[rig][name].draw(rng)
    with_it, without = (
        REAL[rig](
            point, effects, np.random.default_rng(1), np.random.default_rng(2), partial(BUILT[rig], values)
        )
        for effects in ([effect], [])
    )
    assert with_it != without
    plain = REAL[rig](point, [], np.random.default_rng(1), np.random.default_rng(2))
    changes = {CRANK: OF_CRANK, SPATIAL: OF_SPATIAL}[rig]
    assert with_it == changes[name](without, effect["parameters"])
    assert with_it != changes[name](plain, effect["parameters"])


@pytest.mark.parametrize(("own", "lies"), [(0.9, True), (0.61, True), (0.55, False)])
def test_what_is_hidden_lies_off_the_rig_s_own(own: float, lies: bool) -> None:
    effect: EffectEntry = {"name": "restitution", "parameters": {"value": 0.4}}
    assert lies_off(effect, CRANK, {"restitution": own}) == lies


def test_a_heavier_slider_turns_as_heavily() -> None:
    """As the key's own effect on the twin: moments of inertia go with the mass."""
    rig = Spatial(20.0)
    (point,) = points(SPATIAL, 1, np.random.default_rng(4))
    values = {**drawn_values(SPATIAL, point, np.random.default_rng(4)), "slider_mass": 2 * rig.slider.mass}
    heavier = BUILT[SPATIAL](values, rig).slider
    assert heavier.inertia == pytest.approx([2 * moment for moment in rig.slider.inertia])
