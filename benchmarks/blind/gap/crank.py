"""Features of the planar crank's revolutions."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.blind.gap.beam import whole_cycles
from benchmarks.blind.gap.cycles import Features, Samples, lag, levels, orders
from benchmarks.blind.gap.spatial import marked_turns

ACCELERATIONS = ("crank_frame.acceleration_y", "crank_frame.acceleration_x", "piston_frame.acceleration_y")
_LOWEST_HZ, _BANDS_AN_OCTAVE = 20.0, 3
_ORDERS = (1, 2, 3, 4, 5, 6)
_HIGH_V = 2.5
_ANGLE, _MARKER = "crank.angle", "crank.marker"
_MARKER_RAD, _ANGLE_RAD = 5e-4, 1e-4
"""Scatter added to angles, so that a difference below an encoder's count or a sample makes no gap."""


def crank_features(channels: Mapping[str, Samples], rate: float, _: float) -> list[dict[str, Features]]:
    """For each whole revolution, groups of features of what was recorded; the mark cuts if no angle does."""
    cuts = whole_cycles(channels[_ANGLE]) if _ANGLE in channels else marked_turns(channels[_MARKER])
    return [_turn(channels, cut, rate) for cut in cuts]


def _turn(channels: Mapping[str, Samples], cut: slice, rate: float) -> dict[str, Features]:
    uniform = 2 * np.pi * np.arange(cut.stop - cut.start) / (cut.stop - cut.start)
    angle = uniform
    if _ANGLE in channels:
        unwrapped = channels[_ANGLE][cut]
        angle = unwrapped - 2 * np.pi * np.floor(unwrapped[0] / (2 * np.pi))
    shaken = {name: channels[name][cut] for name in ACCELERATIONS if name in channels}
    found = {
        name: {
            **levels(values, rate, _LOWEST_HZ, _BANDS_AN_OCTAVE),
            **orders(values, angle, _ORDERS),
            "peak": float(angle[np.argmax(np.abs(values))]),
        }
        for name, values in shaken.items()
    }
    wobble = orders(angle - uniform, uniform, (1, 2, 3, 4)) if _ANGLE in channels else {}
    found["turn"] = {"speed": rate / len(angle), **_scattered(wobble, _ANGLE_RAD, cut.start)}
    if {_ANGLE, _MARKER} <= channels.keys():
        marker = _edges_of_mark(channels[_MARKER][cut], angle)
        found[_MARKER] = _scattered(marker, _MARKER_RAD, cut.start)
    found["timing"] = {
        f"{one} to {other}": lag(_edges(shaken[one]), _edges(shaken[other]), rate)
        for one, other in ((ACCELERATIONS[0], ACCELERATIONS[1]), (ACCELERATIONS[0], ACCELERATIONS[2]))
        if {one, other} <= shaken.keys()
    }
    return found


def _edges(values: Samples) -> Samples:
    """Where impacts begin, whichever way they push."""
    steep: Samples = np.diff(values) ** 2
    return steep


def _scattered(features: Features, deviation: float, seed: int) -> Features:
    rng = np.random.default_rng(seed)
    return {name: value + deviation * float(rng.standard_normal()) for name, value in features.items()}


def _edges_of_mark(volts: Samples, angle: Samples) -> Features:
    """Where it rises and falls, rad from the angle's zero; 0 where it does not."""
    from_zero = (angle + np.pi) % (2 * np.pi) - np.pi
    high = volts > _HIGH_V
    where = from_zero[high] if high.any() else np.zeros(1)
    return {"rise": float(where.min()), "fall": float(where.max())}
