"""Features of the impact beam's cycles; a cycle begins at the rising zero of the drive."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from benchmarks.blind.gap.cycles import Features, Samples, contacts, lag, levels, orders

_CONTACTS, _YOKE = ("contact.force_upper", "contact.force_lower"), "yoke.force"
_FORCES = (*_CONTACTS, _YOKE)
_LOWEST_HZ = 100.0
_TOUCHING_N = 1.0
"""Twenty times the noise."""
_BASE = "base.acceleration"
_MOST_CROSSTALK = 1e-3
"""m/s2 for each N of contact force: what a healthy rigid base may show, and the twin does not."""


def beam_features(
    channels: Mapping[str, Samples], rate: float, frequency: float
) -> list[dict[str, Features]]:
    """For each whole cycle, groups of features of what was recorded; `frequency` is the nominal one, Hz.

    The base tells nothing where a contact's force, whose cross talk it has, was not recorded.
    """
    phase = drive_phase(channels["drive.force"], rate, frequency)
    if _BASE in channels:
        rest = {name: values for name, values in channels.items() if name != _BASE}
        both = {*_CONTACTS} <= channels.keys()
        channels = {**rest, _BASE: without_crosstalk(channels)} if both else rest
    return [_cycle(channels, cut, phase[cut], rate) for cut in whole_cycles(phase)]


def without_crosstalk(channels: Mapping[str, Samples]) -> Samples:
    """The base's acceleration less the part that follows the contact force, as far as that is healthy."""
    contact = channels["contact.force_upper"] - channels["contact.force_lower"]
    power = float(contact @ contact)
    share = float(channels[_BASE] @ contact) / power if power > 0 else 0.0
    rest: Samples = channels[_BASE] - np.clip(share, -_MOST_CROSSTALK, _MOST_CROSSTALK) * contact
    return rest


def drive_phase(force: Samples, rate: float, frequency: float) -> Samples:
    """Phase of the drive's fundamental at each sample, rad; its frequency from the phases of the halves."""
    times = np.arange(len(force)) / rate
    turned = force * np.exp(-2j * np.pi * frequency * times)
    half = max(1, int(len(force) / 2 / rate * frequency)) * round(rate / frequency)
    first, second = turned[:half].mean(), turned[-half:].mean()
    between = (len(force) - half) / rate
    drift = np.angle(second / first) / between
    start = np.angle(np.mean(turned * np.exp(-1j * drift * times)))
    phase: Samples = (2 * np.pi * frequency + drift) * times + start + np.pi / 2
    return phase


def whole_cycles(phase: Samples) -> Iterator[slice]:
    """Where each complete turn of a rising phase lies."""
    turns = np.floor(phase / (2 * np.pi))
    starts = np.flatnonzero(np.diff(turns) > 0) + 1
    for begin, end in pairwise(starts):
        yield slice(int(begin), int(end))


def _cycle(channels: Mapping[str, Samples], cut: slice, phase: Samples, rate: float) -> dict[str, Features]:
    found = {
        name: {**levels(values[cut], rate, _LOWEST_HZ), **orders(values[cut], phase, (1, 2, 3))}
        for name, values in channels.items()
    }
    forces = {name: channels[name][cut] for name in _FORCES if name in channels}
    for name, force in forces.items():
        found[name] |= contacts(force, _TOUCHING_N)
    found["timing"] = {
        f"{name} to yoke": lag(forces[name], sign * forces[_YOKE], rate)
        for name, sign in zip(_CONTACTS, (1, -1), strict=True)
        if {name, _YOKE} <= forces.keys()
    }
    return found
