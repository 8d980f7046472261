"""How often the verdict calls a healthy rig otherwise, and how often it sees an effect that shows.

Runs of the three rigs' own scenarios, each as long as it says, simulated as `rattle predict --seed` does, by
other seeds than those of the bands: ten healthy ones each, and ten with one effect of the catalogue, each as
likely and anywhere in its range. An effect shows where the rms or the typical largest magnitude of some
channel lies more than four deviations of healthy rigs off.

Usage: python -m benchmarks.verdict [runs of each kind and rig, 10 without]
       python -m benchmarks.verdict RUN.mcap    what the verdict on a run adds to its report, the band kept
Returns 1 if more than 2 of 30 healthy runs are called otherwise, or less than 27 of 30 effects are seen.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from statistics import median
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.diagnosis.health import band_of, verdict_on
from rig.diagnosis.recordings import AloneRun, setting_of
from rig.ensembles import cores, worker_processes
from rig.files.scenario import load_scenario
from rig.rigs import RIGS
from rig.session.progress import Screen, Terminal
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.cause import Cause, drawn
from sim_twin.diagnosis.healthy_band import HealthyBand
from sim_twin.diagnosis.subject import Draw
from sim_twin.sensors import Encoder, anti_alias_taps

SCENARIOS: Final = ("impact_beam", "planar_slider_crank", "spatial_slider_crank")
RATE: Final = 25_600.0
OF_SPREAD, FAR = 80, 4.0
"""Healthy rigs: 20 tell a deviation to a sixth, and the largest of thirty figures finds those too small."""
MOST_FALSE, LEAST_SEEN, MOST_S = 2 / 30, 27 / 30, 3.0
Array = NDArray[np.floating]


def figures(campaign: Campaign, records: Mapping[str, Array]) -> NDArray[np.float64]:
    """Logarithms of rms and of the median over cycles of the largest magnitude, of each channel."""
    (setting,) = campaign.runs
    cycle = round(setting.columns.rate / setting.columns.frequency)
    found = []
    for name in setting.columns.channels:
        if isinstance(setting.twin.sensors.get(name), Encoder):
            continue
        size = np.abs(np.asarray(records[name], dtype=np.float64))
        largest = size[: len(size) // cycle * cycle].reshape(-1, cycle).max(axis=1)
        found += [np.log(np.sqrt(np.mean(size**2))), np.log(np.median(largest))]
    return np.array(found)


def shown(campaign: Campaign, draw: Draw) -> Mapping[str, Array] | None:
    """What the sensors of one drawn rig show; at a worker."""
    (records,) = campaign.records([draw])[0]
    return records


def judge(campaign: Campaign, band: HealthyBand, records: Mapping[str, Array]) -> tuple[bool, str]:
    """Whether a run is called healthy, and its gap in words."""
    (setting,) = campaign.runs
    whole, first, *_ = band.places(setting.blocks_of(records))
    beyond = whole.beyond or first.beyond
    return not beyond, f"gap {whole.gap:.2f} ({whole.farthest:.2f}), {first.channel} {first.gap:.2f}"


def _one_of(campaign: Campaign, name: str, rng: np.random.Generator) -> Cause:
    """An effect, on any channel that it may sit on."""
    causes = [cause for cause in campaign.causes if cause.name == name]
    return causes[int(rng.integers(len(causes)))]


def of_rig(name: str, runs: int, executor: Executor, screen: Screen) -> tuple[int, int]:
    """How many healthy runs are called otherwise, and how many effects are seen."""
    scenario = load_scenario(Path("scenarios") / f"{name}.toml")
    every = RIGS[scenario.rig].channels
    named = tuple(channel for channel in every if not channel.startswith(("beam.", "cover.")))
    twin = twin_of(scenario, named)
    whole = int(scenario.acquisition.duration * scenario.drive.cycle_hz) - 3
    step = round(scenario.acquisition.sample_rate / RATE)
    left = float(np.sqrt(np.sum(anti_alias_taps(step, 0.0) ** 2))) if step > 1 else 1.0
    quiet = dict.fromkeys(twin.channels, left)
    campaign = Campaign((setting_of(twin, twin.channels, RATE, whole, quiet),))
    blocks = whole // campaign.runs[0].cycles
    band = band_of(AloneRun(scenario, campaign, np.empty((0, 0), np.float32), blocks=blocks), "", 48, screen)
    if band is None:
        raise SystemExit("no healthy band")
    healthy = [Draw((), 10_000 + seed, blocks=blocks) for seed in range(max(runs, OF_SPREAD))]
    records = [each for each in executor.map(shown, [campaign] * len(healthy), healthy) if each is not None]
    spread = np.array([figures(campaign, each) for each in records])
    mean, deviation = spread.mean(axis=0), np.maximum(spread.std(axis=0, ddof=1), 1e-9)
    false = 0
    for each in records[:runs]:
        well, told = judge(campaign, band, each)
        false += not well
        print(f"{name:22s} healthy                     {'within' if well else 'NOT':7s} {told}", flush=True)
    rng = np.random.default_rng(7)
    names, seen, showing = sorted({cause.name for cause in campaign.causes}), 0, 0
    while showing < runs:
        causes_now = [_one_of(campaign, name, rng) for name in rng.permutation(names)[:4]]
        draws = [
            Draw((cause.named(drawn((cause,), 1, rng)[0]),), int(rng.integers(2**40)), blocks=blocks)
            for cause in causes_now
        ]
        for draw, found in zip(draws, executor.map(shown, [campaign] * len(draws), draws), strict=True):
            if found is None or showing == runs:
                continue
            if np.abs((figures(campaign, found) - mean) / deviation).max() < FAR:
                continue
            showing += 1
            well, told = judge(campaign, band, found)
            seen += not well
            print(f"{name:22s} {draw.effects[0][0]:27s} {'MISSED' if well else 'seen':7s} {told}", flush=True)
    return false, seen


def main(runs: int = 10) -> int:
    """Print every verdict and both counts."""
    screen, false, seen = Screen(Terminal(stderr=True)), 0, 0
    with worker_processes(cores()) as workers:
        for name in SCENARIOS:
            here = of_rig(name, runs, workers.executor, screen)
            false, seen = false + here[0], seen + here[1]
    total = runs * len(SCENARIOS)
    print(f"healthy runs called otherwise {false} of {total} (at most {MOST_FALSE * total:.0f})")
    print(f"effects that show, seen       {seen} of {total} (at least {LEAST_SEEN * total:.0f})")
    return int(false > MOST_FALSE * total or seen < LEAST_SEEN * total)


def cost(log: Path) -> int:
    """Print what a verdict adds to a run that has been read, in processes that have not judged before."""
    verdict_on(log, Screen(Terminal(stderr=True)))  # so that there is a band
    taken = []
    for _ in range(5):
        told = subprocess.check_output([sys.executable, "-c", _COST, str(log)], text=True)  # noqa: S603
        taken.append(float(told))
    each = ", ".join(f"{seconds:.2f}" for seconds in taken)
    print(f"verdict on {log.name}: median {median(taken):.2f} s (at most {MOST_S:g}; {each})")
    return int(median(taken) > MOST_S)


_COST: Final = """
import sys, time
from pathlib import Path
from rig.report.page import render
from rig.report.record import read_run
render(read_run(Path(sys.argv[1])))
began = time.perf_counter()
from rig.diagnosis.health import verdict_on
from rig.session.progress import Screen, Terminal
verdict_on(Path(sys.argv[1]), Screen(Terminal(stderr=True)))
print(time.perf_counter() - began)
"""

if __name__ == "__main__":
    if sys.argv[1:] and not sys.argv[1].isdigit():
        sys.exit(cost(Path(sys.argv[1])))
    sys.exit(main(*map(int, sys.argv[1:2])))
