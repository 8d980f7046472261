"""Two worker processes against one: 1 000 healthy impact beams of 2 s each, best of several, alternated.

Both pools stay open, so that the machine is the same for both. The memory is the largest sum of the resident
memory of the command and the two workers that was seen; pages that they share count three times.

Usage: python -m benchmarks.ensemble_workers [repetitions]
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

import psutil

from rig.ensembles import Workers, worker_processes
from sim_twin.ensembles.figures import Figures, failures
from sim_twin.ensembles.population import Population
from sim_twin.ensembles.simulate import Variant, simulate
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.twin import Twin

RUNS, SECONDS = 1000, 2.0
FIGURES = Figures(0.5, SECONDS - 0.5)
RATIO_BAR, MEMORY_BAR_GB = 1.8, 2.0
_QUEUED = 4


def population() -> Population:
    rig, drive = nominal(), SineDrive(9.0, 20.0)
    return Population(Twin(rig, drive, nominal_sensors(rig)))


def wall_time(variants: Sequence[Variant], workers: Workers, memory: Memory | None = None) -> float:
    begin = time.perf_counter()
    look = None if memory is None else memory.look
    outcomes = simulate(variants, FIGURES, workers.executor, look, _QUEUED * workers.count)
    wall = time.perf_counter() - begin
    assert not failures(outcomes)
    return wall


class Memory:
    """The largest sum of resident memory of some processes, in bytes."""

    def __init__(self, processes: Sequence[psutil.Process]) -> None:
        self._processes = processes
        self.most = 0

    def look(self, done: int, every: int) -> None:
        self.most = max(self.most, sum(each.memory_info().rss for each in self._processes))


def main(repetitions: int) -> int:
    """Print the times, their ratio and the memory; return 0 if both bars are met."""
    variants, here = population().variants(RUNS, 0), psutil.Process()
    with worker_processes(1) as one:
        others = here.children()
        with worker_processes(2) as two:
            memory = Memory([here, *(each for each in here.children() if each not in others)])
            for workers in (one, two):
                wall_time(variants[:100], workers)
            ones, twos = [], []
            for _ in range(repetitions):
                ones.append(wall_time(variants, one))
                twos.append(wall_time(variants, two, memory))
                print(f"one worker {ones[-1]:6.2f} s, two workers {twos[-1]:6.2f} s", flush=True)
    ratio, gigabytes = min(ones) / min(twos), memory.most / 1e9
    print(f"{RUNS * SECONDS / min(twos):.0f} simulated s per wall s with two workers")
    print(f"ratio of the best {ratio:.2f}; bar {RATIO_BAR}")
    print(f"memory {gigabytes:.2f} GB in all; bar {MEMORY_BAR_GB}")
    return 0 if ratio >= RATIO_BAR and gigabytes < MEMORY_BAR_GB else 1


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 5))
