"""Every decoder under a fuzzer that is led by what it covers of ours, into docs/reliability.md.

Nothing but rattle's own errors may leave a decoder, and no input may take more than 256 MiB beyond what was
there before, or 1 s of a core for each MiB begun. All are short: a long one may take 256 times its size more,
for a recording may hold as much. An input that does is kept in tests/fuzz/corpus, where the tests try it from
then on. Returns 1 if there is one. Others that lead further are kept in .fuzz/TARGET, from which later calls
go on.

Usage: scripts/fuzz [TARGET ...] [--runs N] [--seconds S] [--jobs N]
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import subprocess
import sys
import tempfile
import textwrap
import time
import traceback
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.soak import PAGE, ROOT, sections_of, write_page

_RUNS = 1_000_000
_FOUND = ROOT / ".fuzz"
_MOST_MB = 1024
"""Of the whole process: there libFuzzer ends it, where the bound of one input has not."""
_LONGEST_S = 30
_OURS = ("daq", "drivers", "rig")
_SECTION = "Odd inputs"
_PROMISE = """\
Whatever a file, a log, a frame, an answer or a request holds: nothing but an error of rattle's own comes of
it, and it takes at most 256 MiB and 256 times its size more than was there before, and 1 s of a core for each
MiB begun. By `scripts/fuzz`, with inputs of 16 KiB at most, which may take 256 MiB; a million are tried of
each target, of other programs' files together. `runs` and `s` are those of all its calls, each with inputs of
its own: each begins with what those before it found, which is counted once. `failures` are what still fails.
`MiB` is the most over all runs of a target, with what the fuzzer itself keeps, `s a MiB` the slowest input.
"""
_COLUMNS = f"    {'target':<10}{'runs':>10}{'s':>8}{'1/s':>7}{'MiB':>6}{'s a MiB':>9}{'failures':>10}"


def fuzz(name: str, runs: int, seconds: int, seed: int, told: Path) -> None:
    """Fuzz one target in this process, which ends with it; what came out is written to `told`."""
    import atheris

    with atheris.instrument_imports(include=_OURS):
        from tests.fuzz.targets import CORPUS, TARGETS, Spent

    target, kept = TARGETS[name], CORPUS / name
    found = _FOUND / name
    found.mkdir(parents=True, exist_ok=True)
    again = len(list(found.iterdir()))
    spent, places = Spent(name), dict[str, str]()
    begun, count = time.monotonic(), -again

    def one(data: bytes) -> None:
        nonlocal count
        count += 1
        try:
            spent.run(data)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            what = f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}"
            if what not in places:
                path = kept / f"crash-{hashlib.sha256(data).hexdigest()[:12]}"
                path.write_bytes(data)
                places[what] = f"{path.name}: {what}: {error}"
        if count % 100 == 0 or count == runs or count + again < 100:
            figures = {"runs": max(count, 0), "seconds": time.monotonic() - begun,
                       "slowest": spent.seconds_a_mib, "bytes": spent.more_bytes,
                       "failures": list(places.values())}  # fmt: skip
            told.write_text(json.dumps(figures))

    options = [f"-runs={runs + again}", f"-max_total_time={seconds}", f"-max_len={target.longest}",
               f"-seed={seed}", f"-rss_limit_mb={_MOST_MB}", f"-timeout={_LONGEST_S}",
               f"-artifact_prefix={kept}/", "-report_slow_units=1000", "-verbosity=0",
               "-print_final_stats=1"]  # fmt: skip
    atheris.Setup([sys.argv[0], *options, str(found), str(kept)], one)
    atheris.Fuzz()


def figures(name: str, runs: int, seconds: int, seed: int) -> dict[str, Any]:
    """What came out of a target, fuzzed in a process of its own."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "figures.json"
        command = [sys.executable, "-m", "benchmarks.fuzz", name, "--child", str(told)]
        ran = subprocess.run(  # noqa: S603
            [*command, "--runs", str(runs), "--seconds", str(seconds), "--seed", str(seed)],
            capture_output=True,
            check=False,
            text=True,
        )
        came: dict[str, Any] = {"runs": 0, "seconds": time.monotonic() - begun, "slowest": 0.0, "bytes": 0,
                                "failures": []}  # fmt: skip
        if told.exists():  # else it ended with the first that it tried
            came = json.loads(told.read_text())
    if ran.returncode:
        came["failures"].append(f"ended with {ran.returncode}: {ran.stderr[-2000:]}")
    return came


def side_by_side(name: str, runs: int, seconds: int, seed: int, jobs: int) -> dict[str, Any]:
    """What came out of `jobs` processes, each with its share of the runs."""
    with ThreadPoolExecutor(jobs) as pool:
        every = list(pool.map(lambda job: figures(name, runs // jobs, seconds, seed + job), range(jobs)))
    return {
        "runs": sum(each["runs"] for each in every),
        "seconds": sum(each["seconds"] for each in every),
        "bytes": max(each["bytes"] for each in every),
        "slowest": max(each["slowest"] for each in every),
        "failures": [failure for each in every for failure in each["failures"]],
    }


def row(name: str, came: dict[str, Any]) -> str:
    """A line of the table."""
    runs, seconds = came["runs"], came["seconds"]
    return (
        f"    {name:<10}{runs:>10}{seconds:>8.0f}{runs / seconds:>7.0f}{came['bytes'] >> 20:>6}"
        f"{came['slowest']:>9.3f}{len(came['failures']):>10}  {datetime.datetime.now(datetime.UTC):%Y-%m-%d}"
    )


def rows_written() -> dict[str, str]:
    """The page's line of each target."""
    lines = sections_of(PAGE).get(_SECTION.lower(), "").splitlines()
    return {line.split()[0]: line for line in lines if line.startswith("    ") and line != _COLUMNS}


def added(came: dict[str, Any], line: str) -> dict[str, Any]:
    """What came out of this call and of those before it, which the page's line tells."""
    if not line:
        return came
    _, runs, seconds, _, mib, slowest, *_ = line.split()
    return {
        "runs": came["runs"] + int(runs),
        "seconds": came["seconds"] + float(seconds),
        "bytes": max(came["bytes"], int(mib) << 20),
        "slowest": max(came["slowest"], float(slowest)),
        "failures": came["failures"],
    }


def write_row(name: str, line: str) -> None:
    """Put it into the page; those of other targets stay."""
    every = rows_written() | {name: line}
    write_page({_SECTION.lower(): "\n".join([head(every), _COLUMNS, *every.values(), ""])})


def head(every: Mapping[str, str]) -> str:
    """What the lines of all targets come to: a promise that held, did not, or was tried too little to say."""
    from tests.fuzz.targets import IMPORTED, TARGETS

    runs = {name: int(every[name].split()[1]) if name in every else 0 for name in TARGETS}
    if sum(runs[name] for name in IMPORTED) >= _RUNS:
        runs |= dict.fromkeys(IMPORTED, _RUNS)
    fewer = [f"{name} {count}" for name, count in runs.items() if count < _RUNS]
    held = all(line.split()[-2] == "0" for line in every.values())
    words = "NOT HELD" if not held else "held so far" if fewer else "held"
    few = textwrap.fill(f"Fewer than a million so far: {', '.join(fewer)}.", 110)
    told = f"\n{few}\n" if fewer else ""
    return f"## {_SECTION}: {words}\n\n{_PROMISE}{told}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET")
    parser.add_argument("--runs", type=int, default=_RUNS, help="of each target")
    parser.add_argument("--seconds", type=int, default=0, help="of each target at most")
    parser.add_argument("--jobs", type=int, default=1, help="processes for each target")
    parser.add_argument("--seed", type=int, default=1, help=argparse.SUPPRESS)
    parser.add_argument("--child", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        fuzz(arguments.targets[0], arguments.runs, arguments.seconds, arguments.seed, arguments.child)
    from tests.fuzz.targets import TARGETS

    unknown = set(arguments.targets) - TARGETS.keys()
    if unknown:
        parser.error(f"{', '.join(unknown)}: none of {', '.join(TARGETS)}")
    print(_COLUMNS, flush=True)
    failed = 0
    for name in arguments.targets or TARGETS:
        before = rows_written().get(name, "")
        seed = 1 + int(before.split()[1]) if before else 1
        came = side_by_side(name, arguments.runs, arguments.seconds, seed, arguments.jobs)
        failed += len(came["failures"])
        print(row(name, came), *came["failures"], sep="\n        ", flush=True)
        write_row(name, row(name, added(came, before)))
    return int(failed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
