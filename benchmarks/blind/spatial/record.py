"""One run of the spatial slider-crank as instruments would have recorded it.

Usage: python -m benchmarks.blind.spatial.record
prints the cost of some recordings, in seconds of the processor for each simulated one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import ceil, sqrt
from typing import Any, TypeAlias

import numpy as np

from benchmarks.blind.changes import Effects, changed, refuse_unknown
from benchmarks.blind.finite_elements import Array
from benchmarks.blind.outsiders import FAULTS, faulted
from benchmarks.blind.recording import Recording
from benchmarks.blind.sensing import WIRING, Chain, altered, healthy, plugged, sensed
from benchmarks.blind.spatial.effects import CATALOGUE, CHAIN_EFFECTS
from benchmarks.blind.spatial.mechanism import moved
from benchmarks.blind.spatial.outside import CROSS_TALK, MECHANICAL, MILD, PAGES, STRONG, crossed
from benchmarks.blind.spatial.rig import FORCES, MARKER, TACHOMETER, Spatial, set_anew, toleranced

__all__ = ["MILD", "PAGES", "STRONG", "record"]
Built: TypeAlias = Callable[[Spatial], Spatial]
UNITS = {**dict.fromkeys(FORCES, "N"), TACHOMETER: "rad/s", MARKER: "V"}
_FINE_HZ = 100e3
"""At least: no touch is shorter than three of its samples."""
_MARGIN = 0.02  # s, before sample 0 and after the last: filters and skews reach there
_FORCE_NOISE, _TACHOMETER_NOISE, _MARKER_NOISE = 0.05, 1e-3, 0.02  # N, of the speed, V
_FORCE_RANGE, _MARKER_RANGE = 500.0, 10.0
_GAIN = 0.005
_SWIFTEST = 0.5
"""Of a step times the fastest rate: first peaks within 0.1 %."""
_GUIDE_YIELDS, _FRICTION_RAMP, _PRESSED = 8.0, 9e-4, 100.0
"""What a point of the slider weighs is 1/8 kg; m/s over which friction sets in; N in an impact."""
_DEEPEST = 1e-5
"""m, of the ball in its socket."""
_RAMP_SHARE = 0.25
"""Friction sets in so much faster than it may to be followed as well."""


def record(
    scenario: Mapping[str, Any],
    effects: Effects,
    rig_seed: int,
    run_seed: int,
    built: Built = lambda rig: rig,
    wider: float = 1.0,
) -> Recording:
    """Return one run.

    `scenario`: speed in rad/s, axis_angle in rad, socket_clearance and guide_clearance in m, sample_rate in
    Hz, settle and duration in s. `effects` as in an effects file, of the catalogue, of MILD, STRONG or PAGES.
    `rig_seed` draws what belongs to the rig, both seeds together what is set anew for each run. `built` has
    the last word on the rig, whose tolerances are so many times `wider`, before the effects are in it. An
    effect that nobody knows: ValueError.
    """
    refuse_unknown(effects, (*CATALOGUE, *CHAIN_EFFECTS, *WIRING, *MECHANICAL, *FAULTS, CROSS_TALK))
    rng, run = np.random.default_rng([rig_seed, 3]), np.random.default_rng([rig_seed, run_seed, 4])
    rig = real_rig(scenario, effects, rng, run, built, wider)
    chains = _chains(effects, rng, float(scenario["speed"]), wider)
    rate = float(scenario["sample_rate"])
    factor = ceil(_FINE_HZ / rate)
    lead, count = round(_MARGIN * rate), round(scenario["duration"] * rate)
    first = max(round(scenario["settle"] * rate), lead) - lead
    fine = _fine(rig, effects, run.uniform(0, 2 * np.pi), factor * rate, (first + count + 2 * lead) * factor)
    channels = {
        name: sensed(fine[name][first * factor :], factor, rate, lead, count, chain, run)
        for name, chain in chains.items()
    }
    return Recording(rate, channels, {name: UNITS[name] for name in channels})


def real_rig(
    scenario: Mapping[str, Any],
    effects: Effects,
    rng: np.random.Generator,
    run: np.random.Generator,
    built: Built = lambda rig: rig,
    wider: float = 1.0,
) -> Spatial:
    """The scenario's rig with `effects`, as built (`rng`) and as set for this run (`run`)."""
    nominal = Spatial(
        speed=scenario["speed"],
        axis_angle=scenario["axis_angle"],
        socket_clearance=scenario["socket_clearance"],
        guide_clearance=scenario["guide_clearance"],
    )
    real = built(toleranced(nominal, rng, wider))
    return set_anew(changed(real, effects, {**CATALOGUE, **MECHANICAL}), run)


def steps(rig: Spatial, rate: float) -> int:
    """Steps for each sample at `rate` Hz, by the fastest that happens in a contact."""
    # the ball moves as if it were the rod's third, and each bending mode yields four times as much
    ball = (3 + 4 * (len(rig.rod.damping) // 2)) / rig.rod.mass
    power = rig.socket.exponent
    stiffest = power * rig.socket.stiffness * _DEEPEST ** (power - 1)
    friction = rig.friction.coefficient * (1 + rig.friction.more)
    fastest = max(
        sqrt(stiffest * ball),
        rig.socket.damping * ball,
        _RAMP_SHARE * friction * _PRESSED / _FRICTION_RAMP * _GUIDE_YIELDS,
    )
    return max(1, ceil(fastest / (_SWIFTEST * rate)))


def _fine(rig: Spatial, effects: Effects, angle: float, rate: float, count: int) -> dict[str, Array]:
    """The signal of every channel at `rate` Hz, as it is plugged in."""
    each = steps(rig, rate)
    motion = moved(rig, angle, 1 / (each * rate), count, each)
    fine = dict(zip(FORCES, motion.forces, strict=True))
    for effect in effects:
        if effect["name"] == CROSS_TALK:
            fine = crossed(fine, effect["parameters"]["share"])
    ripple = rig.ripple
    swing = ripple.amplitude * np.sin(ripple.order * motion.angle + ripple.phase)
    fine[TACHOMETER] = rig.speed * (1 + swing)
    fine[MARKER] = np.where(np.mod(motion.angle, 2 * np.pi) < np.radians(5.0), 5.0, 0.0)
    return plugged(fine, effects)


def _chains(effects: Effects, rng: np.random.Generator, speed: float, wider: float) -> dict[str, Chain]:
    kinds = {
        **dict.fromkeys(FORCES, (_FORCE_NOISE, _FORCE_RANGE)),
        TACHOMETER: (_TACHOMETER_NOISE * speed, _FORCE_RANGE),
        MARKER: (_MARKER_NOISE, _MARKER_RANGE),
    }
    return {
        name: faulted(altered(healthy(rng, *kind, wider * _GAIN), name, effects), name, effects)
        for name, kind in kinds.items()
    }


COST_CASES: dict[str, Effects] = {
    "nothing missing": [],
    "contact_stiffness": [{"name": "contact_stiffness", "parameters": {"scale": 5.0}}],
    "contact_damping": [{"name": "contact_damping", "parameters": {"scale": 20.0}}],
    "guide_friction": [{"name": "guide_friction", "parameters": {"coefficient": 0.3}}],
}


def main() -> None:
    """Print the costs."""
    scenario = {
        "speed": 230 * np.pi / 30, "axis_angle": np.pi / 2, "socket_clearance": 0.25e-3,
        "guide_clearance": 0.25e-3, "sample_rate": 25_600.0, "settle": 0.2, "duration": 1.0,
    }  # fmt: skip
    record({**scenario, "duration": 0.05}, [], 1, 1)
    for name, effects in COST_CASES.items():
        begin = time.process_time()
        record(scenario, effects, 1, 1)
        print(f"{name:18} {(time.process_time() - begin) / 1.22:5.2f} s for a second", flush=True)


if __name__ == "__main__":
    main()
