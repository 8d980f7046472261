"""Eight healthy cranks side by side against the same one by one, as many runs of one are compared.

In simulated s per s of the processor, both with all channels at the rate at which motions are compared,
turn about. Returns 1 if the median of the ratios misses its bar.

Usage: python -m benchmarks.side_by_side [repetitions]
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from rig.rigs import RIGS
from sim_twin.ensembles.clean_samples import OneByOne
from sim_twin.rigs.crank_drive import SpeedDrive
from sim_twin.rigs.rig_model import Truths
from sim_twin.twin import Twin

TOGETHER, STEPS = 8, 4096
RPM = np.pi / 30
OF: Final = {"planar_slider_crank": (200.0, 12, 2.0), "spatial_slider_crank": (230.0, 4, 3.5)}
"""Revolutions a minute, parts of `STEPS`, least ratio."""


def speed(begin: Callable[[], Truths], parts: int, rate: float) -> float:
    """Simulated s per s of the processor, without the start."""
    truths = begin()
    truths.advance(STEPS)
    begun = time.process_time()
    for _ in range(parts):
        truths.advance(STEPS)
    return TOGETHER * parts * STEPS / rate / (time.process_time() - begun)


def main(repetitions: int) -> int:
    """Print the speeds of each rig and the median of the ratios."""
    met = True
    for name, (rpm, parts, bar) in OF.items():
        rig = RIGS[name].nominal()
        nominal, rng = Twin(rig, SpeedDrive(rpm * RPM)), np.random.default_rng(1)
        model, rate = rig.model, rig.model.fine_rate
        twins = [model.draw_healthy(nominal, rng, rng) for _ in range(TOGETHER)]
        phases = rng.uniform(0.0, 2 * np.pi, TOGETHER).tolist()

        def alone() -> Truths:
            truths = [model.truth(twin, rate, False) for twin in twins]  # noqa: B023 - called here alone
            for truth, twin, phase in zip(truths, twins, phases, strict=True):  # noqa: B023
                truth.change_drive(twin.drive, phase, 0.0)
            return OneByOne(truths)

        def together() -> Truths:
            found: Truths = model.side_by_side.truths(twins, phases, rate)  # noqa: B023
            return found

        for begin in (alone, together):
            begin().advance(64)  # compiled
        found = [[speed(begin, parts, rate) for begin in (together, alone)] for _ in range(repetitions)]
        ours, theirs = (statistics.median(each) for each in zip(*found, strict=True))
        ratios = [one / other for one, other in found]
        ratio = statistics.median(ratios)
        met &= ratio >= bar
        print(
            f"{name}: side by side {ours:.1f}, one by one {theirs:.1f} simulated s a s; ratio {ratio:.2f} "
            f"({min(ratios):.2f} to {max(ratios):.2f}; bar {bar:g})",
            flush=True,
        )
    return int(not met)


if __name__ == "__main__":
    with threadpool_limits(1, user_api="blas"):
        raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 5))
