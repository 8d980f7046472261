"""Runs of the real command, recorded once for all tests that look at them."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from drivers.emulator_process import EmulatedInstrument
from rig.twin.alignment import Alignment
from rig.twin.plant import ShakenPlant
from rig.twin.plant import compiled as compiled_plant
from rig.twin.prediction import AlignedTwin
from sim_twin.rigs.impact_beam.model import SineDrive, nominal
from sim_twin.rigs.impact_beam.rig import nominal_sensors
from sim_twin.twin import Twin
from tests.end_to_end.command import Ended, command, rattle
from tests.end_to_end.files import write_bench, write_scenario
from tests.end_to_end.spied_bench import DriveSpy, light_card, spied_generator

HIDDEN_GAIN = 1.5
HIDDEN = [{"name": "sensor_gain", "parameters": {"channel": "yoke.force", "gain": HIDDEN_GAIN}}]


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """Fill the compiler's cache once, before anybody waits with a deadline: a minute in a fresh clone."""
    rig = nominal()
    twin = Twin(rig, SineDrive(9.0, 20.0), nominal_sensors(rig))
    compiled_plant(ShakenPlant, twin, 3.6, 1, 1, True).advance(512)
    AlignedTwin(twin, Alignment(20.0, 0.0), 51_200.0, settle_s=0.0).advance(512)


@pytest.fixture(scope="session")
def recorded_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ended]:
    """Two runs on the emulated bench, at the same time.

    `settled` lasts 6 s after a soft start, on whatever rig the day brings; `rest 7` begins from rest on a rig
    that anybody can have again.
    """
    folder = tmp_path_factory.mktemp("recorded")
    settled = write_scenario(folder / "settled.toml", settle_s=1.0, duration_s=6.0)
    rest = write_scenario(folder / "rest.toml", settle_s=0.0, duration_s=0.4)
    bench = write_bench(folder / "bench.toml", emulation="[emulation]\nseed = 7")
    with ExitStack() as stack:
        started = {
            "settled": stack.enter_context(command("run", settled, "--out", folder / "settled")),
            "rest 7": stack.enter_context(command("run", rest, "--bench", bench, "--out", folder / "rest")),
        }
        ended = {name: each.end() for name, each in started.items()}
    assert {name: (each.code, each.err) for name, each in ended.items()} == dict.fromkeys(ended, (0, ""))
    return ended


@pytest.fixture(scope="session")
def settled_run(recorded_runs: dict[str, Ended]) -> Ended:
    return recorded_runs["settled"]


@pytest.fixture(scope="session")
def settled_log(settled_run: Ended) -> Path:
    return settled_run.log


@pytest.fixture(scope="session")
def hidden_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run from rest on another rig, whose yoke sensor gives half as much again."""
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "hidden.json").write_text(json.dumps(HIDDEN))
    bench = write_bench(folder / "bench.toml", emulation='[emulation]\nseed = 8\neffects = "hidden.json"')
    scenario = write_scenario(folder / "scenario.toml", settle_s=0.0, duration_s=0.4)
    ended = rattle("run", scenario, "--bench", bench, "--out", folder)
    assert ended.code == 0, ended.err
    return ended.log


@pytest.fixture(params=["rest 7", pytest.param("hidden 8", marks=pytest.mark.long)])
def rest_log(request: pytest.FixtureRequest) -> Path:
    """A run from rest on each of two emulated rigs."""
    if request.param == "hidden 8":
        return Path(request.getfixturevalue("hidden_log"))
    return request.getfixturevalue("recorded_runs")["rest 7"].log  # type: ignore[no-any-return]


@pytest.fixture(scope="session")
def shared_card() -> Iterator[tuple[EmulatedInstrument, Connection]]:
    """A card for all tests that leave it alive."""
    with light_card() as card:
        yield card


@dataclass(frozen=True, slots=True)
class SpiedBench:
    """A bench file of real instruments, the instruments, and what the shaker heard."""

    file: Path
    generator: EmulatedInstrument
    card: EmulatedInstrument
    spy: DriveSpy


@pytest.fixture
def bench(tmp_path: Path, shared_card: tuple[EmulatedInstrument, Connection]) -> Iterator[SpiedBench]:
    card, onward = shared_card
    with spied_generator(onward) as (generator, spy):
        file = write_bench(tmp_path / "bench.toml", generator.address, card.address)
        yield SpiedBench(file, generator, card, spy)


@pytest.fixture
def mortal_bench(tmp_path: Path) -> Iterator[SpiedBench]:
    """The same with a card of its own, that the test may kill or freeze."""
    with light_card() as (card, onward), spied_generator(onward) as (generator, spy):
        file = write_bench(tmp_path / "bench.toml", generator.address, card.address)
        yield SpiedBench(file, generator, card, spy)


@pytest.fixture
def freeze() -> Iterator[Callable[[int], None]]:
    """Stops a process and lets it go on at the end of the test."""
    frozen: list[int] = []

    def stop(pid: int) -> None:
        os.kill(pid, signal.SIGSTOP)
        frozen.append(pid)

    yield stop
    for pid in frozen:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)
