"""What `rattle identify` writes is whole, and nothing where the runs tell nothing or are of no one rig."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.errors import RattleError
from rig.diagnosis import identify as work
from rig.diagnosis.identify import Identification, read_for, wide_of
from rig.diagnosis.one_rig import LOOKED_AT_FIRST, of_one_rig, require_alike
from rig.files.model_file import load_model
from rig.files.scenario import load_scenario, parse_scenario
from rig.rigs import RIGS
from rig.session.progress import Screen, Terminal
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.fingerprint import SLICES, Layout, of_cycles
from sim_twin.diagnosis.gap import gap_measure
from sim_twin.diagnosis.identification import Known, Round, nothing_known
from sim_twin.diagnosis.subject import Draw, Execute, Observed
from tests.rig.commands.cli import Call
from tests.rig.commands.test_calibrate import RATE, SCENARIO, full_disk
from tests.rig.commands.test_identify import CRANK, before_the_runs, crank, record

KEY = "contact_stiffness"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    return [record(folder / f"run{seed}.mcap", seed, begin_ns=seed) for seed in (3, 4)]


def known_to(deviation: float) -> Known:
    return replace(before_the_runs(KEY), covariance=deviation**2 * np.eye(1))


def search_at_once(
    monkeypatch: pytest.MonkeyPatch,
    known: Known,
    simulate: Execute | None = None,
    unrest: float = 0.0,
    apart: tuple[float, ...] = (),
) -> None:
    """A search that ends with what is `known`; what rigs with the values found show, `simulate` says."""
    last = Round(9, known, np.array([unrest]), np.array([unrest]), True, True, apart)
    monkeypatch.setattr(work, "worker_processes", lambda _: nullcontext(SimpleNamespace(executor=None)))
    monkeypatch.setattr(work, "require_moves", lambda *_: None)
    monkeypatch.setattr(work, "require_alike", lambda *_: None)
    monkeypatch.setattr(work, "fitted_rounds", lambda *_: [last])
    monkeypatch.setattr(work, "Simulated", lambda *_: simulate)


def rigs_about(runs: Sequence[Path], *off: float, responses: Sequence[Path] = ()) -> Execute:
    """Rigs off which each of the runs lies so many of their scatters, which hide that of its own blocks.

    Runs come in the order in which they were made.
    """
    read, _, _ = read_for(runs, responses, {KEY: ""}, Screen(Terminal()))
    owners = [cell.run for cell in read.campaign.layout.of_numbers]
    middle = read.measured.mean(axis=0)
    scale = 3 * np.abs(read.measured - middle).max(axis=0) + 0.1

    def simulate(draws: Sequence[Draw]) -> list[Observed]:
        shape = len(scale)
        normal = [np.random.default_rng(each.seed).standard_normal((each.blocks, shape)) for each in draws]
        return [((middle + scale * (each - np.array(off)[owners])).astype(np.float32),) for each in normal]

    return simulate


def written_in(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


@pytest.mark.parametrize("deviation", [1.0, 0.8])
def test_runs_that_tell_no_value_make_no_file(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, deviation: float
) -> None:
    """After the first round, and after all of them."""
    search_at_once(monkeypatch, known_to(deviation))
    answer = call("identify", runs[0], "--free", KEY, "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert f"these runs tell none of {KEY}: nothing was written" in answer.err
    assert not list(tmp_path.iterdir())


def test_a_rig_that_no_values_explain_makes_no_file(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    search_at_once(monkeypatch, known_to(0.1), rigs_about(runs[:1], 5.0))
    answer = call("identify", runs[0], "--free", KEY, "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "the best such rig still lies a gap of" in answer.err
    assert not written_in(tmp_path)


def test_a_run_of_another_rig_among_others_is_named_and_makes_no_file(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    search_at_once(monkeypatch, known_to(0.1), rigs_about(runs, 0.0, 5.0))
    answer = call("identify", *runs, "--free", KEY, "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "run4.mcap does not fit, though the other runs do" in answer.err
    assert "nothing was written" in answer.err
    assert not written_in(tmp_path)


def test_a_run_of_responses_is_held_against_what_was_found_too(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, later = runs  # it was made before the other
    asked = ("identify", later, "--frf", first, "--free", KEY, "-o", tmp_path / "model.toml")
    search_at_once(monkeypatch, known_to(0.1), rigs_about([later], 0.0, 0.8, responses=[first]))
    answer = call(*asked)
    assert answer.code == 0, answer.err
    assert float(re.findall(r"(\d\.\d\d) of run3\.mcap by", answer.out)[0]) < 0.5
    (tmp_path / "model.toml").unlink()
    search_at_once(monkeypatch, known_to(0.1), rigs_about([later], 5.0, 0.0, responses=[first]))
    answer = call(*asked)
    assert answer.code == 1
    assert "run3.mcap does not fit, though the other runs do" in answer.err
    assert not written_in(tmp_path)


def test_an_interval_is_wider_by_what_its_value_moved_last_beyond_what_it_narrowed(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it came to rest."""
    widths = list[float]()
    for unrest in (0.0, 0.5):
        path = tmp_path / f"unrest_{unrest}.toml"
        search_at_once(monkeypatch, known_to(0.02), rigs_about(runs[:1], 0.0), unrest)
        assert call("identify", runs[0], "--free", KEY, "-o", path).code == 0
        found = load_model(path, "impact_beam").identified[KEY]
        widths.append(np.log(found.high / found.low))
    assert widths[1] == pytest.approx(np.hypot(1.0, 0.5) * widths[0], rel=0.01)


def test_at_the_end_runs_may_say_as_much_else_as_the_twin_lacks(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "model.toml"
    for off, code in ((1.5, 0), (0.0, 1)):  # a gap of about 1.5, and none
        search_at_once(monkeypatch, known_to(0.1), rigs_about(runs, off, off), apart=(1.8, 1.2))
        answer = call("identify", *runs, "--free", KEY, "-o", path)
        assert answer.code == code, answer.err
        assert path.exists() == (code == 0)
        path.unlink(missing_ok=True)
    assert "run3.mcap and run4.mcap ask for different values: 1.8 times as far apart" in answer.err


def test_responses_that_fit_hide_no_motion_that_does_not(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, later = runs
    search_at_once(monkeypatch, known_to(0.1), rigs_about([later], 0.0, 1.6, responses=[first]))
    answer = call("identify", later, "--frf", first, "--free", KEY, "-o", tmp_path / "model.toml")
    whole, *single = map(float, re.findall(r"(\d\.\d\d) (?:with these|of run\d\.mcap by)", answer.out))
    assert whole == max(single) > 1.2


def test_runs_of_responses_alone_are_refused(call: Call, runs: list[Path], tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(b"no log")
    answer = call("identify", damaged, "--frf", runs[0], "--free", KEY, "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "no run is left but those of --frf" in answer.err


def test_the_gap_of_each_run_is_said_beside_that_of_all(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "model.toml"
    search_at_once(monkeypatch, known_to(0.1), rigs_about(runs, 0.0, 0.8))
    answer = call("identify", *runs, "--free", KEY, "-o", path)
    assert answer.code == 0, answer.err
    said = re.findall(r"(\d\.\d\d) (?:with these|of run3\.mcap by|of run4\.mcap by)", answer.out)
    whole, first, second = map(float, said)
    assert first < whole < second
    assert load_model(path, "impact_beam").identified.keys() == {KEY}
    assert written_in(tmp_path) == ["model.toml"]


def test_a_disk_that_is_full_keeps_no_part_of_a_model(
    call: Call, runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    was, path = {KEY: 1.5e7}, tmp_path / "model.toml"
    found = Identification(known_to(0.1), was, 1.0, converged=True, next_run=SCENARIO)
    monkeypatch.setattr(work, "identify", lambda *_: found)
    with monkeypatch.context() as patch:
        full_disk(patch)
        answer = call("identify", runs[0], "--free", KEY, "-o", path)
    assert answer.code == 1
    assert f"cannot write {path}: No space left on device" in answer.err
    assert not list(tmp_path.iterdir())
    assert call("identify", runs[0], "--free", KEY, "-o", path).code == 0
    assert written_in(tmp_path) == ["model.toml", "model_next.toml"]
    assert load_scenario(tmp_path / "model_next.toml") == parse_scenario(SCENARIO)


def test_the_run_that_would_narrow_most_of_what_is_open_is_next_and_says_by_how_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario, setting = crank()
    kind, keys = RIGS["planar_slider_crank"], ("piston_mass", "rod_mass")
    wides = [wide_of(kind, key, scenario.model, setting.twin) for key in keys]
    known = replace(nothing_known(wides), covariance=np.diag([0.01, 0.81]))
    data: Any = SimpleNamespace(
        campaign=Campaign((setting,)), scenarios=(CRANK,), sound=(np.ones(round(5 * RATE), bool),), chains={}
    )
    left = {300: 0.6, 120: 0.85, 250: 0.3, 160: 0.5}

    def kept(*_: object) -> Any:
        """Nobody asks it for rigs."""

    def after(subject: Campaign, *_: object) -> NDArray[np.float64]:
        return np.array([0.1, left[round(60 * subject.runs[0].columns.frequency)]])

    monkeypatch.setattr(work, "after_one_more", after)
    found = work._next_run(data, known, kept, np.random.default_rng(0))
    assert found is not None
    assert parse_scenario(found).name == "crank: speed 250 rpm"
    assert "#   rod_mass: 90%, then 30%\n" in found
    assert "piston_mass" not in found  # which is told already
    asked: list[Campaign] = []

    def for_two(subject: Campaign, *given: object) -> NDArray[np.float64]:
        asked.append(subject)
        if len(asked) > 2:
            raise work.OutOfTime("time ran out")
        return after(subject, *given)

    with monkeypatch.context() as patch:
        patch.setattr(work, "after_one_more", for_two)
        so_far = work._next_run(data, known, kept, np.random.default_rng(0))
    assert so_far is not None  # the best of those that there was time for
    assert f"{min(left[round(60 * each.runs[0].columns.frequency)] for each in asked[:2]):.0%}" in so_far
    left.update(dict.fromkeys(left, 0.85))
    assert work._next_run(data, known, kept, np.random.default_rng(0)) is None


CELLS, HEALTHY = 20, 48
PATTERN = 0.5 * np.linspace(-1, 1, SLICES)


def runs_off(*off: float, scenarios: Sequence[str] = ()) -> tuple[Any, Layout, list[NDArray[np.float64]]]:
    """Runs that lie so many deviations of healthy rigs off in every cell; a rig is the same in all."""
    count, rng = len(off), np.random.default_rng(1)
    own = np.tile(rng.normal(size=(HEALTHY, 1, CELLS, 1)), (1, 1, count, 1))
    blocks = 0.3 * rng.normal(size=(HEALTHY, 2, count * CELLS, 1))
    healthy = list((own + blocks + PATTERN).reshape(HEALTHY, 2, -1))
    layout = Layout(tuple(of_cycles(run, "a", "mean") for run in range(count) for _ in range(CELLS)))
    data: Any = SimpleNamespace(
        measured=np.tile((np.repeat(off, CELLS)[:, None] + PATTERN).ravel(), (4, 1)),
        paths=[Path(f"run{number}.mcap") for number in range(count)],
        scenarios=scenarios or [SCENARIO] * count,
    )
    return data, layout, healthy


def gaps_of(*off: float, scenarios: Sequence[str] = ()) -> list[float]:
    data, layout, healthy = runs_off(*off, scenarios=scenarios)
    return of_one_rig(data, gap_measure(healthy, layout), healthy)


def test_one_run_that_lies_far_off_is_of_another_rig_than_those_that_fit() -> None:
    with pytest.raises(RattleError, match=r"run2\.mcap does not fit, though the other runs do"):
        gaps_of(0.0, 0.0, 4.0)


def test_runs_on_either_side_of_the_values_found_are_of_two_rigs() -> None:
    with pytest.raises(RattleError, match=r"run0\.mcap and run1\.mcap were recorded at one setting"):
        gaps_of(1.5, -1.5)
    # a rig of which something else is missing is off alike in both, and what two settings show differs anyway
    settings = [SCENARIO, SCENARIO.replace("20 Hz", "25 Hz")]
    for gaps in (gaps_of(1.5, 1.5), gaps_of(1.5, -1.5, scenarios=settings)):
        # in units of what healthy rigs scatter, which 48 of them tell to 4 % over all cells; four of these
        assert gaps == pytest.approx([1.5 / np.hypot(1.0, 0.3)] * 2, rel=0.15)


def looked_at_first(data: Any, layout: Layout, healthy: Sequence[NDArray[np.float64]]) -> int:
    """How many rigs are simulated for it."""
    asked = list[Draw]()

    def shown_by(draws: Sequence[Draw]) -> Sequence[NDArray[np.float64]]:
        asked.extend(draws)
        return healthy[: len(draws)]

    require_alike(data, layout, shown_by, 1)
    return len(asked)


def test_two_rigs_at_one_setting_are_refused_before_any_long_work() -> None:
    with pytest.raises(RattleError, match=r"run0\.mcap and run1\.mcap were recorded at one setting"):
        looked_at_first(*runs_off(2.5, -2.5))
    assert looked_at_first(*runs_off(4.0, 4.0)) == LOOKED_AT_FIRST
    settings = [SCENARIO, SCENARIO.replace("20 Hz", "25 Hz")]
    assert looked_at_first(*runs_off(2.5, -2.5, scenarios=settings)) == 0
    data, layout, healthy = runs_off(2.5, -2.5)
    # a rig whose own blocks lie as far from one another says nothing by that
    scattered = np.array([8.0, -8.0, 8.0, -8.0])[:, None]
    data.measured = data.measured + scattered * [cell.run == 0 for cell in layout.of_numbers]
    assert looked_at_first(data, layout, healthy) == LOOKED_AT_FIRST


def test_where_all_runs_lie_far_off_none_of_them_is_another_rigs() -> None:
    assert min(gaps_of(4.0, 4.0)) > 2.0
    assert min(gaps_of(4.0)) > 2.0
