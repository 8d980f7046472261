"""Sixteen channels or more from the emulated card to the log, twin, live view and derived channels on.

Runs `rattle run --live` as a user would and watches its processes from outside: samples lost, blocks that the
view dropped, processor time, memory. With `--channels 64` the bench is made for it: the five channels of the
impact beam and accelerometers along it.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from daq.log.reader import LogReader
from daq.log.recover import verify_log

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "impact_beam_sixteen_channels.toml"
BENCH = ROOT / "scenarios" / "sixteen_channels.bench.toml"
EVERY_S = 2.0
MIB = 1 << 20
MOST_CPU = {16: 0.5}
"""Share of a core that the acquisition process may take, by channels; one core where nothing is said."""
MOST_MIB = {16: 400}
_INPUTS = 4
_STATIONS = range(5, 97)
_ACCELEROMETER = """
[[daq_card.channels]]
name = "beam.acceleration_{station:02d}"
physical = "cDAQ1Mod{module}/ai{number}"
kind = "acceleration_iepe"
sensitivity = "10 mV/g"
range = "400 g"
serial = "EMU-{serial}"
calibrated = 2026-05-04
valid_until = 2036-05-04
"""
_STALL = """
[emulation]
faults = ["disk.stalls@3:for={seconds:g}"]
"""


@dataclass(slots=True)
class Watched:
    """CPU (share of a core) of each process in each stretch of 2 s; RSS (MiB) of the acquisition process."""

    cpu: dict[str, list[float]] = field(default_factory=dict)
    rss: list[float] = field(default_factory=list)


def main() -> int:
    arguments = _arguments()
    print(f"load before the run       {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "scenario.toml"
        text = re.sub(r'duration = ".*"', f'duration = "{arguments.seconds:g} s"', SCENARIO.read_text())
        scenario.write_text(text)
        bench, of_bench = arguments.bench, arguments.bench.read_text()
        if arguments.channels != 16 or arguments.stall:
            bench = Path(folder) / "bench.toml"
            of_bench = of_bench if arguments.channels == 16 else _bench_of(arguments.channels)
            bench.write_text(of_bench + _STALL.format(seconds=arguments.stall))
        command = [sys.executable, "-m", "rig.start", "run", str(scenario), "--bench", str(bench)]
        command += ["--out", folder] + (["--live"] if not arguments.no_live else [])
        watched = _watch(command, arguments.seconds)
        return _report(list(Path(folder).glob("*.mcap")), watched, arguments.seconds, arguments.channels)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--channels", type=int, default=16)
    parser.add_argument("--bench", type=Path, default=BENCH)
    parser.add_argument("--stall", type=float, default=0.0, help="s for which the disk takes nothing")
    parser.add_argument("--no-live", action="store_true")
    return parser.parse_args()


def _bench_of(channels: int) -> str:
    """The bench of sixteen channels with as many accelerometers as are asked for."""
    head, *tables = BENCH.read_text().split("[[daq_card.channels]]")
    kept = [table for table in tables if "beam.acceleration" not in table]
    count = channels - len(kept)
    stations = [_STATIONS[number * len(_STATIONS) // count] for number in range(count)]
    added = (
        _ACCELEROMETER.format(
            station=station, module=3 + number // _INPUTS, number=number % _INPUTS, serial=200 + number
        )
        for number, station in enumerate(stations)
    )
    return "[[daq_card.channels]]".join([head, *kept]) + "".join(added)


def _watch(command: list[str], seconds: float) -> Watched:
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own
    assert run.stdout is not None
    for line in run.stdout:
        print(line, end="")
        if line.startswith("recording"):
            break
    process = psutil.Process(run.pid)
    processes = [process, *process.children(recursive=True)]
    names = {each.pid: _name(each, run.pid) for each in processes}
    watched = Watched({name: [] for name in names.values()})
    end = time.monotonic() + seconds
    before, at = [_seconds(each) for each in processes], time.monotonic()
    while at < end and run.poll() is None:
        time.sleep(EVERY_S)
        now, elapsed = [_seconds(each) for each in processes], time.monotonic() - at
        for each, used, earlier in zip(processes, now, before, strict=True):
            watched.cpu[names[each.pid]].append(max(used - earlier, 0.0) / elapsed)
        watched.rss.append(process.memory_info().rss / MIB)
        before, at = now, at + elapsed
    print(run.stdout.read(), end="")
    run.wait()
    return watched


def _name(process: psutil.Process, acquisition: int) -> str:
    if process.pid == acquisition:
        return "acquisition"
    try:
        line = " ".join(process.cmdline())
    except psutil.Error:
        return f"gone {process.pid}"
    known = {"view_process": "live view", "rerun": "viewer's server", "resource_tracker": "resource tracker"}
    return f"{next((name for part, name in known.items() if part in line), 'worker')} {process.pid}"


def _seconds(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.NoSuchProcess:
        return 0.0
    return times.user + times.system


def _report(logs: list[Path], watched: Watched, seconds: float, channels: int) -> int:
    if len(logs) != 1:
        print("no log")
        return 1
    report = verify_log(logs[0])
    with LogReader(logs[0]) as log:
        told = {event.code: event.text for event in log.events() if event.source in ("rig", "derived")}
    counted = [topic for topic in report.topics if topic.topic.startswith(("/measured/", "/predicted/"))]
    expected = round(seconds * 51200)
    unaccounted = sum(abs(expected - topic.samples - topic.missing) for topic in counted)
    missing = sum(topic.missing for topic in counted)
    derived = sum(topic.samples for topic in report.topics if topic.topic.startswith("/derived/"))
    means = {name: statistics.mean(shares) for name, shares in watched.cpu.items() if shares}
    busiest = max(means, key=lambda name: means[name])
    third = max(1, len(watched.rss) // 3)
    early, late = statistics.mean(watched.rss[:third]), statistics.mean(watched.rss[-third:])
    worst = max(watched.cpu["acquisition"])
    print(f"\nlog                       {logs[0].stat().st_size / MIB:.0f} MiB, sound: {report.sound}")
    print(f"channels                  {len(counted)} measured and predicted, {derived} derived values")
    print(f"samples unaccounted       {unaccounted} (missing: {missing})")
    print(f"view                      {told.get('view.dropped', 'none')}")
    print(f"derived                   {told.get('derived.stopped', 'all of it')}")
    for name, share in sorted(means.items(), key=lambda each: -each[1]):
        print(f"{name:<25} {share:.2f} of a core")
    print(f"acquisition, worst 2 s    {worst:.2f} of a core")
    print(f"acquisition, RSS          {max(watched.rss):.0f} MiB; thirds {early:.0f} to {late:.0f}")
    print(f"busiest process           {busiest}, {means[busiest]:.2f} of a core")
    print(f"all processes             {sum(means.values()):.2f} cores")
    print(f"load after the run        {os.getloadavg()[0]:.2f}")
    kept = report.sound and not unaccounted and not missing and len(counted) == 2 * channels
    within = means["acquisition"] < MOST_CPU.get(channels, 1.0)
    return 0 if kept and within and max(watched.rss) < MOST_MIB.get(channels, 1500) else 1


if __name__ == "__main__":
    sys.exit(main())
