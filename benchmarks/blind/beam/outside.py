"""Effects that the catalogue does not hold: in the rig, and in a channel's electronics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.blind.beam.effects import Change, Values, both
from benchmarks.blind.beam.rig import Rig, Tone
from benchmarks.blind.sensing import Array, Fault

FORCES = ("contact.force_upper", "contact.force_lower", "yoke.force")


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


OUTSIDE = (
    Outside("uneven_stops", {"lower_stiffness_scale": (0.02, 0.1), "lower_gap_scale": (1.3, 1.8)}),
    Outside("hardening_spring", {"force_at_stop_n": (1.5, 5.0)}),
    Outside("sticky_contact", {"pull_n": (1.5, 6.0)}),
    Outside("padded_stops", {"share": (0.01, 0.05), "depth_m": (5e-6, 25e-6)}),
    Outside("tip_mass", {"mass_kg": (0.02, 0.1)}),
    Outside("drive_modulation", {"depth": (0.25, 0.6), "frequency_hz": (0.6, 2.5)}),
    Outside("foreign_vibration", {"force_n": (1.5, 5.0), "frequency_hz": (47.0, 170.0)}),
    Outside("warming_gap", {"growth_per_s": (0.07, 0.2)}),
    Outside("second_head_mode", {"frequency_hz": (180.0, 500.0), "share": (0.4, 0.8)}),
    Outside("cross_talk", {"share": (0.1, 0.4)}),
    Outside("mains_hum", {"amplitude": (1.0, 4.0)}, FORCES),
    Outside("clipping", {"share_of_largest": (0.25, 0.6)}, FORCES),
    Outside("dropouts", {"per_s": (2.0, 8.0), "seconds": (0.01, 0.04)}, FORCES),
    Outside("loose_cable", {"per_s": (3.0, 15.0), "force_n": (10.0, 60.0)}, FORCES),
    Outside("gain_drift", {"growth_per_s": (0.05, 0.15)}, FORCES),
)


def _uneven(rig: Rig, values: Values) -> Rig:
    stop = rig.lower
    gap, stiffness = stop.gap * values["lower_gap_scale"], stop.stiffness * values["lower_stiffness_scale"]
    return replace(rig, lower=replace(stop, gap=gap, stiffness=stiffness))


def _hardening(rig: Rig, values: Values) -> Rig:
    return replace(rig, cubic=values["force_at_stop_n"] / rig.upper.gap**3)


def _sticky(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, pull=values["pull_n"]))


def _padded(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, pad=(values["share"], values["depth_m"])))


def _tip_mass(rig: Rig, values: Values) -> Rig:
    return replace(rig, beam=replace(rig.beam, tip_mass=values["mass_kg"]))


def _modulation(rig: Rig, values: Values) -> Rig:
    """A (1 + depth sin q) sin p, as three tones."""
    half, f = values["depth"] / 2, values["frequency_hz"]
    sides = (
        Tone(sign * half * tone.amplitude, tone.frequency + side * f, tone.phase + np.pi / 2)
        for tone in rig.tones
        for sign, side in ((1, -1), (-1, 1))
    )
    return replace(rig, tones=(*rig.tones, *sides))


def _vibration(rig: Rig, values: Values) -> Rig:
    """A force beside the coil's: it shakes the beam and is not in `drive.force`."""
    return replace(rig, foreign=(Tone(values["force_n"], values["frequency_hz"], 1.0),))


def _warming(rig: Rig, values: Values) -> Rig:
    return both(rig, lambda stop: replace(stop, drift=values["growth_per_s"]))


def _head(rig: Rig, values: Values) -> Rig:
    return replace(rig, second_head=(values["frequency_hz"], values["share"]))


def _cross_talk(rig: Rig, values: Values) -> Rig:
    return replace(rig, cross_talk=values["share"])


CHANGES: Mapping[str, Change] = {
    "uneven_stops": _uneven,
    "hardening_spring": _hardening,
    "sticky_contact": _sticky,
    "padded_stops": _padded,
    "tip_mass": _tip_mass,
    "drive_modulation": _modulation,
    "foreign_vibration": _vibration,
    "warming_gap": _warming,
    "second_head_mode": _head,
    "cross_talk": _cross_talk,
}


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
