"""What no catalogue holds: how the rigs draw it, and what goes wrong in a channel's electronics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi
from typing import Any, TypeAlias

import numpy as np

from benchmarks.blind.catalogue import Cause, Interval, Quantity
from benchmarks.blind.sensing import Array, Chain, Fault

Values: TypeAlias = Mapping[str, Any]

SEEN = frozenset((
    "uneven_stops", "hardening_spring", "sticky_contact", "padded_stops", "tip_mass", "drive_modulation",
    "foreign_vibration", "warming_gap", "second_head_mode", "cross_talk", "mains_hum", "clipping", "dropouts",
    "loose_cable", "gain_drift", "rod_mass", "crank_length", "oval_bearing", "guide_offset", "air_spring",
    "piston_drag", "oil_film", "belt_ripple", "cross_axis", "loose_mount", "neighbour_machine",
))  # fmt: skip
"""Classes from whose draws the diagnosis's thresholds for "unknown" were set; all others are novel to it."""
LOOKED_FOR = frozenset(("drive_position", "slider_mass", "crank_radius"))
"""Classes that it knows since as values of [model] that may be wrong: no more novel than these."""


@dataclass(frozen=True, slots=True)
class Outside(Cause):
    """An effect that no catalogue holds; `also` are the places that are as right to name as its location."""

    also: tuple[str, ...] = ()

    @property
    def novel(self) -> bool:
        """Whether no threshold was set with its class, and it is looked for by nothing."""
        return self.name not in SEEN | LOOKED_FOR


def outside(
    name: str,
    location: str,
    channels: Sequence[str] = (),
    also: Sequence[str] = (),
    **ranges: Interval | tuple[Interval, ...],
) -> Outside:
    """An effect with the range of each parameter, or several ranges of which each is as likely; by ratio."""
    quantities = tuple(Quantity(key, _intervals(given)) for key, given in ranges.items())
    return Outside(name, location, quantities, tuple(channels), tuple(also))


def either_way(least: float, most: float) -> tuple[Interval, Interval]:
    """Factors that are off one by so much, downwards or upwards."""
    return (1 - most, 1 - least), (1 + least, 1 + most)


def of_channels(
    channels: Sequence[str], strong: bool, hum: Interval, loose: Interval | None
) -> tuple[Outside, ...]:
    """What goes wrong in any channel; `hum` and `loose` are amplitudes in the channels' unit."""

    def fault(name: str, mild: Mapping[str, Interval], bad: Mapping[str, Interval]) -> Outside:
        return outside(name, "sensor", channels, ("clock",), **(bad if strong else mild))

    found = (
        fault("mains_hum", {"amplitude": hum}, {"amplitude": hum}),
        fault("clipping", {"share_of_largest": (0.65, 0.85)}, {"share_of_largest": (0.25, 0.5)}),
        fault(
            "dropouts",
            {"per_s": (0.5, 1.5), "seconds": (0.003, 0.008)},
            {"per_s": (2.0, 8.0), "seconds": (0.01, 0.04)},
        ),
        fault("gain_drift", {"growth_per_s": (0.01, 0.03)}, {"growth_per_s": (0.05, 0.15)}),
        fault("soft_limit", {"share_of_largest": (1.0, 1.6)}, {"share_of_largest": (0.2, 0.5)}),
        fault(
            "wander",
            {"share_of_rms": (0.05, 0.15), "frequency_hz": (0.2, 2.0)},
            {"share_of_rms": (0.4, 1.5), "frequency_hz": (0.2, 2.0)},
        ),
        fault("lost_bits", {"share_of_largest": (0.01, 0.03)}, {"share_of_largest": (0.08, 0.25)}),
        fault(
            "wobbling_clock",
            {"seconds": (3e-5, 8e-5), "frequency_hz": (0.5, 5.0)},
            {"seconds": (3e-4, 1e-3), "frequency_hz": (0.5, 5.0)},
        ),
    )
    if loose is None:
        return found
    often = (3.0, 15.0) if strong else (0.5, 2.0)
    return (*found, outside("loose_cable", "sensor", channels, ("clock",), per_s=often, force_n=loose))


ANY_PHASE: Interval = (0.1, 2 * pi)


def _intervals(given: Interval | tuple[Interval, ...]) -> tuple[Interval, ...]:
    first, second = given[0], given[-1]
    if isinstance(first, float | int) and isinstance(second, float | int):
        return ((first, second),)
    return tuple(each for each in given if isinstance(each, tuple))


def _hum(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        p = 2 * np.pi * (50 * np.arange(len(x)) / rate + rng.uniform())
        return np.asarray(x + values["amplitude"] * (np.sin(p) + 0.3 * np.sin(3 * p)))

    return fault


def _clipping(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        limit = _of_largest(x, values)
        return np.minimum(np.maximum(x, -limit), limit)

    return fault


def _soft(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        limit = _of_largest(x, values)
        return np.asarray(limit * np.tanh(x / limit))

    return fault


def _coarse(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        step = _of_largest(x, values)
        return np.asarray(step * np.rint(x / step))

    return fault


def _of_largest(x: Array, values: Values) -> float:
    return float(values["share_of_largest"] * np.abs(x).max())


def _wander(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        p = 2 * np.pi * (values["frequency_hz"] * np.arange(len(x)) / rate + rng.uniform())
        return np.asarray(x + np.sqrt(2) * values["share_of_rms"] * x.std() * np.sin(p))

    return fault


def _wobble(values: Values) -> Fault:
    """The channel's own clock runs ahead and back."""

    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        samples = np.arange(len(x), dtype=float)
        p = 2 * np.pi * (values["frequency_hz"] * samples / rate + rng.uniform())
        return np.asarray(np.interp(samples + values["seconds"] * rate * np.sin(p), samples, x))

    return fault


def _dropouts(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        y = x.copy()
        for begin in _moments(len(x), rate, values["per_s"], rng):
            y[begin : begin + round(values["seconds"] * rate)] = 0.0
        return y

    return fault


def _loose(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        y = x.copy()
        decay = np.exp(-np.arange(round(0.005 * rate)) / (0.0005 * rate))
        for begin in _moments(len(x), rate, values["per_s"], rng):
            part = y[begin : begin + len(decay)]
            part += rng.choice((-1, 1)) * values["force_n"] * rng.uniform(0.5, 1.5) * decay[: len(part)]
        return y

    return fault


def _gain_drift(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        return np.asarray(x * (1 + values["growth_per_s"] * np.arange(len(x)) / rate))

    return fault


def _moments(count: int, rate: float, per_s: float, rng: np.random.Generator) -> list[int]:
    """Where the events of a Poisson process begin, as sample numbers."""
    return [int(i) for i in rng.integers(0, count, rng.poisson(per_s * count / rate))]


FAULTS: Mapping[str, Callable[[Values], Fault]] = {
    "mains_hum": _hum,
    "clipping": _clipping,
    "soft_limit": _soft,
    "lost_bits": _coarse,
    "wander": _wander,
    "wobbling_clock": _wobble,
    "dropouts": _dropouts,
    "loose_cable": _loose,
    "gain_drift": _gain_drift,
}


def faulted(chain: Chain, channel: str, effects: Sequence[Mapping[str, Any]]) -> Chain:
    """`chain` with those faults among `effects` that sit on `channel`."""
    found = tuple(
        FAULTS[effect["name"]](effect["parameters"])
        for effect in effects
        if effect["name"] in FAULTS and effect["parameters"]["channel"] == channel
    )
    return replace(chain, faults=found)
