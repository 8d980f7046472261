"""From the truth of the motion to what the instruments show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import signal

from benchmarks.blind.beam.engine import Truth
from benchmarks.blind.beam.rig import Rig
from benchmarks.blind.beam.structure import Array
from benchmarks.blind.outsiders import faulted
from benchmarks.blind.sensing import Chain, altered, healthy

UNITS = {
    "drive.force": "N",
    "contact.force_upper": "N",
    "contact.force_lower": "N",
    "yoke.force": "N",
    "base.acceleration": "m/s2",
}
_NOISE = {"drive.force": 0.02, "base.acceleration": 0.03}
_FORCE_NOISE = 0.05
_FULL_SCALE = 2000.0
_HEAD_DAMPING = 0.03


def chains(
    effects: Sequence[Mapping[str, Any]], rng: np.random.Generator, wider: float = 1.0
) -> dict[str, Chain]:
    """The rig's measuring chains with what is wrong with them, tolerances so many times `wider`."""
    found = {}
    for name in UNITS:
        spread = 0.01 if name == "yoke.force" else 0.005
        chain = healthy(rng, _NOISE.get(name, _FORCE_NOISE), _FULL_SCALE, wider * spread)
        found[name] = faulted(altered(chain, name, effects), name, effects)
    return found


def fine_channels(rig: Rig, truth: Truth) -> dict[str, Array]:
    """Every channel's true signal at the truth's rate."""
    net = truth.upper - truth.lower
    acceleration = truth.yoke_acceleration
    return {
        "drive.force": rig.force(np.arange(len(net)) / truth.rate),
        "contact.force_upper": truth.upper + rig.cross_talk * truth.lower,
        "contact.force_lower": truth.lower + rig.cross_talk * truth.upper,
        "yoke.force": _head(rig, net, truth.rate),
        "base.acceleration": rig.leak * net if acceleration is None else acceleration,
    }


def _head(rig: Rig, force: Array, rate: float) -> Array:
    """The impedance head: one mode, or a second one that takes a share of the force."""
    shown = _mode(force, rig.head, rate)
    if rig.second_head is None:
        return shown
    frequency, share = rig.second_head
    return (1 - share) * shown + share * _mode(force, frequency, rate)


def _mode(x: Array, frequency: float, rate: float) -> Array:
    omega = 2 * np.pi * frequency
    b, a = signal.bilinear([omega**2], [1, 2 * _HEAD_DAMPING * omega, omega**2], rate)
    return np.asarray(signal.lfilter(b, a, x))
