"""A process loads what it needs: the command line, and each of the processes that a run starts."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

import pytest

from benchmarks.start import HEAVY, OURS, RATTLE, WATCHED
from daq.clock import SystemClock
from drivers.scpi.emulator.process import start_function_generator
from drivers.scpi.generator import GeneratorSettings, ScpiGenerator
from rig.commands.cli import COMMANDS
from rig.derived.derivation import DerivationProcess
from rig.emulated_rig import drawn_rig
from rig.emulation import Heard, card
from rig.files.bench import embedded_bench
from rig.files.scenario import load_scenario
from rig.session.supervisor import Supervisor
from rig.session.twin_feed import TwinFeed
from rig.twin.scenario_twin import predicted_channels, twin_of

ROOT = Path(__file__).parents[2]
SCENARIO = ROOT / "scenarios" / "impact_beam.toml"
MOST_OF_SCIPY = ("scipy.signal", "scipy.stats", "scipy.interpolate", "scipy.optimize")
"""Each of these loads most of the others: half a second of processor time."""
Imported = Callable[[], set[str]]


@pytest.fixture
def imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Imported:
    """What processes that are started from now on have imported."""
    notes = tmp_path / "notes"
    (tmp_path / "sitecustomize.py").write_text(WATCHED.format(notes=str(notes)))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return lambda: {line.partition(" ")[2] for line in notes.read_text().splitlines()}


def ours(modules: set[str]) -> set[str]:
    return {module for module in modules if module.partition(".")[0] in OURS}


def named(modules: set[str], *parts: str) -> list[str]:
    return [module for module in ours(modules) if any(part in module for part in parts)]


def heavy(modules: set[str]) -> set[str]:
    return modules & set(HEAVY)


@pytest.mark.parametrize("command", [name for name, _, _ in COMMANDS if name != "reproduce"])
def test_the_help_of_a_command_loads_nothing_that_works(command: str, imported: Imported) -> None:
    subprocess.run([*RATTLE, command, "--help"], cwd=ROOT, check=True, capture_output=True)  # noqa: S603
    assert heavy(imported()) <= {"pydantic"}  # by typer, for what has parameters
    assert len(ours(imported())) < 20


def test_the_list_of_commands_loads_no_command(imported: Imported) -> None:
    told = subprocess.run([*RATTLE, "--help"], cwd=ROOT, check=True, capture_output=True, text=True).stdout  # noqa: S603
    assert all(f" {name} " in told for name, _, _ in COMMANDS)
    assert not heavy(imported())
    assert not {where.partition(":")[0] for _, where, _ in COMMANDS} & imported()


def test_no_thread_of_linear_algebra_spins_beside_an_acquisition(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor in a process that it starts, which inherits it."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    pools = "[print(pool['num_threads']) for pool in threadpoolctl.threadpool_info()]"
    begin = (
        "import rig.commands.cli; rig.commands.cli.main = lambda: None; import rig.start; rig.start.main()"
    )
    code = f"{begin}; import numpy, scipy.linalg, threadpoolctl; {pools}"
    told = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)  # noqa: S603
    assert set(told.stdout.split()) == {"1"}


@pytest.mark.parametrize("where", [where for _, where, _ in COMMANDS])
def test_each_command_is_where_the_table_says(where: str) -> None:
    assert callable(resolve_name(where))


def test_a_check_compiles_nothing_and_shows_nothing(imported: Imported) -> None:
    subprocess.run([*RATTLE, "check", str(SCENARIO)], check=True, capture_output=True)  # noqa: S603
    assert heavy(imported()) == {"numpy", "scipy", "pydantic"}
    assert not {*MOST_OF_SCIPY, "pint", "skfem"} & imported()
    assert not named(imported(), "slider_crank.model")


def test_what_drives_a_run_loads_no_report(imported: Imported) -> None:
    before_the_rig_moves = "import rig.app, rig.commands.run, rig.session.run, rig.session.drive"
    subprocess.run([sys.executable, "-c", before_the_rig_moves], cwd=ROOT, check=True)  # noqa: S603
    assert heavy(imported()) == {"numpy", "scipy", "pydantic"}
    assert not {*MOST_OF_SCIPY, "pint", "jinja2"} & imported()
    assert not named(imported(), "rig.report", "diagnosis", "slider_crank")


def test_the_supervisor_is_small_with_the_driver_that_it_may_need(imported: Imported) -> None:
    supervisor = Supervisor(partial(ScpiGenerator, GeneratorSettings("TCPIP::127.0.0.1::1::SOCKET", 5.0)))
    supervisor.launch()
    with supervisor:
        supervisor.beat()
    # It has loaded what a spare connection takes before anything moves; VISA brings numpy along.
    assert {"pyvisa", "pyvisa_py"} <= imported()
    assert heavy(imported()) <= {"numpy"}
    assert len(ours(imported())) <= 30


def test_the_emulated_generator_is_small(imported: Imported) -> None:
    with start_function_generator():
        pass
    assert not heavy(imported())
    assert len(ours(imported())) <= 30


def test_the_emulated_card_filters_by_itself(imported: Imported) -> None:
    scenario, bench = load_scenario(SCENARIO), embedded_bench("impact_beam")
    rig = drawn_rig(scenario, bench, 0, 1)
    heard = Heard(None, rig.scenario_output)
    with card(bench, rig, 0, heard):
        pass
    assert {"numba", "scipy"} <= imported()
    assert not {"rerun", "plotly", "pydantic", "pint", *MOST_OF_SCIPY} & imported()


def test_the_twins_process_shows_and_diagnoses_nothing(imported: Imported) -> None:
    scenario = load_scenario(SCENARIO)
    feed = TwinFeed(
        twin_of(scenario), ["drive.force"], 51_200.0, 1.0, print, lambda *_: None, lambda _: None, ""
    )
    with feed.worker as worker:
        worker.wait_ready()
    assert {"numba", "scipy"} <= imported()
    assert not {"rerun", "plotly", "grpc", "pydantic", "pint", "mcap", *MOST_OF_SCIPY} & imported()
    assert not [
        module for module in ours(imported()) if "diagnosis" in module or "slider_crank.kernel" in module
    ]


def test_the_derivations_process_has_no_twin_in_motion(imported: Imported) -> None:
    scenario = load_scenario(SCENARIO)
    names = tuple(channel.name for channel in predicted_channels(twin_of(scenario)))
    derivation = DerivationProcess({"measured": names}, scenario, SystemClock(), print)
    with derivation.worker:
        derivation.wait_ready(lambda: None)
        derivation.finish(print)
    assert "rig.derived.derivation" in imported()
    assert not {"rerun", "plotly", "grpc", "pint", *MOST_OF_SCIPY} & imported()
    assert not [
        module
        for module in ours(imported())
        if module.endswith((".truth", ".kernel")) or "diagnosis" in module
    ]


def test_what_the_tests_call_heavy_is_what_would_be_found(imported: Imported) -> None:
    subprocess.run([sys.executable, "-c", "import numpy"], check=True)
    assert heavy(imported()) == {"numpy"}
