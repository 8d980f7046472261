"""Values of [model] that may have been entered wrongly: which, how far off, what is simulated with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.quantity import Quantity
from rig.diagnosis.model_values import WithValues, entered_wrongly, tolerance_of, with_doubts
from rig.diagnosis.recordings import setting_of
from rig.files.quantity import si_factor
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.twin.scenario_twin import twin_of
from sim_twin.diagnosis.campaign import Campaign
from sim_twin.diagnosis.cause import Cause
from sim_twin.diagnosis.subject import Draw
from sim_twin.twin import AnyTwin

BEAM, CRANK, SPATIAL = "impact_beam", "planar_slider_crank", "spatial_slider_crank"
DRIVES = {
    BEAM: 'frequency = "20 Hz"\namplitude = "9 N"',
    CRANK: 'speed = "200 rpm"',
    SPATIAL: 'speed = "200 rpm"',
}


def nominal(rig: str, model: str = "") -> AnyTwin:
    head = f'name = "one"\nrig = "{rig}"\n[drive]\n{DRIVES[rig]}\n'
    acquisition = '[acquisition]\nsample_rate = "25.6 kHz"\nduration = "2 s"\n'
    return twin_of(parse_scenario(f"{head}{acquisition}[model]\n{model}\n"))


def of(rig: str, *tables: Mapping[str, Any]) -> WithValues:
    twin = nominal(rig)
    settings = tuple(setting_of(twin, twin.channels, 25_600.0, 10) for _ in tables or ({},))
    return with_doubts(rig, Campaign(settings), list(tables or ({},)))


def by_key(doubts: tuple[Cause, ...]) -> dict[str, Cause]:
    return {cause.parameters[0].name: cause for cause in doubts}


def draw(campaign: WithValues, key: str, value: float, *effects: tuple[str, dict[str, float]]) -> Draw:
    [cause] = [each for each in campaign.doubts if each.parameters[0].name == key]
    return Draw((cause.named(np.array([value])), *effects), 1)


@pytest.mark.parametrize(
    ("rig", "doubted", "not_doubted"),
    [
        (BEAM, {"beam_length", "beam_modulus", "drive_position", "yoke_frequency"},
         {"clearance", "contact_stiffness", "shaker_mass", "mode_damping[3]", "contact_hertz"}),
        (CRANK, {"crank_length", "rod_mass", "gravity", "incline", "frame_crank_x_mass"},
         {"clearance_1", "clearance_2", "frame_crank_x_frequency", "frame_piston_y_frequency"}),
        (SPATIAL, {"slider_mass", "crank_radius", "rod_diameter", "contact_span", "incline"},
         {"socket_clearance", "guide_stiffness", "friction"}),
    ],
)  # fmt: skip
def test_a_value_may_be_wrong_unless_an_effect_is_of_it_or_the_rig_has_none(
    rig: str, doubted: set[str], not_doubted: set[str]
) -> None:
    found = by_key(of(rig).doubts)
    assert doubted <= found.keys()
    assert not not_doubted & found.keys()
    assert all(cause.entered for cause in found.values())


def test_a_drive_may_have_another_amplitude_if_it_has_one() -> None:
    beam = of(BEAM)
    run = beam.changed(0, draw(beam, "drive.amplitude", 1.4).effects)
    assert run.drive.amplitude == pytest.approx(1.4 * 9.0)
    assert run.drive.frequency == nominal(BEAM).drive.frequency
    assert run.rig == nominal(BEAM).rig
    assert all("drive.amplitude" not in by_key(of(rig).doubts) for rig in (CRANK, SPATIAL))


def test_a_value_lies_where_effects_of_its_part_do() -> None:
    places = {key: cause.location for rig in (BEAM, CRANK) for key, cause in by_key(of(rig).doubts).items()}
    assert places["beam_length"] == "beam"
    assert places["drive_position"] == "drive"
    assert places["rod_mass"] == "rod"
    assert places["joint_modulus"] == "joints"
    assert places["frame_crank_x_mass"] == "frame"
    assert places["gravity"] == "model"


def test_what_runs_do_not_share_is_no_value_of_the_rig() -> None:
    assert "drive_position" in by_key(of(BEAM, {}, {}).doubts)
    assert "drive_position" not in by_key(of(BEAM, {}, {"drive_position": 0.5}).doubts)


@pytest.mark.parametrize("rig", [BEAM, CRANK, SPATIAL])
def test_a_wrong_value_lies_farther_off_than_healthy_rigs_and_where_a_file_may_have_it(rig: str) -> None:
    campaign, kind = of(rig), RIGS[rig]
    twin = campaign.runs[0].twin
    for key, cause in by_key(entered_wrongly(kind, [{}], twin)).items():
        [parameter] = cause.parameters
        meaning = kind.numbers[key].meaning
        assert isinstance(meaning, Quantity)
        factor = si_factor(meaning.unit)
        centre, tolerance = kind.value(key, {}), tolerance_of(kind, key, twin)
        healthy = 0.0 if tolerance is None else 2 * tolerance.deviation
        by_ratio = tolerance is None or tolerance.relative
        for low, high in parameter.intervals:
            assert meaning.low <= low < high <= meaning.high
            ends = [factor * end for end in (low, high)]
            if by_ratio and centre > 0 and meaning.unit != "deg":
                assert min(max(end, centre) / min(end, centre) for end in ends) >= 1 + 0.99 * healthy
            else:
                assert min(abs(end - centre) for end in ends) >= 0.99 * healthy
            assert not low <= centre / factor <= high
            for value in (low, high):
                assert campaign.changed(0, draw(campaign, key, value).effects).rig != twin.rig


def test_a_value_at_the_end_of_its_range_may_be_wrong_on_one_side() -> None:
    [angle] = by_key(of(SPATIAL).doubts)["axis_angle"].parameters
    assert [tuple(round(end, 2) for end in each) for each in angle.intervals] == [(72.81, 88.85)]
    assert angle.unit == "deg"


def test_what_was_found_of_the_same_part_stays_as_it_is() -> None:
    campaign = of(BEAM)
    [run] = campaign.runs
    beam = replace(run.twin.rig.beam, E=2.2e11)
    calibrated = replace(run, twin=replace(run.twin, rig=replace(run.twin.rig, beam=beam)))
    campaign = with_doubts(BEAM, Campaign((calibrated,)), [{}])
    rig = campaign.changed(0, draw(campaign, "beam_length", 300.0).effects).rig
    assert (rig.beam.length, rig.beam.E) == (pytest.approx(0.3), 2.2e11)
    (_, below), (above, _) = by_key(campaign.doubts)["beam_modulus"].parameters[0].intervals
    assert below < 220.0 < above  # GPa, about what was found


def test_a_draw_has_the_value_and_the_effects_and_each_run_its_own_table() -> None:
    campaign = of(BEAM, {"contact_damping": 20.0}, {"contact_damping": 40.0})
    effects = draw(campaign, "yoke_frequency", 600.0, ("clearance", {"scale": 1.5})).effects
    for number in range(2):
        twin = campaign.changed(number, effects)
        assert twin.rig.yoke_frequency == 600.0
        assert twin.rig.clearance == pytest.approx(1.5 * campaign.runs[number].twin.rig.clearance)
    assert [each["contact_damping"] for each in campaign.given] == [20.0, 40.0]
    second = campaign.only((1,))
    assert isinstance(second, WithValues)
    assert [each["contact_damping"] for each in second.given] == [40.0]
    assert second.changed(0, effects).rig.yoke_frequency == 600.0


def test_what_no_rig_can_be_is_not_simulated_and_says_so() -> None:
    campaign = of(CRANK)
    [impossible] = campaign.observe([draw(campaign, "rod_length", 0.01)])
    assert impossible == (None,)


def test_a_value_that_the_model_says_is_what_it_may_be_wrong_about() -> None:
    twin = nominal(CRANK, 'rod_mass = "3 kg"')
    heavy = by_key(entered_wrongly(RIGS[CRANK], [{"rod_mass": 3.0}], twin))["rod_mass"]
    assert heavy.parameters[0].intervals[0][1] < 3.0 < heavy.parameters[0].intervals[1][0]
