"""What may be wrong that the catalogue does not hold: in the mechanism, on the way, in a channel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from scipy import signal

from benchmarks.blind.changes import Values
from benchmarks.blind.crank.effects import Change
from benchmarks.blind.crank.parts import Array
from benchmarks.blind.crank.rig import CRANK_X, CRANK_Y, PISTON_Y, Crank, Ripple
from benchmarks.blind.sensing import Fault

ACCELERATIONS = (CRANK_Y, CRANK_X, PISTON_Y)
_TOWARDS = {CRANK_Y: CRANK_X, CRANK_X: CRANK_Y, PISTON_Y: CRANK_X}
Draw: TypeAlias = Callable[[np.random.Generator], dict[str, Any]]
OnTheWay: TypeAlias = Callable[[dict[str, Array], float, Values, np.random.Generator], dict[str, Array]]


@dataclass(frozen=True, slots=True)
class Outside:
    """An effect outside the catalogue."""

    name: str
    parameters: Draw

    def draw(self, rng: np.random.Generator) -> dict[str, Any]:
        """One case of it, as an effects file would have it."""
        return {"name": self.name, "parameters": self.parameters(rng)}


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _off_one(rng: np.random.Generator, least: float, most: float) -> float:
    return float(1 + rng.choice((-1, 1)) * rng.uniform(least, most))


def _channel(rng: np.random.Generator) -> str:
    return str(rng.choice(ACCELERATIONS))


OUTSIDE = (
    Outside("rod_mass", lambda rng: {"scale": _off_one(rng, 0.35, 0.6)}),
    Outside("crank_length", lambda rng: {"scale": _off_one(rng, 0.15, 0.3)}),
    Outside(
        "oval_bearing",
        lambda rng: {"joint": int(rng.integers(1, 3)), "fraction": float(rng.uniform(0.4, 0.8))},
    ),
    Outside("guide_offset", lambda rng: {"offset_m": float(rng.choice((-1, 1)) * rng.uniform(0.12, 0.22))}),
    Outside("air_spring", lambda rng: {"stiffness_n_per_m": _between(rng, 1e3, 8e3)}),
    Outside("piston_drag", lambda rng: {"damping_ns_per_m": _between(rng, 30.0, 200.0)}),
    Outside("oil_film", lambda rng: {"damping_ns_per_m": _between(rng, 100.0, 1000.0)}),
    Outside(
        "belt_ripple",
        lambda rng: {
            "amplitude": float(rng.uniform(0.03, 0.06)),
            "order": float(rng.uniform(6.2, 11.8)),
            "phase_rad": float(rng.uniform(0, 2 * np.pi)),
        },
    ),
    Outside(
        "cross_axis",
        lambda rng: {
            "channel": str(rng.choice((CRANK_Y, PISTON_Y))),
            "fraction": float(rng.uniform(0.3, 0.7)),
        },
    ),
    Outside(
        "loose_mount",
        lambda rng: {
            "channel": _channel(rng),
            "frequency_hz": _between(rng, 900.0, 5000.0),
            "damping_ratio": float(rng.uniform(0.02, 0.08)),
        },
    ),
    Outside(
        "neighbour_machine",
        lambda rng: {
            "frequency_hz": _between(rng, 40.0, 700.0),
            "amplitude_m_per_s2": _between(rng, 8.0, 30.0),
        },
    ),
    Outside(
        "mains_hum", lambda rng: {"channel": _channel(rng), "amplitude_m_per_s2": _between(rng, 4.0, 20.0)}
    ),
    Outside("clipping", lambda rng: {"channel": _channel(rng), "limit_m_per_s2": _between(rng, 8.0, 30.0)}),
    Outside(
        "dropouts",
        lambda rng: {
            "channel": _channel(rng),
            "per_second": float(rng.uniform(1.0, 6.0)),
            "seconds": _between(rng, 0.01, 0.05),
        },
    ),
)


def _oval(crank: Crank, values: Values) -> Crank:
    moved = [0.0, 0.0]
    moved[values["joint"] - 1] = values["fraction"] * crank.clearances[values["joint"] - 1]
    return replace(crank, ovality=(moved[0], moved[1]))


MECHANICAL: dict[str, Change] = {
    "rod_mass": lambda crank, v: replace(crank, rod_mass=crank.rod_mass * v["scale"]),
    "crank_length": lambda crank, v: replace(crank, crank_length=crank.crank_length * v["scale"]),
    "oval_bearing": _oval,
    "guide_offset": lambda crank, v: replace(crank, guide_offset=v["offset_m"]),
    "air_spring": lambda crank, v: replace(crank, air_spring=v["stiffness_n_per_m"]),
    "piston_drag": lambda crank, v: replace(crank, drag=v["damping_ns_per_m"]),
    "oil_film": lambda crank, v: replace(crank, film=v["damping_ns_per_m"]),
    "belt_ripple": lambda crank, v: replace(crank, ripple=Ripple(v["amplitude"], v["order"], v["phase_rad"])),
}


def _cross_axis(
    fine: dict[str, Array], rate: float, values: Values, rng: np.random.Generator
) -> dict[str, Array]:
    channel, sine = values["channel"], values["fraction"]
    mixed = np.sqrt(1 - sine**2) * fine[channel] + sine * fine[_TOWARDS[channel]]
    return {**fine, channel: mixed}


def _loose_mount(
    fine: dict[str, Array], rate: float, values: Values, rng: np.random.Generator
) -> dict[str, Array]:
    channel, omega = values["channel"], 2 * np.pi * values["frequency_hz"]
    b, a = signal.bilinear([omega**2], [1.0, 2 * values["damping_ratio"] * omega, omega**2], fs=rate)
    return {**fine, channel: np.asarray(signal.lfilter(b, a, fine[channel]))}


def _neighbour(
    fine: dict[str, Array], rate: float, values: Values, rng: np.random.Generator
) -> dict[str, Array]:
    """A machine next door: one tone of any phase, not the same at every accelerometer."""
    turned = 2 * np.pi * values["frequency_hz"] / rate
    shaken = dict(fine)
    for channel in ACCELERATIONS:
        share, phase = rng.uniform(0.3, 1.0), rng.uniform(0, 2 * np.pi)
        tone = np.sin(turned * np.arange(len(fine[channel])) + phase)
        shaken[channel] = fine[channel] + share * values["amplitude_m_per_s2"] * tone
    return shaken


ON_THE_WAY: dict[str, OnTheWay] = {
    "cross_axis": _cross_axis,
    "loose_mount": _loose_mount,
    "neighbour_machine": _neighbour,
}


def _hum(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        mains = 2 * np.pi * 50.0 * np.arange(len(x)) / rate + rng.uniform(0, 2 * np.pi)
        return np.asarray(x + values["amplitude_m_per_s2"] * (np.sin(mains) + 0.3 * np.sin(3 * mains)))

    return fault


def _clip(values: Values) -> Fault:
    limit = values["limit_m_per_s2"]
    return lambda x, rate, rng: np.asarray(np.clip(x, -limit, limit))


def _drop(values: Values) -> Fault:
    def fault(x: Array, rate: float, rng: np.random.Generator) -> Array:
        kept, length = x.copy(), round(values["seconds"] * rate)
        for start in rng.integers(0, len(x), rng.poisson(values["per_second"] * len(x) / rate)):
            kept[start : start + length] = 0.0
        return np.asarray(kept)

    return fault


FAULTS: dict[str, Callable[[Values], Fault]] = {"mains_hum": _hum, "clipping": _clip, "dropouts": _drop}
