"""Clock models of 200 seeded runs for each shape of jitter: how often the stated 95 % hold the truth.

A device's clock is off by 5 to 50 ppm, arrivals at 10 a second for 10 minutes carry 1 ms of jitter and one
in a hundred a spike of 20 ms. Second kind: the clock (or the host's) also steps once, by 5 ms to an hour,
either way. True offset: that of the clock plus the delay that the model says its offset holds (the
shortest, or the mean of the middle 80 %).
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, optimize, stats

from daq.time_base.fit import fit_clock
from daq.time_base.model import Anchor

Array = NDArray[np.float64]

SECONDS = 600.0
SPIKES, SPIKE_S = 0.01, 20e-3
WIDTH_S = 1e-3
SHAPES = {
    "exponential": stats.expon(scale=WIDTH_S),
    "half normal": stats.halfnorm(scale=WIDTH_S),
    "uniform": stats.uniform(scale=2 * WIDTH_S),
    "normal about 5 ms": stats.norm(loc=5e-3, scale=WIDTH_S),
    "gamma, order 2": stats.gamma(2, scale=WIDTH_S / math.sqrt(2)),
    "lognormal": stats.lognorm(0.7, scale=WIDTH_S),
}
COUNTED = (
    "rate within 0.5 ppm",
    "rate",
    "time at start",
    "time at middle",
    "time at end",
    "whole run",
    "steps as they were",
)
STATED = COUNTED[1:6]
LEAST, MOST = 182, 198


@dataclass(frozen=True, slots=True)
class Run:
    """Pairs of one run, and the offset without delay at each of them."""

    device_s: Array
    arrival_s: Array
    offset_s: Array
    rate_ppm: float
    steps: int


def simulate(shape: str, stepped: bool, seed: int, rate_hz: float = 10.0) -> Run:
    rng = np.random.default_rng([seed, stepped, list(SHAPES).index(shape)])
    device_s = np.arange(round(SECONDS * rate_hz)) / rate_hz
    rate_ppm = float(rng.choice([-1, 1]) * rng.uniform(5, 50))
    offset_s = rng.uniform(-1, 1) + rate_ppm * 1e-6 * device_s
    if stepped:
        size_s = rng.choice([-1, 1]) * 10 ** rng.uniform(np.log10(5e-3), np.log10(3600))
        offset_s = offset_s + size_s * (device_s > rng.uniform(0.1, 0.9) * SECONDS)
    delay_s = SHAPES[shape].rvs(len(device_s), random_state=rng)
    delay_s = np.maximum(delay_s, 0.0) + SPIKE_S * (rng.random(len(device_s)) < SPIKES)
    return Run(device_s, device_s + offset_s + delay_s, offset_s, rate_ppm, int(stepped))


@cache
def delay_held(shape: str, anchor: Anchor) -> float:
    """The delay in s that an offset by `anchor` holds, spikes included."""
    if anchor is Anchor.SHORTEST:
        return 0.0

    def below(delay_s: float) -> float:
        usual, spiked = SHAPES[shape].cdf([delay_s, delay_s - SPIKE_S])
        return float((1 - SPIKES) * usual + SPIKES * spiked)

    low, high = (optimize.brentq(lambda x, q=q: below(x) - q, 0.0, 0.1, xtol=1e-12) for q in (0.1, 0.9))
    area = integrate.quad(below, low, high, epsabs=1e-12)[0]
    return float((0.9 * high - 0.1 * low - area) / 0.8)  # the mean between the two, by parts


def judge(seed: int, shape: str, stepped: bool, rate_hz: float) -> tuple[Anchor, dict[str, bool]]:
    """Which of `COUNTED` hold in one run."""
    run = simulate(shape, stepped, seed, rate_hz)
    model = fit_clock(run.device_s, run.arrival_s)
    assert model is not None
    at = np.linspace(0, len(run.device_s) - 1, 61).astype(int)
    error_s = np.abs(model.offset_s(run.device_s[at]) - run.offset_s[at] - delay_held(shape, model.anchor))
    within = error_s <= model.uncertainty_s(run.device_s[at])
    rate_error = abs(model.rate_ppm - run.rate_ppm)
    return model.anchor, {
        "rate within 0.5 ppm": rate_error <= 0.5,
        "rate": rate_error <= model.rate_uncertainty_ppm,
        "time at start": bool(within[0]),
        "time at middle": bool(within[30]),
        "time at end": bool(within[-1]),
        "whole run": bool(np.all(error_s <= model.band_s(run.device_s[at]))),
        "steps as they were": len(model.steps) == run.steps,
    }


def main() -> int:
    arguments = _arguments()
    print(f"{arguments.runs} runs each, {arguments.rate_hz:g} pairs a second; 95 %, but first and last")
    print(f"{'':27}" + "".join(f"{each:>20}" for each in COUNTED))
    kinds = [(stepped, shape) for stepped in (False, True) for shape in SHAPES]
    with ProcessPoolExecutor(arguments.workers) as pool:
        results = [
            _count(pool.map(partial(judge, shape=shape, stepped=stepped, rate_hz=arguments.rate_hz),
                            range(arguments.first_seed, arguments.first_seed + arguments.runs), chunksize=10),
                   f"{'stepped' if stepped else 'drift'}, {shape}")
            for stepped, shape in kinds
        ]  # fmt: skip
    share = arguments.runs / 200
    good = all(
        LEAST * share <= counted[each] <= MOST * share for counted in results for each in STATED
    ) and all(counted["rate within 0.5 ppm"] == arguments.runs for counted in results)
    print(f"\nstated hold in {LEAST} to {MOST} of 200, every rate within 0.5 ppm: {'yes' if good else 'no'}")
    return 0 if good else 1


def _count(judged: Iterable[tuple[Anchor, dict[str, bool]]], name: str) -> Counter[str]:
    counted: Counter[str] = Counter()
    anchors: Counter[Anchor] = Counter()
    for anchor, held in judged:
        counted.update(each for each, holds in held.items() if holds)
        anchors[anchor] += 1
    which = ", ".join(f"{anchor.value} {count}" for anchor, count in anchors.items())
    print(
        f"{name:27}" + "".join(f"{counted[each]:20}" for each in COUNTED) + f"   offset holds: {which}",
        flush=True,
    )
    return counted


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--rate-hz", type=float, default=10.0, help="pairs a second")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
