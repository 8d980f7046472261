"""A recording of the impact beam as the blind check hands it out.

Usage: python -m benchmarks.blind.beam.record    (prints the speed)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.blind.beam import effects as catalogue
from benchmarks.blind.beam import outside
from benchmarks.blind.beam.channels import UNITS, chains, fine_channels
from benchmarks.blind.beam.engine import EVERY, STEP, simulate
from benchmarks.blind.beam.outside import MILD, PAGES, STRONG
from benchmarks.blind.beam.rig import Rig, jittered, nominal, set_up
from benchmarks.blind.recording import Recording
from benchmarks.blind.sensing import WIRING, plugged, sensed

__all__ = ["MILD", "PAGES", "STRONG", "record"]

_CHANGES = {**catalogue.CHANGES, **outside.CHANGES}
_CHANNEL_EFFECTS = {*catalogue.SENSOR_EFFECTS, *WIRING, *outside.FAULTS}
_AFTER = 0.01
"""s; the motion goes on for so long after the last sample: skews and filters reach beyond it."""


def record(
    scenario: Mapping[str, Any],
    effects: Sequence[Mapping[str, Any]],
    rig_seed: int,
    run_seed: int,
    built: Callable[[Rig], Rig] = lambda rig: rig,
    wider: float = 1.0,
) -> Recording:
    """Record one run on the rig `rig_seed`; all that it may differ by is drawn, and `effects` are in it.

    `scenario`: beam (steel, aluminium), clearance in m, frequency in Hz, amplitude in N, sample_rate in Hz,
    settle and duration in s. `effects`: name and parameters of each, as in an effects file, or drawn from
    `MILD`, `STRONG` or `PAGES`. `built` has the last word on the rig, whose tolerances are so many times
    `wider`, before the effects are in it. Raises ValueError for an effect that it does not know, for one of
    the pivot on the clamped beam, and for a sample rate that is no whole part of 204.8 kHz.
    """
    rig_rng, run_rng = np.random.default_rng([rig_seed, 0]), np.random.default_rng([rig_seed, 1, run_seed])
    rig = _with(set_up(built(jittered(nominal(scenario), rig_rng, wider)), run_rng), effects)
    instruments = chains(effects, rig_rng, wider)
    rate = float(scenario["sample_rate"])
    factor = round(1 / (EVERY * STEP * rate))
    if factor < 2 or abs(factor * rate * EVERY * STEP - 1) > 1e-9:
        raise ValueError(f"sample_rate {rate} Hz is not the {1 / (EVERY * STEP):g} Hz of the truth, divided")
    lead, count = round(scenario["settle"] * rate), round(scenario["duration"] * rate)
    truth = simulate(rig, (lead + count + round(_AFTER * rate)) * factor)
    channels = {
        name: sensed(fine, factor, rate, lead, count, instruments[name], run_rng)
        for name, fine in plugged(fine_channels(rig, truth), effects).items()
    }
    return Recording(rate, channels, dict(UNITS))


def _with(rig: Rig, effects: Sequence[Mapping[str, Any]]) -> Rig:
    for effect in effects:
        name = effect["name"]
        if name in _CHANGES:
            rig = _CHANGES[name](rig, effect["parameters"])
        elif name not in _CHANNEL_EFFECTS:
            raise ValueError(f"{name} is no effect of the impact beam")
    return rig


def main(seconds: float = 3.0) -> None:
    """Print simulated seconds for each second of the processor."""
    scenario = {
        "beam": "steel", "clearance": 0.127e-3, "frequency": 20.0, "amplitude": 9.0,
        "sample_rate": 51_200.0, "settle": 1.0, "duration": seconds,
    }  # fmt: skip
    slow = {"name": "pivot_friction", "parameters": {"torque_nm": 0.1}}
    for name, effects in (("nothing missing", []), ("pivot_friction", [slow])):
        begin = time.process_time()
        recording = record(scenario, effects, 1, 1)
        spent = time.process_time() - begin
        largest = recording.channels["contact.force_upper"].max()
        print(f"{name:16s} {(seconds + 1) / spent:5.2f} simulated s/s, largest upper force {largest:.1f} N")


if __name__ == "__main__":
    main()
