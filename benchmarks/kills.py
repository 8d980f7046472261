"""Runs of all three rigs that are killed (SIGKILL) while they record: what of each stream is lost.

A run records on its emulated bench; at a random moment it is killed, one in five as its log opens, one in
five as it closes, its log recovered, and the end of each measured stream held against the moment of the kill:
what was measured before it and is not there is lost.
What the emulators sent is held against the log. Each bench has a thermometer that is read once a second.
Without what describes the run, or the event of its record's begin where that was told half a second before,
the log is no good. What is predicted comes when its twin gets to it: how much a kill costs of
it is not judged, only that it has no hole. A run that ends by itself before it is killed, as on a machine too
busy for the emulated line, is tried again, and told: one in twenty at most.
Returns 1 if more than half a second is lost; raises LogError where a log cannot be recovered, or a sample is
unaccounted for.

Usage: python -m benchmarks.kills [kills] [--seed N]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from daq.block import NS_PER_S, sample_time_ns
from daq.errors import LogError
from daq.log.reader import LogReader
from daq.log.records import RECORD_END, RECORD_START
from daq.log.recover import recover_log
from drivers.emulator_truth import TRUTH_FOLDER
from tests.accounting import ONLY_A_HEAD, discrepancies, late_s, sent_in

ROOT = Path(__file__).parents[1]
MOST_LOST_S = 0.5
MOST_BEFORE, MOST_TRIES = 1 / 20, 3
_SCENARIO = """\
rig = "{rig}"
[drive]
{drive}
[acquisition]
sample_rate = "25.6 kHz"
settle = "1.5 s"
duration = "{duration_s} s"
"""
RIGS = {
    "impact_beam": 'frequency = "20 Hz"\namplitude = "9 N"',
    "planar_slider_crank": 'speed = "200 rpm"',
    "spatial_slider_crank": 'speed = "230 rpm"',
}
_BESIDE = {"planar_slider_crank": "[encoder]\nemulated = true\n"}
_THERMOMETER = '[thermometer]\nemulated = true\nperiod = "1 s"\n'
"""Slower streams, with clocks of their own."""
_PLUGIN = ROOT / "tests" / "plugin"
_INSTALLED = {
    "METADATA": "Metadata-Version: 2.1\nName: impact-table\nVersion: 1.0\n",
    "entry_points.txt": "[rattle.instruments]\nthermometer = impact_table.thermometer:INSTRUMENT\n",
}
_LONGEST_S = 3.0
"""Of the record before the kill, and of what comes between its end and that of the log."""
_OPENS_S, _LOOK_S = 0.2, 1e-3
_OPENS, _RECORDS, _CLOSES = "opens", "records", "closes"
_MOMENTS = (_RECORDS, _RECORDS, _OPENS, _RECORDS, _CLOSES)
_DURATION_S = {_OPENS: 60, _RECORDS: 60, _CLOSES: 1}
"""Of the record that is asked for."""
_START_S = 60.0


class EndedBefore(RuntimeError):
    """A run that had ended before it was killed."""


@dataclass(frozen=True, slots=True)
class Killed:
    """A log that was being written when its run was killed; when that was and the record began, Unix ns."""

    log: Path
    killed_ns: int
    began_ns: int | None


def killed_run(rig: str, moment: str, after_s: float, folder: Path) -> Killed:
    """A run that was killed so long after its log came, its record began, or that was to end."""
    scenario, bench = folder / "scenario.toml", folder / "bench.toml"
    scenario.write_text(_SCENARIO.format(rig=rig, drive=RIGS[rig], duration_s=_DURATION_S[moment]))
    bench.write_text(_BESIDE.get(rig, "") + _THERMOMETER)
    package = folder / "impact_table-1.0.dist-info"
    package.mkdir()
    for name, text in _INSTALLED.items():
        (package / name).write_text(text)
    path = os.pathsep.join(map(str, (folder, _PLUGIN, ROOT)))
    with subprocess.Popen(  # noqa: S603
        [sys.executable, "-u", "-m", "rig.start", "run", scenario, "--bench", bench, "--out", folder],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {TRUTH_FOLDER: str(folder), "PYTHONPATH": path},
    ) as run:
        began_ns = None
        if moment == _OPENS:
            while not any(folder.glob("*.mcap")):
                if run.poll() is not None:
                    raise EndedBefore("".join(run.communicate()))
                time.sleep(_LOOK_S)
        else:
            began_ns = _began_ns(run)
        helpers = psutil.Process(run.pid).children(recursive=True)
        time.sleep(after_s + (_DURATION_S[moment] if moment == _CLOSES else 0.0))
        killed_ns = time.time_ns()
        run.kill()
    _, alive = psutil.wait_procs(helpers, _START_S)
    if alive:
        raise RuntimeError(f"left behind: {alive}")
    (log,) = folder.glob("*.mcap")
    return Killed(log, killed_ns, began_ns)


def _began_ns(run: subprocess.Popen[str]) -> int:
    """When a run said that it records."""
    assert run.stdout is not None
    assert run.stderr is not None
    said = []
    for line in run.stdout:
        said.append(line)
        if line.startswith("recording"):
            return time.time_ns()
    raise EndedBefore("".join(said) + run.stderr.read())


def lost_s(killed: Killed, recovered: Path) -> dict[str, float]:
    """Seconds of each measured channel before the kill that are not in what is recovered of its log.

    None are where no record was begun. Raises LogError if it cannot be recovered, if what tells of the run is
    missing, or if what was sent beside it is unaccounted for.
    """
    log = killed.log
    if wrong := discrepancies(log, sent_in(log.parent)):
        raise LogError(f"{log}: {'; '.join(wrong)}")
    if killed.began_ns is None and log.stat().st_size < ONLY_A_HEAD:
        return {}
    report = recover_log(log, recovered)
    if not report.sound or not report.whole:
        raise LogError(f"{log}: {report}")
    if killed.began_ns is None:
        return {}
    with LogReader(recovered) as reader:
        ends = dict.fromkeys(reader.channels("measured"), killed.began_ns)
        for _, block in reader.blocks("measured"):
            ends[block.channel] = sample_time_ns(block.time_ns, len(block), block.sample_rate)
        events = reader.events()
        told = {*reader.metadata, *(event.code for event in events)}
        due = {"scenario", "run"}
        if killed.killed_ns - killed.began_ns > MOST_LOST_S * NS_PER_S:
            due.add(RECORD_START)
        if missing := due - told:
            raise LogError(f"{log}: without {', '.join(missing)}, which was told before")
        until_ns = min([killed.killed_ns, *(each.time_ns for each in events if each.code == RECORD_END)])
    return {name: (until_ns - end) / NS_PER_S for name, end in ends.items()}


@dataclass(frozen=True, slots=True)
class Lost:
    """Of a kill: its rig, the stream that lost most, how much and how late that one's samples came (s).

    `seconds` are None where no record was begun. `before`: how many runs had ended before they were to be
    killed.
    """

    rig: str
    stream: str
    seconds: float | None
    late: float
    before: int


def lost_by(number: int, seed: int) -> Lost:
    """What one kill costs; raises EndedBefore where one run after the other ends before it."""
    rng, rig = np.random.default_rng([seed, number]), list(RIGS)[number % len(RIGS)]
    moment = _MOMENTS[number % len(_MOMENTS)]
    for before in range(MOST_TRIES):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            after_s = float(rng.uniform(0.0, _OPENS_S if moment == _OPENS else _LONGEST_S))
            try:
                killed = killed_run(rig, moment, after_s, folder)
            except EndedBefore as error:
                print(f"{rig}: ended before: {str(error).strip().splitlines()[-1:]}", flush=True)
                continue
            each, late = lost_s(killed, folder / "recovered.mcap"), 0.0
            worst = max(each, key=each.__getitem__, default="nothing")
            if each:
                with LogReader(folder / "recovered.mcap") as reader:
                    late = late_s(reader, worst)
        return Lost(rig, f"{moment}: {worst}", each.get(worst), late, before)
    raise EndedBefore(f"{rig}: {MOST_TRIES} runs one after the other")


def worst_lost(kills: int, seed: int) -> Iterator[Lost]:
    """Of so many kills, one after the other; raises EndedBefore where too many runs end before."""
    before = 0
    for number in range(kills):
        lost = lost_by(number, seed)
        before += lost.before
        if before > max(1.0, MOST_BEFORE * kills):
            raise EndedBefore(f"{before} of {kills} runs")
        yield lost


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("kills", nargs="?", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    lost, before = list[float](), 0
    for number, each in enumerate(worst_lost(arguments.kills, arguments.seed)):
        before += each.before
        told = "no record was begun"
        if each.seconds is not None:
            lost.append(each.seconds)
            told = f"{each.seconds:.3f} s, came up to {each.late:.3f} s late"
        print(f"{number + 1:4} {each.rig:22} {each.stream:36} {told}", flush=True)
    print(summary(lost, arguments.kills, before))
    return int(max(lost, default=0.0) > MOST_LOST_S)


def summary(lost: Sequence[float], kills: int, before: int) -> str:
    """What so many kills come to, by what those lost that had begun to record; as many tries ended before."""
    again = f"; {before} more had ended before, and were tried again\n"
    recovered = f"all {kills} recovered{again}{len(lost)} had begun to record"
    if not lost:
        return recovered
    return (
        f"{recovered}, and lost at most {max(lost):.3f} s, median {np.median(lost):.3f} s"
        f" (bar {MOST_LOST_S:g} s); more than that: below {3 / len(lost):.2g} of these (95 %)"
    )


if __name__ == "__main__":
    raise SystemExit(main())
