"""Runs of all three rigs that are killed (SIGKILL) while they record: what of each stream is lost.

A run records on its emulated bench; at a random moment it is killed, its log recovered, and the end of each
measured stream held against the moment of the kill: what was measured before it and is not there is lost.
What the emulators sent is held against the log. One bench has a thermometer that is read once a second. A run
that ends by itself before it is killed, as on a machine too busy for the emulated line, is tried again, and
told: one in twenty at most.
Returns 1 if a log cannot be recovered, a sample is unaccounted for, or more than half a second is lost.

Usage: python -m benchmarks.kills [kills] [--seed N]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil

from daq.block import NS_PER_S, sample_time_ns
from daq.errors import LogError
from daq.log.reader import LogReader
from daq.log.recover import recover_log
from drivers.emulator_truth import TRUTH_FOLDER
from tests.accounting import discrepancies, late_s, sent_in

ROOT = Path(__file__).parents[1]
MOST_LOST_S = 0.5
MOST_BEFORE = 20
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
_BESIDE = {
    "planar_slider_crank": "[encoder]\nemulated = true\n",
    "spatial_slider_crank": '[thermometer]\nemulated = true\nperiod = "1 s"\n',
}
"""Slower streams, with clocks of their own."""
_PLUGIN = ROOT / "tests" / "plugin"
_INSTALLED = {
    "METADATA": "Metadata-Version: 2.1\nName: impact-table\nVersion: 1.0\n",
    "entry_points.txt": "[rattle.instruments]\nthermometer = impact_table.thermometer:INSTRUMENT\n",
}
_SLOWEST_S = 1.0
_LONGEST_S = 3.0
"""Of the record before the kill."""
_START_S = 60.0


class EndedBefore(RuntimeError):
    """A run that had ended before it was killed."""


def killed_run(rig: str, after_s: float, folder: Path) -> tuple[Path, int]:
    """A log that was being written when its run was killed `after_s` into the record, and when (Unix ns)."""
    scenario, bench = folder / "scenario.toml", folder / "bench.toml"
    scenario.write_text(_SCENARIO.format(rig=rig, drive=RIGS[rig]))
    command = [sys.executable, "-u", "-m", "rig.start", "run", str(scenario), "--out", str(folder)]
    if rig in _BESIDE:
        bench.write_text(_BESIDE[rig])
        command += ["--bench", str(bench)]
    package = folder / "impact_table-1.0.dist-info"
    package.mkdir()
    for name, text in _INSTALLED.items():
        (package / name).write_text(text)
    path = os.pathsep.join(map(str, (folder, _PLUGIN, ROOT)))
    with subprocess.Popen(  # noqa: S603
        command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {TRUTH_FOLDER: str(folder), "PYTHONPATH": path},
    ) as run:
        assert run.stdout is not None
        said = []
        for line in run.stdout:
            said.append(line)
            if line.startswith("recording"):
                break
        else:
            assert run.stderr is not None
            raise EndedBefore("".join(said) + run.stderr.read())
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

    Raises LogError if it cannot be recovered, or if what was sent beside it is unaccounted for.
    """
    if wrong := discrepancies(log, sent_in(log.parent)):
        raise LogError(f"{log}: {'; '.join(wrong)}")
    report = recover_log(log, recovered)
    if not report.sound or not report.whole:
        raise LogError(f"{log}: {report}")
    with LogReader(recovered) as reader:
        ends = dict.fromkeys(reader.channels("measured"), 0)
        for _, block in reader.blocks("measured"):
            ends[block.channel] = sample_time_ns(block.time_ns, len(block), block.sample_rate)
    return {name: (killed_ns - end) / NS_PER_S for name, end in ends.items()}


def worst_lost(kills: int, seed: int) -> Iterator[tuple[str, str, float, float]]:
    """Of so many kills: the rig, the stream that lost most, how much, and how late its samples came (s)."""
    rng, number, before = np.random.default_rng(seed), 0, 0
    while number < kills:
        rig = list(RIGS)[number % len(RIGS)]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            # half a second at least: before the first chunk ends there is nothing to lose
            after_s = float(rng.uniform(0.5, _LONGEST_S)) + (_SLOWEST_S if rig in _BESIDE else 0.0)
            try:
                log, killed_ns = killed_run(rig, after_s, folder)
            except EndedBefore as error:
                before += 1
                print(f"{rig}: ended before: {str(error).strip().splitlines()[-1:]}", flush=True)
                if before > kills // MOST_BEFORE:
                    raise
                continue
            each = lost_s(log, killed_ns, folder / "recovered.mcap")
            with LogReader(log) as reader:
                late = late_s(reader)
        number += 1
        worst = max(each, key=each.__getitem__)
        yield rig, worst, each[worst], late


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kills", nargs="?", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    lost: list[float] = []
    for number, (rig, stream, seconds, late) in enumerate(worst_lost(arguments.kills, arguments.seed)):
        lost.append(seconds)
        print(
            f"{number + 1:4} {rig:22} {stream:26} {seconds:.3f} s, came up to {late:.3f} s late", flush=True
        )
    print(
        f"all {len(lost)} recovered; lost at most {max(lost):.3f} s, median {np.median(lost):.3f} s"
        f" (bar {MOST_LOST_S:g} s); more than that: below {3 / len(lost):.2g} of all (95 %)"
    )
    return int(max(lost) > MOST_LOST_S)


if __name__ == "__main__":
    raise SystemExit(main())
