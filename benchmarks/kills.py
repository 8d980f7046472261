"""Runs of all three rigs that are killed (SIGKILL) while they record: what of each stream is lost.

A run records on its emulated bench; at a random moment it is killed, its log recovered, and the end of each
measured stream held against the moment of the kill: what was measured before it and is not there is lost.
Returns 1 if a log cannot be recovered, a sample is unaccounted for, or more than half a second is lost.

Usage: python -m benchmarks.kills [kills] [--seed N]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from daq.block import NS_PER_S, sample_time_ns
from daq.errors import LogError
from daq.log.reader import LogReader
from daq.log.recover import recover_log

ROOT = Path(__file__).parents[1]
MOST_LOST_S = 0.5
_SCENARIO = """\
rig = "{rig}"
[drive]
{drive}
[acquisition]
sample_rate = "25.6 kHz"
settle = "1.5 s"
duration = "60 s"
"""
RIGS = {
    "impact_beam": 'frequency = "20 Hz"\namplitude = "9 N"',
    "planar_slider_crank": 'speed = "200 rpm"',
    "spatial_slider_crank": 'speed = "230 rpm"',
}
_ENCODER = "[encoder]\nemulated = true\n"
_LONGEST_S = 3.0
"""Of the record before the kill."""
_START_S = 60.0


def killed_run(rig: str, after_s: float, folder: Path) -> tuple[Path, int]:
    """A log that was being written when its run was killed `after_s` into the record, and when (Unix ns)."""
    scenario, bench = folder / "scenario.toml", folder / "bench.toml"
    scenario.write_text(_SCENARIO.format(rig=rig, drive=RIGS[rig]))
    command = [sys.executable, "-u", "-m", "rig.start", "run", str(scenario), "--out", str(folder)]
    if rig == "planar_slider_crank":  # a slow stream besides, with a clock of its own
        bench.write_text(_ENCODER)
        command += ["--bench", str(bench)]
    with subprocess.Popen(  # noqa: S603
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        said = []
        for line in run.stdout:
            said.append(line)
            if line.startswith("recording"):
                break
        else:
            assert run.stderr is not None
            raise RuntimeError("".join(said) + run.stderr.read())
        helpers = psutil.Process(run.pid).children(recursive=True)
        time.sleep(after_s)
        killed_ns = time.time_ns()
        run.kill()
    _, alive = psutil.wait_procs(helpers, _START_S)
    if alive:
        raise RuntimeError(f"left behind: {alive}")
    (log,) = folder.glob("*.mcap")
    return log, killed_ns


def lost_s(log: Path, killed_ns: int, recovered: Path) -> dict[str, float]:
    """Seconds of each measured channel before the kill that are not in what is recovered of `log`.

    Raises LogError if it cannot be recovered, or if samples in it are unaccounted for.
    """
    report = recover_log(log, recovered)
    if not report.sound or not report.whole:
        raise LogError(f"{log}: {report}")
    with LogReader(recovered) as reader:
        ends = dict.fromkeys(reader.channels("measured"), 0)
        for _, block in reader.blocks("measured"):
            ends[block.channel] = sample_time_ns(block.time_ns, len(block), block.sample_rate)
    return {name: (killed_ns - end) / NS_PER_S for name, end in ends.items()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kills", nargs="?", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    lost: list[float] = []
    for number in range(arguments.kills):
        rig = list(RIGS)[number % len(RIGS)]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            # half a second at least: before the first chunk ends there is nothing to lose
            log, killed_ns = killed_run(rig, float(rng.uniform(0.5, _LONGEST_S)), folder)
            each = lost_s(log, killed_ns, folder / "recovered.mcap")
        worst = max(each, key=each.__getitem__)
        lost.append(each[worst])
        print(f"{number + 1:4} {rig:22} {worst:22} {each[worst]:.3f} s", flush=True)
    print(
        f"all {len(lost)} recovered; lost at most {max(lost):.3f} s, median {np.median(lost):.3f} s"
        f" (bar {MOST_LOST_S:g} s); more than that: below {3 / len(lost):.2g} of all (95 %)"
    )
    return int(max(lost) > MOST_LOST_S)


if __name__ == "__main__":
    raise SystemExit(main())
