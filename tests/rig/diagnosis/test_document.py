"""diagnosis.json and effects.json hold to the interface, whatever was found."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.errors import RecorderFailed
from rig.diagnosis.document import document, effects_file, gap_block, provenance, write_json
from rig.diagnosis.experiments import Experiment
from rig.files.effects_file import load_effects
from sim_twin.diagnosis.belief import Unexplained
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.findings import Findings, Gap, Judged
from sim_twin.diagnosis.fingerprint import Columns, Layout
from sim_twin.diagnosis.posterior import Estimate
from sim_twin.rigs.impact_beam.rig import MODEL
from tests.rig.commands.test_calibrate import full_disk

UPPER, DRIVE = "contact.force_upper", "drive.force"
COLUMNS = Columns((UPPER, DRIVE), (UPPER,), 20.0, 25_600.0)
LAYOUT = Layout((*COLUMNS.cells(0), *COLUMNS.cells(1)))
UNIT_BEFORE, UNIT_AFTER = 1.25, 1.6
GAIN = Cause("sensor_gain", "sensor", MODEL.effects["sensor_gain"].parameters, UPPER, sensing=True)
BASE = Cause("base_flexibility", "base", MODEL.effects["base_flexibility"].parameters)
KEYS = {
    "schema", "runs", "verdict", "verdict_probability", "gap", "effects", "selected", "horizon_s",
    "next_experiment", "cost",
}  # fmt: skip


def floors() -> np.ndarray:
    return np.random.default_rng(1).uniform(1, 5, len(LAYOUT.cells))


def gap(before: float = 3.0, after: float = 1.1) -> Gap:
    left = np.ones(len(LAYOUT.cells))
    return Gap(before, after, 0.95, (0.9, 1.0), floors(), left, UNIT_BEFORE, UNIT_AFTER, 0.9)


@cache
def findings() -> Findings:
    base = {
        "frequency_hz": Estimate(431.0, 419.0, 444.0),
        "mass_kg": Estimate(1.5, 1.0, 2.0),
        "damping_ratio": Estimate(0.02, 0.01, 0.04),
    }
    best = ("base_flexibility", {name: estimate.value for name, estimate in base.items()})
    gain = ("sensor_gain", {"channel": UPPER, "gain": 1.2})
    judged = (
        Judged(BASE, 0.7, base, best, 1.1, 0.95, ("pivot_compliance",), 0.75),
        Judged(GAIN, 0.1, {"gain": Estimate(1.2, 1.1, 1.3)}, gain, None, None, present=0.2),
    )
    numbers = np.zeros(LAYOUT.size)
    return Findings(
        layout=LAYOUT, none=0.05, effect=0.8, unknown=0.15, judged=judged, selected=(BASE,),
        effects=(best,), gap=gap(), by_location={"base": 0.9, "sensor": 0.1}, separability={},
        measured=numbers, nominal=numbers, repaired=numbers, floor=np.ones(len(LAYOUT.cells)),
        held_out=True, simulations=500, left=Unexplained(1.5, 0.9, 1.1), judging=0.4,
    )  # fmt: skip


def told(
    found: Findings, experiment: Experiment | None = None, horizon: float | None = 0.4
) -> dict[str, Any]:
    runs = [Path("a.mcap"), Path("b.mcap")]
    return document(found, MODEL.effects, runs, provenance(7), horizon, experiment, 12.5, ["odd"])


def test_a_diagnosis_has_every_key_of_the_interface() -> None:
    content = told(findings(), Experiment("text", ("x", "y"), 0.9))
    assert set(content) >= KEYS
    assert content["schema"] == "rattle.diagnosis/1"
    assert content["provenance"]["seed"] == 7
    assert content["provenance"]["software"].startswith("rattle ")
    assert content["runs"] == ["a.mcap", "b.mcap"]
    assert content["verdict"] == "effect"
    assert content["verdict_probability"] == {"none": 0.05, "effect": 0.8, "unknown": 0.15}
    assert content["selected"] == ["base_flexibility"]
    assert content["next_experiment"]["expected_probability"] == 0.9
    assert content["cost"] == {"simulations": 500, "seconds": 12.5, "searched": 1.0, "judging": 0.4}
    assert content["unexplained"] == {"misfit": 1.5, "outside": 0.9, "gap": 1.1}
    assert content["remarks"] == ["odd"]


def test_parameters_have_values_and_intervals_and_a_channel_is_one_of_them() -> None:
    first, second, *others = told(findings())["effects"]
    # effects that these runs cannot have are there all the same
    assert {each["name"] for each in (first, second, *others)} == set(MODEL.effects)
    assert all(each["probability"] == 0 and each["gap_after"] is None for each in others)
    assert first["parameters"]["frequency_hz"] == {"value": 431.0, "ci95": [419.0, 444.0]}
    assert (first["location"], first["indistinguishable_from"]) == ("base", ["pivot_compliance"])
    assert (first["present"], second["present"], others[0]["present"]) == (0.75, 0.2, 0.0)
    assert second["parameters"] == {"channel": {"value": UPPER}, "gain": {"value": 1.2, "ci95": [1.1, 1.3]}}
    assert (second["gap_after"], second["shrink"]) == (None, None)


def test_gaps_by_channel_and_run_are_parts_of_the_whole() -> None:
    told_over_time = replace(gap(), course_before=((2.0, 3.0), (3.0, 4.0)), course_after=((1.0, 1.2),))
    block = gap_block(LAYOUT, told_over_time, {"base": 1.0})
    whole = np.sqrt(np.mean(floors() ** 2)) / UNIT_BEFORE
    assert (block["before"], block["after"], block["shrink"]) == (3.0, 1.1, 0.95)
    # cells are as many in one run as in the other
    assert np.sqrt(np.mean(np.square(block["by_run"]))) == pytest.approx(whole)
    counts = [sum(cell.channel == name for cell in LAYOUT.cells) for name in (UPPER, DRIVE)]
    assert counts[0] == counts[1]
    assert np.sqrt(np.mean(np.square(list(block["by_channel"].values())))) == pytest.approx(whole)
    assert block["by_location"] == {"base": 1.0}
    assert block["course"] == [
        {"run": 0, "before": (2.0, 3.0), "after": (1.0, 1.2)},
        {"run": 1, "before": (3.0, 4.0), "after": None},
    ]


def test_gaps_by_band_and_phase_are_once_a_channel_and_place_over_all_runs() -> None:
    block = gap_block(LAYOUT, gap(), {})
    bands = [(each["channel"], each["low_hz"], each["high_hz"]) for each in block["by_band"]]
    phases = [(each["channel"], each["from"], each["to"]) for each in block["by_phase"]]
    assert len(set(bands)) == len(bands) == 2 * (len(COLUMNS.harmonics) - 1)
    assert len(set(phases)) == len(phases) == 2 * 16
    assert (UPPER, 0.0, 0.0625) in phases
    assert all(low < high for _, low, high in bands + phases)
    lowest = next(each for each in block["by_band"] if each["channel"] == UPPER and each["low_hz"] == 20)
    chosen = [
        floor
        for cell, floor in zip(LAYOUT.cells, floors(), strict=True)
        if cell.what == "energy" and cell.channel == UPPER and cell.band is not None and cell.band[0] == 20
    ]
    assert lowest["gap"] == pytest.approx(np.sqrt(np.mean(np.square(chosen))) / UNIT_BEFORE)
    assert len(chosen) == 2


def test_numbers_without_meaning_are_null_and_the_file_holds_no_nan(tmp_path: Path) -> None:
    odd = replace(
        findings(),
        gap=replace(gap(), shrink=None, shrink_ci95=None, before=float("nan")),
        judged=(replace(findings().judged[0], after=float("inf"), shrink=np.float64("nan")),),
    )
    path = tmp_path / "diagnosis.json"
    write_json(path, told(odd, horizon=None))
    text = path.read_text()
    assert "NaN" not in text
    assert "Infinity" not in text
    content = json.loads(text)
    assert content["gap"]["before"] is None
    assert content["gap"]["shrink"] is None
    assert content["effects"][0]["gap_after"] is None
    assert content["horizon_s"] is None
    assert content["next_experiment"] is None


def test_the_effects_file_is_one_that_a_twin_takes(tmp_path: Path) -> None:
    path = tmp_path / "effects.json"
    write_json(path, effects_file(findings()))
    loaded = load_effects(path, MODEL.effects)
    assert [(name, dict(values)) for name, values in loaded] == [
        ("base_flexibility", {"frequency_hz": 431.0, "mass_kg": 1.5, "damping_ratio": 0.02})
    ]
    write_json(path, effects_file(replace(findings(), effects=())))
    assert list(load_effects(path, MODEL.effects)) == []


def test_a_disk_that_is_full_keeps_no_part_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full_disk(monkeypatch)
    with pytest.raises(RecorderFailed, match=r"effects\.json: No space left on device"):
        write_json(tmp_path / "effects.json", effects_file(findings()))
    assert not list(tmp_path.iterdir())


def test_nan_is_never_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="Out of range float values"):
        write_json(tmp_path / "x.json", {"gap": float("nan")})
