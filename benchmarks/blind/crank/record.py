"""One run of the planar slider-crank as instruments would have recorded it.

Usage: python -m benchmarks.blind.crank.record
prints the speed of some recordings, in simulated seconds for each of the processor's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from benchmarks.blind.changes import Effects, changed, refuse_unknown
from benchmarks.blind.crank.effects import CATALOGUE, CHAIN_EFFECTS
from benchmarks.blind.crank.frame import accelerations
from benchmarks.blind.crank.mechanism import moved
from benchmarks.blind.crank.outside import ACCELERATIONS, FAULTS, MECHANICAL, MILD, ON_THE_WAY, PAGES, STRONG
from benchmarks.blind.crank.parts import Array
from benchmarks.blind.crank.rig import Crank, set_anew, toleranced
from benchmarks.blind.outsiders import faulted
from benchmarks.blind.recording import Recording
from benchmarks.blind.sensing import WIRING, Chain, altered, healthy, plugged, sensed

__all__ = ["MILD", "PAGES", "STRONG", "record"]
Built: TypeAlias = Callable[[Crank], Crank]
ANGLE, MARKER = "crank.angle", "crank.marker"
UNITS = {**dict.fromkeys(ACCELERATIONS, "m/s2"), ANGLE: "rad", MARKER: "V"}
_STEP = 6.6e-6
"""s, of the nominal rig: first peaks are 0.3 % low; twice as long would make the frame 1 dB louder."""
_STIFFNESS = 5.03e10  # N/m^1.5, of the nominal rig
_MARGIN = 0.02  # s, before sample 0 and after the last: filters and skews reach there
_COUNTS = 4096
_GAIN = 0.005
_NOISE, _RANGE = 0.05, 2000.0  # m/s2
_MARKER_NOISE, _MARKER_RANGE = 0.02, 10.0  # V


def record(
    scenario: Mapping[str, Any],
    effects: Effects,
    rig_seed: int,
    run_seed: int,
    built: Built = lambda crank: crank,
    wider: float = 1.0,
) -> Recording:
    """Return one run.

    `scenario`: speed in rad/s, clearance_1 and clearance_2 in m, sample_rate in Hz, settle and duration in s.
    `effects` as in an effects file, of the catalogue, of MILD, STRONG or PAGES. `rig_seed` draws what belongs
    to the rig, both seeds together what is set anew for each run. `built` has the last word on the rig, whose
    tolerances are so many times `wider`, before the effects are in it. An effect that nobody knows:
    ValueError.
    """
    refuse_unknown(effects, (*CATALOGUE, *CHAIN_EFFECTS, *WIRING, *MECHANICAL, *ON_THE_WAY, *FAULTS))
    rig, run = np.random.default_rng([rig_seed, 1]), np.random.default_rng([rig_seed, run_seed, 2])
    crank = real_rig(scenario, effects, rig, run, built, wider)
    chains = _chains(effects, rig, wider)
    rate = float(scenario["sample_rate"])
    factor = oversampling(crank, rate)
    lead, count = round(_MARGIN * rate), round(scenario["duration"] * rate)
    first = max(round(scenario["settle"] * rate), lead) - lead
    steps = (first + count + 2 * lead) * factor
    motion = moved(crank, run.uniform(0, 2 * np.pi), 1 / (factor * rate), steps)
    fine: dict[str, Array] = accelerations(crank, motion, 1 / (factor * rate))
    for effect in effects:
        if effect["name"] in ON_THE_WAY:
            fine = ON_THE_WAY[effect["name"]](fine, factor * rate, effect["parameters"], run)
    fine = plugged(fine, effects)
    fine[MARKER] = np.where(np.mod(motion.angle, 2 * np.pi) < np.radians(5.0), 5.0, 0.0)
    channels = {
        name: sensed(fine[name][first * factor :], factor, rate, lead, count, chain, run)
        for name, chain in chains.items()
    }
    channels[ANGLE] = encoded(motion.angle[(first + lead) * factor :: factor][:count])
    return Recording(rate, channels, {name: UNITS[name] for name in channels})


def real_rig(
    scenario: Mapping[str, Any],
    effects: Effects,
    rig: np.random.Generator,
    run: np.random.Generator,
    built: Built = lambda crank: crank,
    wider: float = 1.0,
) -> Crank:
    """The scenario's rig with `effects`, as built (`rig`) and as set for this run (`run`)."""
    crank = Crank(scenario["speed"], (scenario["clearance_1"], scenario["clearance_2"]))
    real = built(toleranced(crank, rig, wider))
    return set_anew(changed(real, effects, {**CATALOGUE, **MECHANICAL}), run)


def oversampling(crank: Crank, sample_rate: float) -> int:
    """Steps for each sample: a contact lasts as its stiffness to the power -0.4; friction chatters."""
    finer = (max(*crank.contact_stiffnesses, _STIFFNESS) / _STIFFNESS) ** 0.4 * (1 + 2 * crank.friction)
    return max(1, round(float(finer) / (_STEP * sample_rate)))


def encoded(angle: Array) -> Array:
    """Whole counts, in rad, below one revolution at the first sample."""
    count = 2 * np.pi / _COUNTS
    whole = np.floor(angle / count)
    return np.asarray((whole - _COUNTS * np.floor(whole[0] / _COUNTS)) * count)


def _chains(effects: Effects, rng: np.random.Generator, wider: float) -> dict[str, Chain]:
    chains = {name: healthy(rng, _NOISE, _RANGE, wider * _GAIN) for name in ACCELERATIONS}
    chains[MARKER] = healthy(rng, _MARKER_NOISE, _MARKER_RANGE, wider * _GAIN)
    return {name: faulted(altered(chain, name, effects), name, effects) for name, chain in chains.items()}


SPEED_CASES: dict[str, Effects] = {
    "nothing missing": [],
    "contact_stiffness": [{"name": "contact_stiffness", "parameters": {"scale": 5.0}}],
    "joint_friction": [{"name": "joint_friction", "parameters": {"coefficient": 0.3}}],
    "guide_friction": [{"name": "guide_friction", "parameters": {"coefficient": 0.3}}],
    "speed_fluctuation": [
        {"name": "speed_fluctuation", "parameters": {"amplitude": 0.05, "order": 3, "phase_rad": 0.4}}
    ],
    "rod_flexibility": [
        {"name": "rod_flexibility", "parameters": {"frequency_hz": 150.0, "damping_ratio": 0.02}}
    ],
}


def main() -> None:
    """Print the speeds."""
    scenario = {
        "speed": 200 * np.pi / 30, "clearance_1": 1e-3, "clearance_2": 1e-3,
        "sample_rate": 25_600.0, "settle": 1.0, "duration": 4.0,
    }  # fmt: skip
    for name, effects in SPEED_CASES.items():
        begin = time.process_time()
        record(scenario, effects, 1, 1)
        print(f"{name:18} {5.0 / (time.process_time() - begin):5.2f} sim-s/s", flush=True)


if __name__ == "__main__":
    main()
