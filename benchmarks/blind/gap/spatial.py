"""Features of the spatial crank's revolutions, which the flywheel's mark cuts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from benchmarks.blind.gap.cycles import Features, Samples, contacts, lag, levels, orders

FORCES = (*(f"slider.force_{point}" for point in range(1, 9)), "socket.force")
_MARKER, _TACHOMETER = "flywheel.marker", "motor.tachometer"
_HIGH_V = 2.5
_LOWEST_HZ = 50.0
_TOUCHING_N = 1.0
"""Twenty times the noise."""
_ORDERS = (1, 2, 3, 4)
_PAIRS = (
    ("socket.force", "slider.force_3"),
    ("socket.force", "slider.force_7"),
    ("slider.force_3", "slider.force_7"),
    ("slider.force_1", "slider.force_5"),
)
"""Of which the second is struck with the first, or soon after."""


def spatial_features(channels: Mapping[str, Samples], rate: float, _: float) -> list[dict[str, Features]]:
    """For each whole revolution, groups of features of what was recorded."""
    return [_turn(channels, cut, rate) for cut in marked_turns(channels[_MARKER])]


def marked_turns(volts: Samples) -> Iterator[slice]:
    """From one rise of the mark to the next."""
    high = volts > _HIGH_V
    for begin, end in pairwise(np.flatnonzero(high[1:] & ~high[:-1]) + 1):
        yield slice(int(begin), int(end))


def _turn(channels: Mapping[str, Samples], cut: slice, rate: float) -> dict[str, Features]:
    length = cut.stop - cut.start
    phase = 2 * np.pi * np.arange(length) / length
    found = {
        name: {
            **levels(channels[name][cut], rate, _LOWEST_HZ),
            **orders(channels[name][cut], phase, _ORDERS),
            **contacts(channels[name][cut], _TOUCHING_N),
            "mean": float(channels[name][cut].mean()),
        }
        for name in FORCES
        if name in channels
    }
    if _TACHOMETER in channels:
        speed = channels[_TACHOMETER][cut]
        found[_TACHOMETER] = {"mean": float(speed.mean()), **orders(speed, phase, _ORDERS)}
    high = channels[_MARKER][cut] > _HIGH_V
    # a sample more or less is no gap
    edge = float(np.random.default_rng(cut.start).uniform(-1, 1))
    found[_MARKER] = {"high": (float(high.sum()) + edge) / length, "speed": rate / (length + edge)}
    found["timing"] = {
        f"{one} to {other}": lag(_edges(channels[one][cut]), _edges(channels[other][cut]), rate)
        for one, other in _PAIRS
        if {one, other} <= channels.keys()
    }
    return found


def _edges(force: Samples) -> Samples:
    """Where impacts begin."""
    steep: Samples = np.diff(force) ** 2
    return steep
