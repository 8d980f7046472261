"""What faulty files are told, word for word: every file of `golden` is cases of an input and its message.

A case begins with `=== name`, its message with `--- told`. To record messages anew after a change that is
meant, run with RATTLE_RECORD_GOLDEN=1 and read the difference.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from daq.errors import ConfigurationError
from rig.commands.check import load_any
from rig.files.bench import embedded_bench, load_bench
from rig.files.model_file import load_model
from rig.files.pairing import check_bench, check_pair, check_scenario
from rig.files.scenario import load_scenario, parse_scenario
from rig.files.sweep import load_sweep
from rig.sweep.plan import check_points
from rig.twin.scenario_twin import check_twin, twin_of, with_effects

GOLDEN = Path(__file__).parent / "golden"
TODAY = datetime.date(2026, 11, 1)
RECORDS = os.environ.get("RATTLE_RECORD_GOLDEN") == "1"
BEAM = """
rig = "impact_beam"
[drive]
frequency = "20 Hz"
[acquisition]
sample_rate = "51.2 kHz"
duration = "1 s"
"""
CRANK = BEAM.replace("impact_beam", "planar_slider_crank").replace('frequency = "20 Hz"', 'speed = "200 rpm"')
SPATIAL = CRANK.replace("planar", "spatial")
SCENARIOS = {"impact_beam": BEAM, "planar_slider_crank": CRANK, "spatial_slider_crank": SPATIAL}


def _scenario(path: Path, _: str) -> None:
    scenario = load_scenario(path)
    for check in (lambda: check_scenario(scenario, path.name), lambda: check_twin(scenario)):
        check()


def _bench(path: Path, name: str) -> None:
    rig = next((rig for rig in SCENARIOS if name.startswith(rig)), None)
    check_bench(load_bench(path, rig), TODAY)


def _sweep(path: Path, _: str) -> None:
    path.with_name("beam.toml").write_text(BEAM)
    check_points(load_sweep(path), None, TODAY)


def _effects(path: Path, name: str) -> None:
    rig = next(rig for rig in SCENARIOS if name.startswith(rig))
    with_effects(twin_of(parse_scenario(SCENARIOS[rig])), path)


def _model(path: Path, _: str) -> None:
    load_model(path, "impact_beam")


def _pair(path: Path, _: str) -> None:
    """A scenario, and after a line of five hashes a bench; none: the emulated one."""
    scenario_text, _, bench_text = path.read_text().partition("#####\n")
    path.write_text(scenario_text)
    scenario = load_scenario(path)
    bench = embedded_bench(scenario.rig)
    if bench_text:
        path.with_name("bench.toml").write_text(bench_text)
        bench = load_bench("bench.toml", scenario.rig)
    check_pair(scenario, bench, TODAY)


def _any(path: Path, _: str) -> None:
    load_any(path)


READERS: dict[str, tuple[str, Callable[[Path, str], None]]] = {
    "any": ("file.toml", _any),
    "bench": ("bench.toml", _bench),
    "effects": ("effects.json", _effects),
    "model": ("model.toml", _model),
    "pair": ("scenario.toml", _pair),
    "scenario": ("scenario.toml", _scenario),
    "sweep": ("sweep.toml", _sweep),
}


def _cases() -> Iterator[tuple[str, str, str, str]]:
    for kind in READERS:
        text = (GOLDEN / f"{kind}.txt").read_text(encoding="utf-8")
        for case in text.split("=== ")[1:]:
            name, _, rest = case.partition("\n")
            given, _, told = rest.partition("--- told\n")
            yield kind, name, given, told


CASES = list(_cases())


def _told(kind: str, name: str, given: str) -> str:
    file, read = READERS[kind]
    Path(file).write_text(given, encoding="utf-8")
    try:
        read(Path(file), name)
    except ConfigurationError as error:
        return f"{error}\n"
    return "(nothing)\n"


@pytest.mark.parametrize(("kind", "name", "given", "told"), CASES, ids=[f"{c[0]}: {c[1]}" for c in CASES])
def test_a_faulty_file_is_told_all_its_faults_in_these_words(
    kind: str, name: str, given: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # long values are shortened in a message: a folder whose name has the same length everywhere
    with TemporaryDirectory(prefix="rattle", dir="/tmp") as folder:
        monkeypatch.chdir(folder)
        said = _told(kind, name, given).replace(folder, "HERE")
        monkeypatch.undo()
    if RECORDS:
        golden = GOLDEN / f"{kind}.txt"
        head = f"=== {name}\n{given}--- told\n"
        before = golden.read_text(encoding="utf-8")
        golden.write_text(before.replace(head + told, head + said), encoding="utf-8")
        return
    assert said == told


def test_there_are_enough_of_them() -> None:
    assert len(CASES) >= 60
    assert all(told != "(nothing)\n" for *_, told in CASES)
