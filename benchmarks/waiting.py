"""How well the time told at the start of a command is kept, and what a sweep takes beside its records.

The commands are run as a person would, with a cache of their own that knows nothing yet: each kind of work in
a small and in a large size, from which the machine's pace is learnt, and then in one between, whose time was
told before. What the emulated bench adds to every point of a sweep of 27 points of 15 impacts at 20 Hz is the
time of the whole command less what was recorded. A diagnosis, which ends once it is sure, is told by the most
that it may take: what counts here is how long that which it simulated should have taken.

Usage: python -m benchmarks.waiting [told | sweep | crank], all three without
Returns 1 if more than 30 % lie between a time told and that taken, where that is a second or more, if a point
takes more than 3 s beyond its record, or the spatial crank's run of 10 s more than 40 s, its healthy band and
machine code kept.
"""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from daq.log.reader import LogReader
from rig.session.pace import Paces, Work

ROOT: Final = Path(__file__).parents[1]
SIZES: Final = (2.0, 8.0, 4.0)
"""How large the work is, as times of a small one; the last is told by the others."""
WITHIN, LEAST_S = 0.3, 1.0
POINT_S, CRANK_S, POINTS, RATE_HZ = 3.0, 40.0, 27, 51_200.0

BEAM = """\
name = "beam {seconds:g} s"
rig = "impact_beam"
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
settle = "1 s"
duration = "{seconds:g} s"
"""
CRANK = """\
name = "spatial crank {seconds:g} s"
rig = "spatial_slider_crank"
[model]
axis_angle = "90 deg"
socket_clearance = "0.25 mm"
guide_clearance = "0.25 mm"
[drive]
speed = "230 rpm"
[acquisition]
sample_rate = "25.6 kHz"
settle = "1 s"
duration = "{seconds:g} s"
"""
SWEEP = """\
[sweep]
name = "{steps} points"
{until}
[scenario]
rig = "impact_beam"
[scenario.drive]
frequency = "20 Hz"
[scenario.acquisition]
sample_rate = "51.2 kHz"
settle = "0.5 s"
{duration}
[axes]
"drive.amplitude" = {{ from = "7 N", to = "11 N", steps = {steps} }}
"""
UNTIL: Final = 'until = { impacts = 15, longest = "20 s" }'


def rattle(folder: Path, *arguments: object) -> tuple[str, float]:
    """Run a command; what it said, and its wall time in s."""
    kept = {"XDG_CACHE_HOME": str(folder / "cache"), "RATTLE_PACES": "1"}
    environment = {"RATTLE_HEALTHY_RIGS": "0", **os.environ, **kept}
    began = time.perf_counter()
    ended = subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-m", "rig.start", *map(str, arguments)],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    if ended.returncode not in (0, 1, 3):
        raise SystemExit(f"{arguments}: {ended.stderr}")
    return ended.stdout, time.perf_counter() - began


def commands(folder: Path, size: float) -> Iterator[tuple[object, ...]]:
    """Work of that size, each command with what the ones before it left."""
    beam, crank, long = (folder / f"{name} {size:g}.toml" for name in ("beam", "crank", "long"))
    beam.write_text(BEAM.format(seconds=2 * size))
    crank.write_text(CRANK.format(seconds=2 * size))
    long.write_text(BEAM.format(seconds=20 * size))
    large, table = folder / f"large {size:g}.mcap", folder / f"table {size:g}.csv"
    drawn, log = folder / f"drawn {size:g}.mcap", folder / f"run {size:g}.mcap"
    swept = folder / f"sweep {size:g}.toml"
    swept.write_text(SWEEP.format(steps=2, until="", duration=f'duration = "{2 * size:g} s"'))
    yield "run", beam, "--out", folder / "runs"
    yield "sweep", swept, "--out", folder / f"swept {size:g}"
    yield "predict", beam, "--seed", 1, "--out", drawn
    yield "export", drawn, "--to", "csv", "--channels", "drive.force,contact.*,yoke.*", "-o", table
    as_measured(table)
    yield "import", table, "--scenario", beam, "-o", log
    yield "overlay", log, "-o", folder / f"overlay {size:g}.mcap"
    yield "gap", log
    yield "diagnose", log, "--out", folder / f"answer {size:g}", "--budget", 6 * size
    yield "calibrate", log, "-o", folder / f"model {size:g}.toml", "--rigs", round(50 * size)
    yield "predict", crank, "--out", folder / f"crank {size:g}.mcap"
    yield "predict", long, "--out", large
    yield "replay", large, "--speed", 0
    yield "verify", large
    yield "recover", large, "-o", folder / f"recovered {size:g}.mcap"
    yield "export", large, "--to", "csv", "-o", folder / f"long {size:g}.csv"
    yield "ensemble", beam, "--runs", 200
    yield "reproduce", "--quick", "--only", "ibs-7", "--out", folder / f"again {size:g}"


def as_measured(table: Path) -> None:
    """Leave of an exported table what another program's would hold: times and channels."""
    with table.open(newline="") as file:
        heading, *rows = csv.reader(file)
    with table.open("w", newline="") as file:
        written = csv.writer(file)
        written.writerow([name.removeprefix("predicted/") for name in heading[:-1]])
        written.writerows(row[:-1] for row in rows)


SAID: Final = re.compile(r"^(?:lasts|time) +about (?:(\d+) min )?(\d+) s", re.MULTILINE)
"""What a run and a sweep say at their start of all that comes."""


def told(folder: Path) -> bool:
    """Print the table; whether all of it is as it should be."""
    kept = folder / "cache" / "rattle" / "paces.json"
    os.environ |= {"RATTLE_PACES": "1", "XDG_CACHE_HOME": str(folder / "cache")}
    for size in SIZES[:-1]:
        for command in commands(folder, size):
            rattle(folder, *command)
    (folder / "known.json").write_bytes(kept.read_bytes())
    known = Paces(folder / "known.json")
    said: dict[str, tuple[float, float]] = {}
    for command in commands(folder, SIZES[-1]):
        output, taken_s = rattle(folder, *command)
        if found := SAID.search(output):
            said[f"{command[0]}, as it is said"] = 60.0 * int(found[1] or 0) + int(found[2]), taken_s
    before, after = (json.loads(file.read_text()) for file in (folder / "known.json", kept))
    print(f"{'kind of work':34s} {'told, s':>8s} {'taken, s':>8s} {'off':>7s}")
    well = len(said) == 2
    for kind, works in after.items():
        if works == before.get(kind) or kind not in before:
            continue
        units, taken_s = works[-1]
        told_s = known.expected_s(Work(kind, units))
        assert told_s is not None
        said[kind] = told_s, taken_s
    for kind, (told_s, taken_s) in said.items():
        off = taken_s / told_s - 1.0
        bad = abs(off) > WITHIN and taken_s >= LEAST_S
        well = well and not bad
        print(f"{kind:34s} {told_s:8.2f} {taken_s:8.2f} {off:+7.0%}{'  BEYOND' if bad else ''}")
    return well


def sweep(folder: Path) -> bool:
    """Print what a point takes beside its record; whether that is little enough."""
    (folder / "sweep.toml").write_text(SWEEP.format(steps=POINTS, until=UNTIL, duration=""))
    _, wall_s = rattle(folder, "sweep", folder / "sweep.toml", "--out", folder / "swept")
    recorded_s = 0.0
    logs = sorted((folder / "swept").glob("point-*/*.mcap"))
    for log in logs:
        with LogReader(log) as reader:
            recorded_s += len(reader.series("measured", "drive.force")) / RATE_HZ
    point_s = (wall_s - recorded_s) / max(len(logs), 1)
    print(f"sweep: {len(logs)} points of {recorded_s / len(logs):.2f} s, {wall_s:.1f} s in all: "
          f"{point_s:.2f} s a point beyond the record, {point_s - 0.5:.2f} s less settling")  # fmt: skip
    return len(logs) == POINTS and point_s <= POINT_S


def crank(folder: Path) -> bool:
    """Print what a run of the spatial crank takes, once its band and machine code are there."""
    os.environ["RATTLE_HEALTHY_RIGS"] = "48"  # the first run simulates their band and keeps it
    wall_s = [rattle(folder, "run", "scenarios/spatial_slider_crank.toml", "--out", folder / "cranks")[1]
              for _ in range(2)][-1]  # fmt: skip
    print(f"spatial crank: a run of 10 s takes {wall_s:.1f} s in all")
    return wall_s <= CRANK_S


def main() -> int:
    asked = sys.argv[1:] or ["told", "sweep", "crank"]
    print(f"load {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores")
    with tempfile.TemporaryDirectory() as folder:
        well = [{"told": told, "sweep": sweep, "crank": crank}[each](Path(folder)) for each in asked]
    print(f"load {os.getloadavg()[0]:.1f}")
    return 0 if all(well) else 1


if __name__ == "__main__":
    sys.exit(main())
