"""`rattle ensemble`: the spread of healthy rigs, on worker processes and on a Dask cluster."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import psutil
import pytest

from rig.ensembles import Workers
from rig.files.scenario import load_scenario
from rig.twin.scenario_twin import twin_of
from sim_twin.ensembles.figures import Figures
from sim_twin.ensembles.population import Population
from sim_twin.ensembles.simulate import Outcome, simulate
from sim_twin.rigs.rig_model import RunFigures
from sim_twin.status import Status
from tests.rig.commands.cli import Call

SCENARIO = """\
rig = "impact_beam"
[drive]
frequency = "20 Hz"
amplitude = "{amplitude} N"
[acquisition]
sample_rate = "51.2 kHz"
settle = "0.02 s"
duration = "{duration} s"
"""
CLUSTER = (sys.executable, "-m", "tests.rig.ensembles.local_cluster")
RUNS = 20  # two pieces of work


def scenario(folder: Path, duration: float = 0.05, amplitude: float = 9) -> Path:
    path = folder / "scenario.toml"
    path.write_text(SCENARIO.format(duration=duration, amplitude=amplitude))
    return path


def rattle(*arguments: object) -> subprocess.Popen[str]:
    command = [str(Path(sys.executable).with_name("rattle")), "ensemble", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603


def first_word(line: str) -> str:
    return line.split()[0]


@contextmanager
def local_cluster() -> Iterator[str]:
    with subprocess.Popen(CLUSTER, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        assert process.stdin is not None
        yield process.stdout.readline().strip()
        process.stdin.close()


def computed_here(path: Path, seed: int) -> list[dict[str, float]]:
    wanted = load_scenario(path)
    variants = Population(twin_of(wanted), any_phase=False).variants(RUNS, seed)
    figures = Figures(wanted.acquisition.settle, wanted.acquisition.duration)
    return [dict(outcome.value.values) for outcome in simulate(variants, figures) if outcome.value]  # type: ignore[arg-type]


def read_rows(path: Path) -> list[dict[str, float]]:
    """The figures of each run; the text of a number in the file holds all its bits."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(int(row["run"]), row["status"]) for row in rows] == [(k, "completed") for k in range(RUNS)]
    return [{name: float(row[name]) for name in row if name not in ("run", "status")} for row in rows]


def test_the_table_and_the_rows_hold_the_figures_of_every_run(call: Call, tmp_path: Path) -> None:
    file, out = scenario(tmp_path), tmp_path / "runs.csv"
    answer = call("ensemble", file, "--runs", RUNS, "--seed", 3, "--workers", 1, "--json", "--out", out)
    assert answer.code == 0, answer.err
    expected, found = computed_here(file, 3), json.loads(answer.out)
    assert read_rows(out) == expected
    assert (found["runs"], found["seed"], found["failed"]) == (RUNS, 3, {})
    peaks = [row["first_peak_n"] for row in expected]
    assert found["figures"]["first_peak_n"] == {
        "runs": RUNS,
        "mean": np.mean(peaks),
        "deviation": np.std(peaks, ddof=1),
        "p5": np.percentile(peaks, 5),
        "median": np.median(peaks),
        "p95": np.percentile(peaks, 95),
    }


@pytest.mark.long
def test_a_cluster_gives_the_same_bits(tmp_path: Path) -> None:
    file, out = scenario(tmp_path), tmp_path / "runs.csv"
    with local_cluster() as address:
        assert address.startswith("tcp://127.0.0.1:")
        with rattle(file, "--runs", RUNS, "--seed", 3, "--scheduler", address, "--out", out) as process:
            text, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (0, "")
    assert read_rows(out) == computed_here(file, 3)
    assert "first_peak_n" in text


def test_ctrl_c_ends_it_with_130_and_leaves_no_process(tmp_path: Path) -> None:
    with rattle(scenario(tmp_path, 3000), "--runs", RUNS, "--workers", 2) as process:
        assert process.stdout is not None
        assert "simulating" in map(first_word, process.stdout)
        workers = psutil.Process(process.pid).children(recursive=True)
        assert len(workers) >= 2
        os.kill(process.pid, signal.SIGINT)
        _, error = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in error
    assert not psutil.wait_procs(workers, timeout=5)[1]


def test_workers_end_with_a_command_that_is_killed(tmp_path: Path) -> None:
    with rattle(scenario(tmp_path, 3000), "--runs", RUNS, "--workers", 1) as process:
        assert process.stdout is not None
        assert "simulating" in map(first_word, process.stdout)
        workers = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.communicate(timeout=30)
    assert not psutil.wait_procs(workers, timeout=5)[1]


def test_failed_runs_are_counted_with_advice_and_all_failed_is_an_error(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = (Outcome(Status.DIVERGED),) * 2
    good = (Outcome(Status.COMPLETED, RunFigures(Status.COMPLETED, {"first_peak_n": 20.0})),)
    arguments = ("ensemble", scenario(tmp_path), "--workers", 1)
    nobody = nullcontext(Workers(ThreadPoolExecutor(1), 1))
    monkeypatch.setattr("rig.ensembles.worker_processes", lambda count: nobody)
    monkeypatch.setattr("sim_twin.ensembles.simulate.simulate", lambda *_: failed + good)
    answer = call(*arguments)
    assert answer.code == 0
    assert "2 of 3 runs diverged: the motion left all bounds" in answer.out
    monkeypatch.setattr("sim_twin.ensembles.simulate.simulate", lambda *_: failed)
    answer = call(*arguments)
    assert answer.code == 1
    assert answer.err.startswith("rattle: 2 of 2 runs diverged: the motion left all bounds")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--scheduler", "nowhere"), 1, "nowhere is no address of a scheduler"),
        (("--scheduler", "tcp://127.0.0.1:8786", "--workers", "2"), 2, "the cluster has its own workers"),
    ],
)
def test_wrong_use_is_one_clear_line(
    call: Call, tmp_path: Path, arguments: tuple[str, ...], code: int, words: str
) -> None:
    answer = call("ensemble", scenario(tmp_path), *arguments)
    assert answer.code == code
    assert words in answer.err
    assert len(answer.err.splitlines()) == 1


@pytest.mark.long
def test_healthy_rigs_of_a_lab_are_those_of_its_model(call: Call, tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    head = 'rig = "impact_beam"\nruns = ["a.mcap"]\nscenarios = ["a"]\n\n[tolerances]\n'
    lab.write_text(head + 'contact_stiffness = "25 %"\n')
    asked = ("ensemble", scenario(tmp_path), "--runs", 4, "--json")
    told = [json.loads(call(*asked, *more).out) for more in ((), (), ("--model", lab))]
    assert told[0] == told[1] != told[2]
