"""What no catalogue holds, as two of the rigs draw it, and what goes wrong in a channel's electronics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from benchmarks.blind.sensing import Array, Chain, Fault

Values: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Outside:
    """An effect, the range of each parameter, the channels that it may sit on (none: it is in the rig)."""

    name: str
    ranges: Mapping[str, tuple[float, float]]
    channels: tuple[str, ...] = ()

    def draw(self, rng: np.random.Generator) -> dict[str, Any]:
        """Return {"name", "parameters"}: log-uniform over the range."""
        values: dict[str, Any] = {
            name: float(np.exp(rng.uniform(np.log(low), np.log(high))))
            for name, (low, high) in self.ranges.items()
        }
        if self.channels:
            values["channel"] = str(rng.choice(self.channels))
        return {"name": self.name, "parameters": values}


def _hum(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        p = 2 * np.pi * (50 * np.arange(len(x)) / rate + rng.uniform())
        return np.asarray(x + values["amplitude"] * (np.sin(p) + 0.3 * np.sin(3 * p)))

    return fault


def _clipping(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        return np.minimum(np.maximum(x, -_limit(x)), _limit(x))

    def _limit(x: Array) -> float:
        return float(values["share_of_largest"] * np.abs(x).max())

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
