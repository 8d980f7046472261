"""Runs `rattle diagnose` on every campaign, one at a time, each as a user would."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.blind.make import logs_of

ROOT = Path(__file__).parents[2]
_PROGRAM = ("sim_twin", "rig", "daq")
_TIMES_BUDGET, _START_S = 4.0, 240.0
"""A diagnosis that takes longer than both together is stopped; compiling and the report are in it."""


@dataclass(frozen=True, slots=True)
class Cost:
    """How a diagnosis went: wall time in s, exit code (None: stopped), and what was run."""

    wall_s: float
    exit_code: int | None
    budget_s: float
    seed: int
    runs: int
    program_sha256: str


def diagnose_all(folder: Path, budget_s: float, names: Sequence[str] = ()) -> None:
    """Diagnose the campaigns (all, or `names`) that have not been yet; they are known by their logs alone."""
    wanted = sorted(names or (path.name for path in (folder / "logs").iterdir()))
    todo = [name for name in wanted if cost_of(folder, name) is None]
    for number, name in enumerate(todo):
        cost = _diagnose(folder, name, budget_s)
        state = "" if cost.exit_code == 0 else f"  FAILED (exit code {cost.exit_code})"
        print(
            f"{name}: {cost.wall_s:.0f} s for {cost.runs} runs, {len(todo) - number - 1} to go{state}",
            flush=True,
        )


def cost_of(folder: Path, name: str) -> Cost | None:
    """How the diagnosis of a campaign went; None if there is none yet."""
    file = _out(folder, name) / "cost.json"
    return Cost(**json.loads(file.read_text())) if file.exists() else None


def diagnosis_file(folder: Path, name: str) -> Path:
    """Where a diagnosis lies."""
    return _out(folder, name) / "diagnosis.json"


def effects_file(folder: Path, name: str) -> Path:
    """Where the effects that it selected lie."""
    return _out(folder, name) / "effects.json"


def program_digest() -> str:
    """SHA-256 over the program's source, so that a change between two diagnoses shows."""
    total = hashlib.sha256()
    for file in sorted(each for part in _PROGRAM for each in (ROOT / part).rglob("*.py")):
        total.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return total.hexdigest()


def _out(folder: Path, name: str) -> Path:
    return folder / "diagnoses" / name


def _diagnose(folder: Path, name: str, budget_s: float) -> Cost:
    out, logs = _out(folder, name), logs_of(folder, name)
    out.mkdir(parents=True, exist_ok=True)
    seed = int(name[1:])
    command = [sys.executable, "-m", "rig.start", "diagnose", *map(str, logs), "--out", str(out)]
    command += ["--seed", str(seed), "--budget", f"{budget_s:g}"]
    began, digest = time.monotonic(), program_digest()
    exit_code = _run(command, out / "output.txt", _TIMES_BUDGET * budget_s + _START_S)
    cost = Cost(time.monotonic() - began, exit_code, budget_s, seed, len(logs), digest)
    (out / "cost.json").write_text(json.dumps(asdict(cost)))
    return cost


def _run(command: Sequence[str], output: Path, limit_s: float) -> int | None:
    """Exit code; None where it was stopped, with all that it had started."""
    with output.open("w") as text:
        process = subprocess.Popen(  # noqa: S603 - our own
            command,
            cwd=ROOT,
            stdout=text,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "RATTLE_SIMULATED": "0"},  # its cost is a first look's
        )
        try:
            return process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
