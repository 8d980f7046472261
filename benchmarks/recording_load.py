"""Sixteen channels from the emulated card to the log, twin and live view on: samples lost, CPU, memory.

Runs `rattle run --live` as a user would and watches its acquisition process from outside.
"""

from __future__ import annotations

import argparse
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from daq.log import verify_log

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "impact_beam_sixteen_channels.toml"
BENCH = ROOT / "scenarios" / "sixteen_channels.bench.toml"
EVERY_S = 2.0
MIB = 1 << 20


def main() -> int:
    arguments = _arguments()
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "scenario.toml"
        text = re.sub(r'duration = ".*"', f'duration = "{arguments.seconds:g} s"', SCENARIO.read_text())
        scenario.write_text(text)
        command = [sys.executable, "-m", "rig.start", "run", str(scenario), "--bench", str(arguments.bench)]
        command += ["--out", folder] + (["--live"] if not arguments.no_live else [])
        cpu, rss, system = _watch(command, arguments.seconds)
        logs = list(Path(folder).glob("*.mcap"))
        return _report(logs, cpu, rss, system, arguments.seconds)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--bench", type=Path, default=BENCH)
    parser.add_argument("--no-live", action="store_true")
    return parser.parse_args()


def _watch(command: list[str], seconds: float) -> tuple[list[float], list[float], list[float]]:
    """CPU (share of a core) and RSS (MiB) of the acquisition process, and CPU of all its children."""
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own
    assert run.stdout is not None
    for line in run.stdout:
        print(line, end="")
        if line.startswith("recording"):
            break
    process = psutil.Process(run.pid)
    children = process.children(recursive=True)
    cpu, rss, system = [], [], []
    end = time.monotonic() + seconds
    before = [_seconds(each) for each in (process, *children)]
    while time.monotonic() < end and run.poll() is None:
        time.sleep(EVERY_S)
        now = [_seconds(each) for each in (process, *children)]
        cpu.append((now[0] - before[0]) / EVERY_S)
        system.append(sum(now) / EVERY_S - sum(before) / EVERY_S)
        rss.append(process.memory_info().rss / MIB)
        before = now
    print(run.stdout.read(), end="")
    run.wait()
    return cpu, rss, system


def _seconds(process: psutil.Process) -> float:
    try:
        times = process.cpu_times()
    except psutil.NoSuchProcess:
        return 0.0
    return times.user + times.system


def _report(logs: list[Path], cpu: list[float], rss: list[float], system: list[float], seconds: float) -> int:
    if len(logs) != 1:
        print("no log")
        return 1
    report = verify_log(logs[0])
    measured = [topic for topic in report.topics if topic.topic.startswith("/measured/")]
    predicted = [topic for topic in report.topics if topic.topic.startswith("/predicted/")]
    counts = {topic.samples for topic in (*measured, *predicted)}
    third = max(1, len(rss) // 3)
    print(f"\nlog                       {logs[0].stat().st_size / MIB:.0f} MiB, sound: {report.sound}")
    print(f"channels                  {len(measured)} measured, {len(predicted)} predicted")
    print(f"samples a channel         {sorted(counts)}, expected {round(seconds * 51200)}")
    print(f"samples missing           {sum(topic.missing for topic in report.topics)}")
    print(f"acquisition process, CPU  {statistics.mean(cpu):.2f} of a core (worst 2 s: {max(cpu):.2f})")
    print(f"acquisition process, RSS  {max(rss):.0f} MiB; first third {statistics.mean(rss[:third]):.0f}, "
          f"last third {statistics.mean(rss[-third:]):.0f}")  # fmt: skip
    print(f"all processes, CPU        {statistics.mean(system):.2f} cores")
    kept = counts == {round(seconds * 51200)} and report.sound
    return 0 if kept and statistics.mean(cpu) < 0.5 and max(rss) < 400 else 1


if __name__ == "__main__":
    sys.exit(main())
