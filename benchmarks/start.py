"""How soon the commands are there, what each process imports, and what a run costs before its first sample.

Processor time is that of the run and of every process that it started, those that have ended included, at the
time that the log gives for the first sample measured: user and system, warm caches.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import psutil

from daq.log.reader import LogReader

ROOT = Path(__file__).parents[1]
RATTLE = (sys.executable, "-m", "rig.start")
OURS = ("daq", "drivers", "sim_twin", "rig")
HEAVY = ("numpy", "scipy", "numba", "rerun", "pydantic", "plotly", "grpc")
BARS = {"rattle --help": 0.4, "ratio": 1.5, "rattle check": 1.0, "import rattle": 0.3, "first sample": 5.5}
_EVERY_S = 0.02

TWO_COMMANDS = """\
import typer
app = typer.Typer(
    help="Two commands.", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)

@app.command()
def one(name: str) -> None:
    "The first."

@app.command()
def two(name: str) -> None:
    "The second."

app()
"""

WATCHED = """\
import os, sys
def _note(event, arguments, to=os.open({notes!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)):
    if event == "import":
        os.write(to, f"{{os.getpid()}} {{arguments[0]}}\\n".encode())
sys.addaudithook(_note)
"""
"""As sitecustomize: every process that starts writes down what it imports."""


@dataclass(slots=True)
class Process:
    """One process of a run: what it is called and what it imported."""

    name: str = ""
    modules: list[str] = field(default_factory=list)

    @property
    def ours(self) -> list[str]:
        return [name for name in self.modules if name.partition(".")[0] in OURS]

    @property
    def heavy(self) -> list[str]:
        return [name for name in HEAVY if name in self.modules]


def main() -> int:
    arguments = _arguments()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # caches that are warm hold our own modules too
    scenario = ROOT / "scenarios" / f"{arguments.rig}.toml"
    with tempfile.TemporaryDirectory() as folder:
        app = Path(folder) / "app.py"
        app.write_text(TWO_COMMANDS)
        commands = {
            "two commands --help": (sys.executable, str(app), "--help"),
            "rattle --help": (*RATTLE, "--help"),
            "rattle check": (*RATTLE, "check", str(scenario)),
            "import rattle": (sys.executable, "-c", "import rattle"),
        }
        medians = _alternated(commands, arguments.repetitions)
        for name, (wall_s, processor_s) in medians.items():
            bar = f" (bar {BARS[name]})" if name in BARS else ""
            print(f"{name:<22} {wall_s:.3f} s{bar}, {processor_s:.3f} s of processor")
        seconds = {name: wall_s for name, (wall_s, _) in medians.items()}
        ratio = seconds["rattle --help"] / seconds["two commands --help"]
        print(f"{'ratio of the helps':<22} {ratio:.2f} (bar {BARS['ratio']})")
        for process in (
            imported([*RATTLE, "--help"], Path(folder) / "help"),
            *_of_run(scenario, Path(folder)),
        ):
            packages = {
                name.partition(".")[0] for name in process.modules if name.partition(".")[0] not in OURS
            }
            told = f"{len(process.ours):4} of ours, {len(packages):4} other packages"
            print(f"{process.name:<22} {told}: {', '.join(process.heavy) or 'nothing heavy'}")
        costs = [cost_of_first_sample(scenario, Path(folder)) for _ in range(arguments.runs)]
    cost = statistics.median(costs) if costs else 0.0
    if costs:
        told = ", ".join(f"{each:.2f}" for each in costs)
        most = BARS["first sample"]
        print(f"{'before first sample':<22} {cost:.2f} s of processor (bar {most}; {told})")
    print(f"{'load':<22} {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    figures = {**seconds, "ratio": ratio, "first sample": cost}
    return 0 if all(figures[name] <= bar for name, bar in BARS.items()) else 1


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--rig", default="impact_beam")
    return parser.parse_args()


def _alternated(commands: dict[str, tuple[str, ...]], repetitions: int) -> dict[str, tuple[float, ...]]:
    """Medians of wall and processor time of each, in s, after one that warms up."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in commands}
    for _ in range(repetitions + 1):
        for name, command in commands.items():
            before, started = _of_children(), time.perf_counter()
            subprocess.run(command, check=True, capture_output=True, cwd=ROOT)  # noqa: S603 - our own
            taken[name].append((time.perf_counter() - started, _of_children() - before))
    return {
        name: tuple(statistics.median(one) for one in zip(*each[1:], strict=True))
        for name, each in taken.items()
    }


def _of_children() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def imported(command: Sequence[str], notes: Path) -> Process:
    """What a command that starts no other process imports."""
    (process,) = _watched(command, notes).values()
    process.name = command[-1]
    return process


def _of_run(scenario: Path, folder: Path) -> list[Process]:
    processes = _watched([*RATTLE, "run", str(scenario), "--out", str(folder)], folder / "run").values()
    return [process for process in processes if process.ours]


def _watched(command: Sequence[str], notes: Path) -> dict[int, Process]:
    """All processes that a command comes to, by their ids."""
    customised = notes.with_suffix(".path")
    customised.mkdir()
    (customised / "sitecustomize.py").write_text(WATCHED.format(notes=str(notes)))
    found: dict[int, Process] = {}
    with subprocess.Popen(  # noqa: S603 - our own
        command,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(customised)},
    ) as running:
        root = psutil.Process(running.pid)
        while running.poll() is None:
            for each in _tree(root):
                with suppress(psutil.Error):
                    found.setdefault(each.pid, Process()).name = _name(each, root)
            time.sleep(_EVERY_S)
    for line in notes.read_text().splitlines():
        pid, _, module = line.partition(" ")
        found.setdefault(int(pid), Process()).modules.append(module)
    assert running.returncode == 0
    return found


def _name(process: psutil.Process, root: psutil.Process) -> str:
    return "the command itself" if process == root else " ".join(process.cmdline()[-1:])[:22]


def cost_of_first_sample(scenario: Path, folder: Path) -> float:
    """Processor seconds of a run and all that it starts, until its first measured sample."""
    seen: list[tuple[int, float]] = []
    command = [*RATTLE, "run", str(scenario), "--out", str(folder)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as running:  # noqa: S603
        root = psutil.Process(running.pid)
        while running.poll() is None:
            seen.append((time.time_ns(), sum(_spent(each) for each in _tree(root))))
            time.sleep(_EVERY_S)
        assert running.stdout is not None
        told = running.stdout.read().split()
    with LogReader(Path(told[-1])) as log:  # also that of a run which a busy machine cut short
        first_ns = min(block.time_ns for _, block in log.blocks("measured"))
    for (before_ns, before), (after_ns, after) in pairwise(seen):
        if before_ns <= first_ns <= after_ns:
            return before + (after - before) * (first_ns - before_ns) / (after_ns - before_ns)
    raise AssertionError("the first sample was not within the run")


def _tree(root: psutil.Process) -> list[psutil.Process]:
    with suppress(psutil.Error):
        return [root, *root.children(recursive=True)]
    return []


def _spent(process: psutil.Process) -> float:
    with suppress(psutil.Error):
        times = process.cpu_times()
        return float(times.user + times.system + times.children_user + times.children_system)
    return 0.0


if __name__ == "__main__":
    sys.exit(main())
