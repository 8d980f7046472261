"""What benchmarks done in parts make of their results: every bar counts, and every one that is missing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks import declared_chains, kept_results
from benchmarks.identified.rigs import FREE, RIGS_A_KIND, results_in
from benchmarks.identified.score import score
from benchmarks.kept_results import Results, made_by

DIGEST = "0123456789ab"
RIG = next(iter(FREE))
GOOD: dict[str, dict[str, Any]] = {
    "rigs": {
        "code": 0,
        "converged": True,
        "truth": {"friction": 1.0},
        "identified": {"friction": {"low": 0.5, "high": 1.5, "told": True}},
        "gap": 1.1,
        "gap_before": 2.0,
        "wall_s": 290.0,
        "cores": 2,
    },
    "effects": {"identified": {"right": True}, "nominal": {"right": True}},
    "healthy": {"usual": True, "own": False},
}


def write(folder: Path, step: str, number: int, found: dict[str, Any], rig: str = RIG) -> Path:
    file = folder / f"{rig}_{number:02d}_seed_1_{step}_{DIGEST}.json"
    file.write_text(json.dumps(found))
    return file


@pytest.fixture
def results(tmp_path: Path) -> dict[str, Results]:
    """All that is wanted, just within the bars."""
    for rig in FREE:
        for step, found in GOOD.items():
            for number in range(RIGS_A_KIND):
                write(tmp_path, step, number, found, rig)
        # of all intervals to hold would be too many
        write(tmp_path, "rigs", 0, {**GOOD["rigs"], "truth": {"friction": 2.0}}, rig)
    return dict.fromkeys(GOOD, Results(tmp_path, DIGEST))


def test_what_meets_every_bar_passes(results: dict[str, Results], capsys: pytest.CaptureFixture[str]) -> None:
    assert score(results)
    said = capsys.readouterr().out
    assert f"{RIG}: rigs 20 of 20, effects 20 of 20, healthy 20 of 20" in said
    assert "gap afterwards within 1.15: 20 of 20 (1.000, 95 %: 0.839 to 1.000)" in said
    assert "seconds on 2 cores: median 290, largest 290" in said


def test_nothing_measured_passes_nothing(tmp_path: Path) -> None:
    assert not score(dict.fromkeys(GOOD, Results(tmp_path / "absent", DIGEST)))


@pytest.mark.parametrize("step", GOOD)
def test_one_result_that_is_missing_is_told_and_fails(
    results: dict[str, Results], capsys: pytest.CaptureFixture[str], step: str
) -> None:
    write(results["rigs"].folder, step, 7, {}).unlink()
    assert not score(results)
    assert f"{step} 19 of 20" in capsys.readouterr().out


@pytest.mark.parametrize(
    "changed",
    [{"gap": 1.2}, {"gap": None}, {"wall_s": 310.0}, {"cores": 16}, {"code": 1}],
    ids=["gap", "no gap", "slow", "on more cores", "refused"],
)
def test_one_rig_that_misses_a_bar_fails(results: dict[str, Results], changed: dict[str, Any]) -> None:
    write(results["rigs"].folder, "rigs", 7, {**GOOD["rigs"], **changed})
    assert not score(results)


@pytest.mark.parametrize("held", [17, 20])
def test_intervals_that_hold_too_few_or_too_many_values_fail(results: dict[str, Results], held: int) -> None:
    for number in range(RIGS_A_KIND):
        truth = {"friction": 1.0 if number < held else 2.0}
        write(results["rigs"].folder, "rigs", number, {**GOOD["rigs"], "truth": truth})
    assert not score(results)


def test_three_effects_fewer_of_sixty_may_be_named_in_identified_rigs(results: dict[str, Results]) -> None:
    missed = {**GOOD["effects"], "identified": {"right": False}}
    for number in range(3):
        write(results["rigs"].folder, "effects", number, missed)
    assert score(results)
    write(results["rigs"].folder, "effects", 3, missed)
    assert not score(results)


def test_three_false_alarms_of_sixty_are_allowed(results: dict[str, Results]) -> None:
    for number in range(3):
        write(results["rigs"].folder, "healthy", number, {**GOOD["healthy"], "own": True})
    assert score(results)
    write(results["rigs"].folder, "healthy", 3, {**GOOD["healthy"], "own": True})
    assert not score(results)


def test_results_of_another_program_do_not_count(
    results: dict[str, Results], capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(results["rigs"].folder, "rigs", 7, GOOD["rigs"])
    file.rename(file.with_name(file.name.replace(DIGEST, "ba9876543210")))
    assert not score(results)
    assert "results of others, left out: 1" in capsys.readouterr().out


def test_a_result_says_what_made_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept_results, "commit", lambda: "abc+")
    own, other = (Results(tmp_path / "kept", digest) for digest in (DIGEST, "ba9876543210"))
    own.keep("bench", {"value": 1})
    assert own.found("bench") == {"commit": "abc+", "digest": DIGEST, "value": 1}
    assert other.found("bench") is None
    assert (own.others("*"), other.others("*")) == (0, 1)


def test_a_result_hangs_on_what_is_imported_and_on_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if two of the modules were edited: what a search is judged by, and what it only shows."""
    before, *others = (
        made_by(("rig.diagnosis.health",)),
        made_by(("rig.diagnosis.health",), ("rig/rigs/impact_beam.toml",)),
        made_by(("rig.diagnosis.identify",)),
    )
    assert len({before, *others}) == 3
    source, edited = kept_results._source, tmp_path / "edited.py"
    edited.write_text("")
    for module, counts in (("sim_twin.diagnosis.gap", True), ("rig.pages.report", False)):
        monkeypatch.setattr(
            kept_results, "_source", lambda name, of=module: edited if name == of else source(name)
        )
        assert (made_by(("rig.diagnosis.health",)) != before) == counts


@pytest.mark.long
@pytest.mark.parametrize(
    ("module", "steps"),
    [
        ("sim_twin.diagnosis.search", {"effects", "healthy"}),
        ("rig.diagnosis.lab", {"effects", "healthy"}),
        ("sim_twin.rigs.impact_beam.lanes", {"rigs", "effects", "healthy"}),
        ("rig.live.page_server", set[str]()),
        ("benchmarks.blind.crank.mechanism", {"rigs", "effects", "healthy"}),
        ("benchmarks.blind.page", set[str]()),
    ],
)
def test_a_step_hangs_on_what_its_commands_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, steps: set[str]
) -> None:
    before = {step: each.digest for step, each in results_in(tmp_path).items()}
    source, edited = kept_results._source, tmp_path / "edited.py"
    edited.write_text("")
    monkeypatch.setattr(kept_results, "_source", lambda name: edited if name == module else source(name))
    assert {step for step, each in results_in(tmp_path).items() if each.digest != before[step]} == steps


def bench(verdict: str, declared: str = "within") -> dict[str, Any]:
    told = {"declared": declared, "not": verdict, "usual": "within"}
    return {"cpu_s": 1.0, **{kind: {"verdict": each} for kind, each in told.items()}}


@pytest.mark.parametrize(
    ("results", "code"),
    [
        ([bench("outside")] * 2, 0),
        ([bench("outside")], 1),
        ([bench("outside"), bench("within")], 1),
        ([bench("outside"), bench("refused")], 1),
        ([bench("outside"), bench("outside", declared="outside")], 1),
    ],
    ids=["met", "one is not done", "half within", "half refused", "one declared outside"],
)
def test_benches_that_are_refused_are_not_outside(results: list[dict[str, Any]], code: int) -> None:
    assert declared_chains.score(results, 2) == code
