"""What is drawn keeps to the text, is balanced, and reveals nothing in the logs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.blind.campaigns import Campaign, Outsider, draw_campaigns, numbers_of_kinds
from benchmarks.blind.catalogue import BEAM, CATALOGUE, CRANK, PIVOTED_ONLY, SPATIAL, EffectEntry
from benchmarks.blind.logs import write_campaign
from benchmarks.blind.operating_points import scenario_text
from benchmarks.blind.recording import Recording
from daq.log.reader import LogReader
from daq.log.recover import verify_log
from rig.files.scenario import parse_scenario
from rig.twin.scenario_twin import twin_of
from tests.sim_twin.every_rig import RIGS


@dataclass(frozen=True, slots=True)
class Stranger:
    name: str

    def draw(self, rng: np.random.Generator) -> EffectEntry:
        return {"name": self.name, "parameters": {"size": float(rng.random())}}


class SilentEngine:
    """A rig that stands still."""

    OUTSIDE: Sequence[Outsider] = (Stranger("loose_cable"),)

    def record(
        self, scenario: Mapping[str, Any], effects: Sequence[Mapping[str, Any]], rig_seed: int, run_seed: int
    ) -> Recording:
        count = round(0.25 * scenario["sample_rate"])
        noise = np.random.default_rng(run_seed).standard_normal((2, count))
        channels = {"drive.force": noise[0], "crank.angle": noise[1] * np.pi}
        return Recording(scenario["sample_rate"], channels, {"drive.force": "N", "crank.angle": "rad"})


OUTSIDE = {
    BEAM: [Stranger("loose_cable"), Stranger("cubic_tip")],
    CRANK: [Stranger("oval_bearing")],
    SPATIAL: [Stranger("worn_point")],
}
CAMPAIGNS = draw_campaigns(120, 7, OUTSIDE)


def _effects(kind: str) -> list[tuple[str, EffectEntry]]:
    return [(each.rig, effect) for each in CAMPAIGNS if each.kind == kind for effect in each.effects]


@pytest.mark.parametrize("rig", [BEAM, CRANK, SPATIAL])
def test_the_table_is_the_twins_catalogue(rig: str) -> None:
    twins = {effect.name: effect for effect in RIGS[rig].effects.values()}
    # what people wire or enter wrongly is for rigs, not for truths
    assert twins.keys() - CATALOGUE[rig].keys() <= {"sensor_factor", "swapped_channels", "analog_delay"}
    assert CATALOGUE[rig].keys() <= twins.keys()
    for name, cause in CATALOGUE[rig].items():
        parameters = {each.name: each.intervals for each in twins[name].parameters}
        ours = {each.name: each.intervals for each in cause.quantities}
        (
            parameters.pop("phase_rad", None),
            ours.pop("phase_rad", None),
        )  # any phase: written as one turn or two
        assert ours == parameters
        assert cause.location == twins[name].location
        assert set(cause.channels) == {each for each in twins[name].channels if not each.startswith("cover.")}


def test_kinds_have_their_shares() -> None:
    assert numbers_of_kinds(120) == {"single": 48, "none": 30, "pair": 24, "outside": 18}
    assert sum(numbers_of_kinds(3).values()) == 3
    assert Counter(each.kind for each in CAMPAIGNS) == numbers_of_kinds(120)


def test_single_effects_are_balanced_over_the_catalogues() -> None:
    number = Counter((rig, str(effect["name"])) for rig, effect in _effects("single"))
    assert set(number) == {(rig, name) for rig in CATALOGUE for name in CATALOGUE[rig]}
    assert max(number.values()) - min(number.values()) <= 1


def test_pairs_are_two_effects_of_one_rig() -> None:
    for each in CAMPAIGNS:
        if each.kind == "pair":
            assert len({str(effect["name"]) for effect in each.effects} & CATALOGUE[each.rig].keys()) == 2


def test_outside_effects_are_not_in_the_catalogue() -> None:
    names = {str(effect["name"]) for _, effect in _effects("outside")}
    assert names == {"loose_cable", "cubic_tip", "oval_bearing", "worn_point"}


def test_the_same_seed_draws_the_same_and_another_seed_others() -> None:
    assert draw_campaigns(120, 7, OUTSIDE) == CAMPAIGNS
    assert draw_campaigns(120, 8, OUTSIDE) != CAMPAIGNS


def test_a_campaign_survives_its_file() -> None:
    assert [Campaign.from_json(json.loads(json.dumps(each.as_json()))) for each in CAMPAIGNS] == list(
        CAMPAIGNS
    )


@pytest.mark.parametrize("campaign", CAMPAIGNS[::6], ids=lambda each: each.name)
def test_the_twin_takes_every_scenario_and_effect(campaign: Campaign) -> None:
    for number, point in enumerate(campaign.runs):
        scenario = parse_scenario(scenario_text(f"run {number}", point))
        twin = twin_of(scenario)
        if campaign.kind != "outside":
            values: Any = [(each["name"], each["parameters"]) for each in campaign.effects]
            RIGS[campaign.rig].with_effects(twin, values)
            assert all(name in RIGS[campaign.rig].effects for name, _ in values)


def test_scenario_and_engine_are_given_the_same_numbers() -> None:
    for point in (point for each in CAMPAIGNS for point in each.runs):
        scenario = parse_scenario(scenario_text("run", point))
        held = {"settle": scenario.acquisition.settle, "duration": scenario.acquisition.duration}
        names = ("frequency", "amplitude") if "beam" in point else ("speed",)
        held |= {name: getattr(scenario.drive, name) for name in names}
        gaps = [key for key in point if "clearance" in key or key == "axis_angle"]
        held |= {name: scenario.model[name] for name in gaps}
        # Texts have three decimals of rpm; all else is exact but for rounding.
        assert held == pytest.approx({name: point[name] for name in held}, rel=1e-6)


def test_operating_points_lie_in_their_ranges_and_differ_within_a_campaign() -> None:
    for each in CAMPAIGNS:
        assert 1 <= len(each.runs) == len(each.run_seeds) <= 3
        name, low, high = {
            BEAM: ("frequency", 5.0, 40.0),
            CRANK: ("speed", 120 * np.pi / 30, 260 * np.pi / 30),
            SPATIAL: ("speed", 50 * np.pi / 30, 250 * np.pi / 30),
        }[each.rig]
        values = [float(point[name]) for point in each.runs]
        assert all(low - 1e-9 <= value <= high + 1e-9 for value in values)
        assert len(set(values)) == len(values)


def test_every_run_of_the_spatial_crank_has_whole_turns() -> None:
    points = [point for each in CAMPAIGNS if each.rig == SPATIAL for point in each.runs]
    assert {float(point["duration"]) for point in points} <= {round(0.1 * n, 1) for n in range(30, 121)}
    # five turns less 0.05 s of rounding leave three whole ones and parts at both ends
    assert all(float(point["duration"]) * float(point["speed"]) > 4.9 * 2 * np.pi for point in points)


def test_effects_that_need_a_pivot_are_on_the_steel_beam() -> None:
    for each in CAMPAIGNS:
        if any(effect["name"] in PIVOTED_ONLY for effect in each.effects):
            assert {point["beam"] for point in each.runs} == {"steel"}


def test_logs_are_sound_and_say_nothing_of_the_answer(tmp_path: Path) -> None:
    hidden = next(each for each in CAMPAIGNS if each.kind == "outside" and len(each.runs) == 2)
    logs = write_campaign(tmp_path, hidden, SilentEngine())
    assert [log.name for log in logs] == [f"{hidden.name}_run1.mcap", f"{hidden.name}_run2.mcap"]
    for log, point in zip(logs, hidden.runs, strict=True):
        assert verify_log(log).sound
        with LogReader(log) as reader:
            assert parse_scenario(reader.scenario).acquisition.duration == point["duration"]
            assert set(reader.metadata["run"]) == {"id", "started"}
            # The angle needs 64 bits; forces do with 32.
            kinds = {name: block.values.dtype for name, block in reader.table("measured").items()}
        assert kinds == {"drive.force": np.float32, "crank.angle": np.float64}
        assert str(hidden.effects[0]["name"]).encode() not in log.read_bytes()


def test_recorded_runs_are_not_made_again(tmp_path: Path) -> None:
    logs = write_campaign(tmp_path, CAMPAIGNS[0], SilentEngine())
    before = [log.stat().st_mtime_ns for log in logs]
    write_campaign(tmp_path, CAMPAIGNS[0], SilentEngine())
    assert [log.stat().st_mtime_ns for log in logs] == before
