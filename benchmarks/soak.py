"""Everything that is promised of safety and integrity, measured at length, written into docs/reliability.md.

Hours. The page says when, where and how often each was tried, and what came out, as it was printed.
Returns 1 if anything fell short.

Usage: scripts/soak [--only NAME ...] [--short]
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import shlex
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rig.files.software import commit_of

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "reliability.md"
_HEAD = """\
# Reliability in figures

Written by `scripts/soak` and `scripts/fuzz`, on emulated instruments; what is promised stands beside each
figure. *Held*: 99 % of the tries are within the bar. *Safe*: a generator's output off; a motor's run
withdrawn, or its watchdog tripped: then it comes down its ramp, or coasts. No failure in N tries says, with
95 %, that the rate is below 3/N.
"""
_LAST_LINES = 40


@dataclass(frozen=True, slots=True)
class Promise:
    """A promise, and the command that holds the program to it: for the page, and to see that it works."""

    words: str
    command: tuple[str, ...]
    short: tuple[str, ...]


_WATCHDOG = (
    "by an inverter whose watchdog waits for 0.5 s (Pr.122; it may be set to 2 s, and takes as much longer "
    "then)"
)
_LOAD = ("benchmarks.recording_load", "--crank", "--channels", "64", "--stall", "10", "--neighbour")
_SUPPLY = ("benchmarks.reactions", "limit", "killed", "frozen", "thread", "lost", "--drives", "supply")
_FAILING_CALLS = ("pytest", "--no-header", "tests/daq/test_disk.py")
ALL = {
    "crash images": Promise(
        "A power loss leaves a log that can be read, once a first chunk is on the disk; at most the "
        "last 1.5 s of samples, events and what describes the run are lost, the rest is as it was written; "
        "what is missing in between is in the gap ledger.",
        ("benchmarks.crash_images", "5000"),
        ("benchmarks.crash_images", "100"),
    ),
    "flipped bits": Promise(
        "A flipped bit anywhere in a log is told, in a finished one and in one that ends without a summary, "
        "as a crash leaves it.",
        ("benchmarks.bit_flips", "11000"),
        ("benchmarks.bit_flips", "200"),
    ),
    "kills": Promise(
        "A run that is killed while it records, no other beside it, costs at most 0.5 s of any measured "
        "stream, and neither what describes it nor, where that was told half a second before, the begin of "
        "its record.",
        ("benchmarks.kills", "300"),
        ("benchmarks.kills", "3"),
    ),
    "limit": Promise(
        "A limit that is crossed is off within 0.15 s, with a generator and with a motor, also at a terminal "
        "that has stopped.",
        ("benchmarks.reactions", "limit", "--beside", "2"),
        ("benchmarks.reactions", "limit", "--tries", "1"),
    ),
    "emergency stop": Promise(
        "An emergency stop that is pressed is off within 0.15 s, with a generator, a motor and a DC supply; "
        "where the card reads it, with the run frozen as well.",
        ("benchmarks.reactions", "stop", "--drives", "generator", "motor", "supply", "--beside", "2"),
        ("benchmarks.reactions", "stop", "--drives", "generator", "motor", "supply", "--tries", "1"),
    ),
    "killed run": Promise(
        f"A run that is killed is safe within 1 s, whenever it drives, {_WATCHDOG}.",
        ("benchmarks.reactions", "killed", "--beside", "2"),
        ("benchmarks.reactions", "killed", "--tries", "1"),
    ),
    "frozen run": Promise(
        f"A run that is frozen is safe within 1 s, whenever it drives, {_WATCHDOG}.",
        ("benchmarks.reactions", "frozen", "--beside", "2"),
        ("benchmarks.reactions", "frozen", "--tries", "1"),
    ),
    "held thread": Promise(
        "A run of which a thread hangs that guards or drives is safe within 1 s; where it goes on without "
        "another, its limit still stops it.",
        ("benchmarks.reactions", "thread", "--beside", "2"),
        ("benchmarks.reactions", "thread", "--tries", "1"),
    ),
    "lost instrument": Promise(
        "An instrument that is lost, or answers no more, is noticed within 1 s, and what moves is safe 0.2 s "
        "after. What drives and is lost itself is told so by then, by a new connection; where that finds "
        "nobody, an inverter is safe by its own watchdog, a generator by hand.",
        ("benchmarks.reactions", "lost", "--beside", "2"),
        ("benchmarks.reactions", "lost", "--tries", "1"),
    ),
    "supply": Promise(
        "With a DC supply that turns a motor the same: a limit within 0.15 s, a run that is killed or frozen "
        "or of which a thread hangs within 1 s, whatever the supply's own watchdog waits; a lost instrument "
        "as above.",
        (*_SUPPLY, "--beside", "2"),
        (*_SUPPLY, "--tries", "1"),
    ),
    "dead viewer": Promise(
        "A live view that dies costs no sample.",
        ("benchmarks.reactions", "viewer"),
        ("benchmarks.reactions", "viewer", "--tries", "1"),
    ),
    "stall": Promise(
        "A disk that takes nothing for 10 s costs no sample of 64 channels at 51.2 kHz.",
        ("benchmarks.recording_load", "--channels", "64", "--seconds", "30", "--stall", "10"),
        ("benchmarks.recording_load", "--channels", "64", "--seconds", "30", "--stall", "10"),
    ),
    "memory": Promise(
        "What acquisition (reader, limits, recorder), twin, derivation and live view keep of the samples of "
        "64 channels at 51.2 kHz grows by less than 1 MB/h.",
        ("benchmarks.memory",),
        ("benchmarks.memory", "--seconds", "600"),
    ),
    "load": Promise(
        "64 channels at 51.2 kHz, CAN at 1 kHz and the inverter at 20 Hz, with twin and live view, a disk "
        "that stalls and a busy neighbour: no sample lost, by the log's own indices and as it was sent, and "
        "in each process less than 1 MB/h more in use; Rerun's server keeps what it shows.",
        (*_LOAD, "--seconds", "3600"),
        (*_LOAD, "--seconds", "30"),
    ),
    "failing calls": Promise(
        "Whichever call of the disk fails first (open, write, flush, sync, seek, read, close, rename; the "
        "n-th, for n = 1, 2, ... until there is none), or a full disk: one error that stops the run, and all "
        "that was on the disk before can be read.",
        (*_FAILING_CALLS, "tests/daq/test_recorder.py", "-k", "test_disk or call or fail or full"),
        _FAILING_CALLS,
    ),
    "fault table": Promise(
        "Each fault that can be rehearsed, in a run of its rig: it ends as its row says, and every sample "
        "that was sent is in the log or the gap ledger.",
        ("pytest", "--no-header", "-m", "soak", "tests/end_to_end/test_fault_table.py"),
        ("pytest", "--no-header", "-m", "soak", "tests/end_to_end/test_fault_table.py", "-k", "unplugged"),
    ),
    "acquisition": Promise(
        "A record takes at most a tenth more of the processor than at 474bf0b, before logs were synced and "
        "measured forces held.",
        ("benchmarks.versions", "474bf0b", "--only", "acquisition", "acquisition alone"),
        ("benchmarks.versions", "474bf0b", "--only", "acquisition alone", "--rounds", "1"),
    ),
    "Modbus": Promise(
        "A line to the inverter that loses or corrupts answers: no wrong value, speed held or a safe stop.",
        ("benchmarks.modbus_noise",),
        ("benchmarks.modbus_noise",),
    ),
}


def section(name: str, promise: Promise, short: bool) -> tuple[str, bool]:
    """Run it; its part of the page, and whether it held."""
    command = promise.short if short else promise.command
    began, at = time.monotonic(), datetime.datetime.now(datetime.UTC)
    printed = deque[str](maxlen=_LAST_LINES)
    with subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", *command],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as ran:
        assert ran.stdout is not None
        for line in ran.stdout:
            print(line, end="", flush=True)
            if tempfile.gettempdir() not in line:  # a folder of this machine that is gone by then
                printed.append(line.rstrip())
    verdict = "held" if ran.returncode == 0 else "NOT HELD"
    head = f"## {name.capitalize()}: {verdict}\n\n{promise.words}\n"
    spent = f"{at:%Y-%m-%d %H:%M} UTC, {time.monotonic() - began:.0f} s, `python -m {shlex.join(command)}`;"
    print(f"{name}: {verdict} ({time.monotonic() - began:.0f} s)", flush=True)
    return "\n".join(
        [head, spent, f"{machine()}.", "", *(f"    {line}" for line in printed), ""]
    ), ran.returncode == 0


def machine() -> str:
    """Processor, cores, system and Python, and which version of the program it was."""
    model = "unknown processor"
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        lines = (
            line.split(":", 1)[1].strip() for line in cpu.read_text().splitlines() if "model name" in line
        )
        model = next(lines, model)
    commit = commit_of(ROOT, besides=PAGE)
    system = f"{platform.system()} {platform.release().split('-')[0]}"
    python = platform.python_version()
    return f"{model}, {os.cpu_count()} cores, {system}, Python {python}; program at {commit or 'no commit'}"


def write_page(sections: Mapping[str, str]) -> None:
    """Put these into the page, by their names in lower case; its others stay."""
    every = {**sections_of(PAGE), **sections}
    PAGE.write_text("\n".join([_HEAD, *every.values()]), encoding="utf-8")


def sections_of(page: Path) -> dict[str, str]:
    """What stands in a page, by the words before the colon of each heading."""
    parts = page.read_text(encoding="utf-8").split("\n## ")[1:] if page.exists() else []
    return {part.split(":")[0].lower(): f"## {part}" for part in parts}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=ALL, help="these")
    parser.add_argument("--short", action="store_true", help="few of each, and no page")
    arguments = parser.parse_args()
    chosen = arguments.only or list(ALL)
    sections, held = zip(*(section(name, ALL[name], arguments.short) for name in chosen), strict=True)
    if arguments.short:
        print("\n".join(sections))
    else:
        write_page(dict(zip(map(str.lower, chosen), sections, strict=True)))
    return int(not all(held))


if __name__ == "__main__":
    raise SystemExit(main())
