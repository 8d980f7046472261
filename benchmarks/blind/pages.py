"""What the truth may have that the twin's page has not: other laws, and values that people get wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from benchmarks.blind.catalogue import Quantity
from benchmarks.blind.outsiders import Outside, either_way, outside

Values: TypeAlias = Mapping[str, Any]

EXPONENT = outside("page_exponent", "contact", exponent=(1.2, 1.4))
_OFF = 0.03
MODES_OFF = Outside("page_modes", "structure", (Quantity("seed", ((0, 2**31 - 1),), "whole"),))
STRIBECK = outside("page_stribeck", "joints", more=(1.0, 4.0), fading_m_per_s=(0.02, 0.1))


def exponent_of(stiffness: float, old: float, new: float, depth: float) -> float:
    """The stiffness with which a contact of another exponent is as strong at `depth` (m) as it was."""
    return float(stiffness * depth ** (old - new))


def detuned(values: Values, count: int) -> tuple[float, ...]:
    """A factor for the frequency of each of `count` modes, within 3 % of one."""
    rng = np.random.default_rng(int(values["seed"]))
    return tuple(rng.uniform(1 - _OFF, 1 + _OFF, count).tolist())


def wrong_values(keys: Mapping[str, tuple[float, float, Any]]) -> tuple[Outside, ...]:
    """One value of [model] that is wrong by a factor; each key with the least and the most, off one."""
    return tuple(
        outside(f"wrong_{key}", "model", scale=either_way(least, most))
        for key, (least, most, _) in keys.items()
    )
