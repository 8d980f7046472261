"""Runs `rattle diagnose` on campaigns, one at a time, each as a user would."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.blind.calibration import logs_of, model_of, references
from benchmarks.blind.command import rattle
from benchmarks.blind.sets import RIGS
from benchmarks.kept_results import TRUTHS, made_by

_HANGS_ON = (
    "rig.commands.diagnose",
    "rig.rigs",
    "sim_twin.rigs",
    "rig.files",
    "benchmarks.blind.gap",
    *TRUTHS,
)
"""Modules, with what they import; some are imported by name."""
_BESIDE = tuple(f"rig/rigs/{rig}.toml" for rig in RIGS)
_LONGEST_S = 3600.0
"""A diagnosis that hangs is stopped; load by others alone makes no miss."""
CALIBRATED = "_calibrated"
NO_MODEL = 1000
"""In place of an exit code where there was no model to diagnose by."""


@dataclass(frozen=True, slots=True)
class Cost:
    """How a diagnosis went, and what was run.

    Wall and processor time in s, exit code (None: stopped), most memory of all its processes in MB; its
    budget in s (None: the usual) and effort.
    """

    wall_s: float
    exit_code: int | None
    budget_s: float | None
    effort: float
    seed: int
    runs: int
    program_sha256: str
    cpu_s: float = 0.0
    memory_mb: float = 0.0


def diagnose_all(
    folder: Path, names: Sequence[str], budget_s: float | None = None, effort: float = 1.0
) -> None:
    """Diagnose campaigns that have not been yet; they are known by their logs alone.

    Those with healthy runs to calibrate by are diagnosed without and with these.
    """
    healthy = references(folder)
    looks = [(name, look) for name in names for look in ("", *([CALIBRATED] if name in healthy else []))]
    todo = [(name, look) for name, look in looks if cost_of(folder, name + look) is None]
    for number, (name, look) in enumerate(todo):
        if not logs_of(folder, name):
            raise SystemExit(f"{name} has not been recorded; make it first")
        model = model_of(folder, healthy[name], effort) if look else None
        if look and model is None:
            cost = Cost(0.0, NO_MODEL, budget_s, effort, int(name[1:]), 0, program_digest())
            _keep(folder, name + look, cost)
        else:
            cost = _diagnose(folder, name, look, model, budget_s, effort)
        state = "" if cost.exit_code == 0 else f"  FAILED (exit code {cost.exit_code})"
        print(
            f"{name}{look}: {cost.wall_s:.0f} s for {cost.runs} runs, {len(todo) - number - 1} to go{state}",
            flush=True,
        )


def cost_of(folder: Path, name: str) -> Cost | None:
    """How a diagnosis went; None if there is none yet."""
    file = _out(folder, name) / "cost.json"
    return Cost(**json.loads(file.read_text())) if file.exists() else None


def was_stopped(folder: Path, name: str) -> bool:
    """Whether a diagnosis ended by a signal, as for want of memory."""
    cost = cost_of(folder, name)
    return cost is not None and cost.exit_code is not None and cost.exit_code < 0


def forget(folder: Path, name: str) -> None:
    """Have a diagnosis done anew."""
    shutil.rmtree(_out(folder, name), ignore_errors=True)


def diagnosis_file(folder: Path, name: str) -> Path:
    """Where a diagnosis lies."""
    return _out(folder, name) / "diagnosis.json"


def effects_file(folder: Path, name: str) -> Path:
    """Where the effects that it selected lie."""
    return _out(folder, name) / "effects.json"


def program_digest() -> str:
    """Of all that an answer, and what it is held against, hang on, so that a change between two shows."""
    return made_by(_HANGS_ON, _BESIDE)


def _out(folder: Path, name: str) -> Path:
    return folder / "diagnoses" / name


def _keep(folder: Path, name: str, cost: Cost) -> None:
    out = _out(folder, name)
    out.mkdir(parents=True, exist_ok=True)
    (out / "cost.json").write_text(json.dumps(asdict(cost)))


def _diagnose(
    folder: Path, name: str, look: str, model: Path | None, budget_s: float | None, effort: float
) -> Cost:
    out, logs, seed = _out(folder, name + look), logs_of(folder, name), int(name[1:])
    out.mkdir(parents=True, exist_ok=True)
    command = ["diagnose", *map(str, logs), "--out", str(out), "--seed", str(seed)]
    command += [] if budget_s is None else ["--budget", f"{budget_s:g}"]
    command += [] if effort == 1.0 else ["--effort", f"{effort:g}"]
    command += [] if model is None else ["--model", str(model)]
    digest = program_digest()
    spent = rattle(command, out / "output.txt", _LONGEST_S)
    cost = Cost(
        spent.wall_s, spent.exit_code, budget_s, effort, seed, len(logs), digest, spent.cpu_s, spent.memory_mb
    )
    _keep(folder, name + look, cost)
    return cost
