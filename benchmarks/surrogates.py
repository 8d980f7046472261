"""The second paper's predictors: how fast they learn and speak; --page writes docs/surrogates.md's figures.

On one core: the time to learn 100,000 samples of six inputs, width by cross-validation, and how many times
faster than real time three channels at 25.6 kHz are predicted. Returns 1 if a bar is missed. --page has
`rattle surrogate report` make and judge the logs too (in DIR, where what is there stays) and writes both into
the page.

Usage: python -m benchmarks.surrogates [--page [--out DIR]]
"""

from __future__ import annotations

import argparse
import datetime
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.soak import machine
from rig.surrogates.training import UNITS
from sim_twin.surrogates.samples import COLUMNS, Samples
from sim_twin.surrogates.surrogate import Kind, learnt

PAGE = Path(__file__).parents[1] / "docs" / "surrogates.md"
BEGIN, END = "<!-- written by python -m benchmarks.surrogates --page -->", "<!-- as far as here -->"
SAMPLES, RATE = 100_000, 25_600
LEARNT_WITHIN_S = 30.0


class Speed(NamedTuple):
    """Processor seconds to learn `SAMPLES` samples, and seconds of record predicted in a second of it."""

    learnt_s: float
    times_real_time: float


def record() -> Samples:
    """So many samples of 25.6 kHz in which every input varies and nothing repeats."""
    random, columns = np.random.default_rng(0), []
    for low, high in ((0, 4), (0, 80), (150, 200), (1, 2), (1, 2), (2700, 7800)):
        columns.append(random.uniform(low, high, SAMPLES))
    inputs = np.column_stack(columns)
    assert inputs.shape[1] == len(COLUMNS)
    angle = inputs[:, [1]]
    outputs = inputs[:, [3]] * np.sin(angle * [1, 2, 3]) + random.normal(size=(SAMPLES, 3))
    return Samples(
        inputs, outputs, np.zeros(SAMPLES, np.int64), np.asarray(angle[:, 0] / (2 * np.pi), np.int64)
    )


def speed(kind: Kind) -> Speed:
    """Of one core, with the units that `rattle surrogate train` gives it."""
    samples, (name, units) = record(), UNITS[kind]
    most: dict[str, Any] = {name: units}
    with threadpool_limits(1):
        begun = time.process_time()
        found = learnt(samples, "any", ("x", "y", "z"), "angle", kind, **most)
        learnt_s = time.process_time() - begun
        spent = []
        for _ in range(3):
            begun = time.process_time()
            found.predict(samples.inputs[:RATE])
            spent.append(time.process_time() - begun)
    return Speed(learnt_s, 1 / min(spent))


def main(page: bool, out: Path) -> int:
    """Print and write; 1 if a bar is missed."""
    lines, missed = [], False
    for kind, (_, units) in UNITS.items():
        found = speed(kind)
        missed |= found.learnt_s > LEARNT_WITHIN_S or found.times_real_time <= 1
        lines.append(
            f"{kind}, {units} units: {SAMPLES} samples learnt in {found.learnt_s:.1f} s (bar"
            f" {LEARNT_WITHIN_S:g}), three channels at 25.6 kHz predicted {found.times_real_time:.1f} times"
            " faster than real time"
        )
        print(lines[-1], flush=True)
    if page:
        begun, fresh = time.monotonic(), not out.exists()
        command = [sys.executable, "-m", "rig.start", "surrogate", "report", "--out", str(out)]
        subprocess.run(command, check=True)  # noqa: S603
        took = f"took {(time.monotonic() - begun) / 60:.1f} min" if fresh else "went on from an earlier call"
        when = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
        tables = (out / "surrogates.md").read_text(encoding="utf-8")
        head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        figures = f"{when}; {machine()}. `rattle surrogate report` {took}.\n\n{tables}\n" + "".join(
            f"- {line}\n" for line in lines
        )
        PAGE.write_text(f"{head}{BEGIN}\n\n{figures}\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    return int(missed)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--page", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("runs") / "surrogates")
    given = parser.parse_args()
    raise SystemExit(main(given.page, given.out))
