"""`rattle identify`: values of a rig from a recording of it; what it refuses before any long work."""

from __future__ import annotations

import io
import json
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.errors import ConfigurationError, RattleError, UnphysicalParameter
from rig import ensembles
from rig.diagnosis import identify as work
from rig.diagnosis.identify import (
    Identification,
    Kept,
    OutOfTime,
    identifying,
    last_of,
    model_text_of,
    read_for,
    require_moves,
    rows,
    tolerance_of,
    wide_of,
)
from rig.diagnosis.recordings import RecordedCampaign, setting_of
from rig.ensembles import Simulated
from rig.files.model_file import as_identified, load_model, parse_model
from rig.files.scenario import parse_scenario
from rig.files.table import NOTHING, FieldError
from rig.rigs import RIGS
from rig.session.progress import Screen, Terminal
from rig.twin.logged import with_model
from rig.twin.scenario_twin import predicted_channels, twin_of
from sim_twin.diagnosis import identification
from sim_twin.diagnosis.identification import VALUES, Known, Round, nothing_known
from sim_twin.diagnosis.subject import Draw, Observed
from tests.rig.commands.cli import Call
from tests.rig.commands.test_calibrate import RATE, SCENARIO, SECONDS, write
from tests.rig.diagnosis.test_workers import Here, Numbered

TRUTH = {"contact_stiffness": 2.4e7, "yoke_frequency": 600.0}
CRANK = """
name = "crank"
rig = "planar_slider_crank"

[drive]
speed = "200 rpm"

[acquisition]
sample_rate = "25.6 kHz"
duration = "5 s"
"""
SPATIAL = CRANK.replace("planar", "spatial").replace("200 rpm", "300 rpm")


def record(
    path: Path,
    seed: int,
    scenario: str = SCENARIO,
    values: Mapping[str, float] = NOTHING,
    begin_ns: int = 0,
    run: int = 0,
) -> Path:
    """A run of a healthy rig, which `seed` tells, with other values than its scenario says."""
    twin, rng = twin_of(parse_scenario(scenario)), np.random.default_rng([seed, run])
    model = twin.model
    valued = replace(twin, rig=replace(twin.rig, **values))
    healthy = model.draw_healthy(valued, np.random.default_rng(seed), rng)
    stream = model.stream(healthy, RATE, rng)
    stream.drive(healthy.drive, float(rng.uniform(0, 2 * np.pi)))
    stream.advance(round(RATE))
    write(path, predicted_channels(healthy), stream.advance(round(SECONDS * RATE)), scenario, begin_ns)
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("run") / "run.mcap", 3, values=TRUTH)


def test_a_run_that_is_left_out_does_not_change_how_the_others_are_looked_at(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "SECONDS", 0.1)
    short = record(tmp_path / "short.mcap", 4)
    monkeypatch.undo()
    responses = [record(tmp_path / f"response{seed}.mcap", seed) for seed in (5, 6)]
    data, _, campaign = read_for([short, run], responses, {"contact_stiffness": ""}, Screen(Terminal()))
    assert data.paths == (run, *responses)
    assert [each.columns.alone for each in campaign.runs] == [False, True, True]  # type: ignore[attr-defined]


@pytest.mark.long
@pytest.mark.timeout(600)
def test_values_far_off_are_found_and_used(
    call: Call, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identification, "_FEWEST_OF_ALL", 60)  # two values need fewer rigs than ten
    other = record(tmp_path / "again.mcap", 3, values=TRUTH, run=1)
    path = tmp_path / "model.toml"
    keys = "contact_stiffness, yoke_frequency = 400 Hz..1 kHz"
    answer = call("identify", run, "--frf", other, "--free", keys, "-o", path)
    assert answer.code == 0, answer.err
    assert "round 3" in answer.out
    assert not list(tmp_path.glob(".model*"))
    model = load_model(path, "impact_beam")
    assert model.runs == ("run.mcap", "again.mcap")
    for key, truth in TRUTH.items():
        found = model.identified[key]
        # of the rig as drawn: 5 and 2 % off by its tolerances
        assert found.low * 0.9 < truth < found.high * 1.1
        assert found.high < 1.5 * found.low
    known = 'contact_stiffness = "2.4e7 N/m"\nyoke_frequency = "600 Hz"\n'
    true = record(tmp_path / "true.mcap", 3, f"{SCENARIO}[model]\n{known}")
    looked_at = ((run,), (run, "--model", path), (true,))
    before, found_out, known_from_the_start = (
        json.loads(call("gap", *each, "--json").out)["before"] for each in looked_at
    )
    assert found_out < 1.1 * known_from_the_start < 0.8 * before


@pytest.mark.long
@pytest.mark.timeout(300)
def test_runs_of_two_rigs_at_different_settings_are_refused_after_one_round(
    call: Call, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identification, "_FEWEST_OF_ALL", 60)
    faster = SCENARIO.replace('"20 Hz"', '"25 Hz"')
    other = record(tmp_path / "other.mcap", 5, faster, {**TRUTH, "yoke_frequency": 900.0})
    free = ("--free", "contact_stiffness, yoke_frequency = 400 Hz..1 kHz")
    answer = call("identify", run, other, *free, "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "other.mcap ask for different values" in answer.err
    assert "round 2" not in answer.out
    assert [each.name for each in tmp_path.iterdir()] == ["other.mcap"]


@pytest.mark.parametrize(
    ("free", "told"),
    [
        ("contact_stifness", "did you mean contact_stiffness"),
        ("beam", "a key of one number that is no count"),
        ("modes", "a key of one number that is no count"),
        ("modal_damping[1]", "unknown key"),
        ("shaker_mass", "a range, such as shaker_mass=LOW..HIGH"),
        ("pivot_stiffness", "it has none as it stands"),
        ("base_plate_thickness=1 mm..5 mm", "a key of a part that the rig has"),
        ("yoke_frequency=5 m..3 Hz", "m is not a unit of this kind"),
        ("yoke_frequency=1 Hz..3 Hz", "10 Hz to 20000 Hz"),
        ("yoke_frequency=700 Hz", "a range, such as"),
        ("yoke_frequency=900 Hz..700 Hz", "from its lower end to its higher"),
        ("yoke_frequency,yoke_frequency", "comes twice"),
        (",", "keys of [model]"),
    ],
)
def test_what_cannot_be_looked_for_is_told_first(
    call: Call, run: Path, tmp_path: Path, free: str, told: str
) -> None:
    answer = call("identify", run, "--free", free, "-o", tmp_path / "model.toml")
    assert answer.code == 2
    assert told in answer.err
    assert not list(tmp_path.iterdir())


def test_a_rig_that_hardly_strikes_is_refused(call: Call, run: Path, tmp_path: Path) -> None:
    wide = SCENARIO.replace('frequency = "20 Hz"', 'frequency = "20 Hz"\namplitude = "0.2 N"')
    scenario = f'{wide}\n[model]\nclearance = "10 mm"\n'
    quiet = record(tmp_path / "quiet.mcap", 1, scenario)
    answer = call("identify", quiet, "--free", "contact_stiffness", "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "it chatters in 0% of its cycles" in answer.err
    alone = call(
        "identify", run, "--frf", quiet, "--free", "contact_stiffness", "-o", tmp_path / "model.toml"
    )
    assert alone.code == 1
    assert "nothing strikes in it" in alone.err


def test_each_run_of_responses_has_an_option_of_its_own(call: Call, run: Path, tmp_path: Path) -> None:
    other, out = record(tmp_path / "other.mcap", 4), tmp_path / "model.toml"
    answer = call("identify", other, "--frf", run, "--frf", run, "--free", "contact_stiffness", "-o", out)
    assert answer.code == 2
    assert "each run once" in answer.err


def test_a_next_run_that_is_there_already_is_not_written_over(call: Call, run: Path, tmp_path: Path) -> None:
    (tmp_path / "model_next.toml").write_text("mine")
    answer = call("identify", run, "--free", "contact_stiffness", "-o", tmp_path / "model.toml")
    assert answer.code == 1
    assert "model_next.toml is there already" in answer.err
    assert (tmp_path / "model_next.toml").read_text() == "mine"


def test_runs_of_two_specimens_are_refused(call: Call, run: Path, tmp_path: Path) -> None:
    other = record(tmp_path / "other.mcap", 4, SCENARIO + '\n[notes]\nspecimen = "beam 7"\n')
    answer = call("identify", run, other, "--free", "contact_stiffness", "-o", tmp_path / "model.toml")
    assert answer.code == 2
    assert "runs of one rig" in answer.err
    assert "beam 7" in answer.err


def crank() -> tuple[Any, Any]:
    scenario = parse_scenario(CRANK)
    twin = twin_of(scenario)
    return scenario, setting_of(twin, twin.channels, RATE, 10)


def test_a_value_that_nothing_depends_on_is_told_before_any_long_work() -> None:
    scenario, setting = crank()
    keys = ("crank_inertia", "piston_mass")
    kind, twin = RIGS["planar_slider_crank"], setting.twin
    campaign = identifying([setting], [scenario], keys)
    wides = [wide_of(kind, key, scenario.model, twin) for key in keys]
    with pytest.raises(ConfigurationError, match="nothing that these runs show depends on it") as raised:
        require_moves(wides, campaign, campaign.observe)
    assert [each.key for each in raised.value.problems] == ["crank_inertia"]


def test_the_values_of_a_draw_are_those_of_its_rig() -> None:
    scenario, setting = crank()
    keys = ("piston_mass", "frame_crank_y_frequency")
    campaign = identifying([setting], [scenario], keys)
    values = {"piston_mass": 3.0, "frame_crank_y_frequency": 250.0}
    twin = campaign.changed(0, ((VALUES, values),))
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)) for seed in range(3)]
    assert [each.rig.piston_mass for each in drawn] == [3.0] * 3
    assert {each.rig.frames["crank_frame.acceleration_y"].frequency for each in drawn} == {250.0}
    assert len({each.rig.rod_mass for each in drawn}) == 3


def test_the_spatial_cranks_values_are_looked_for_in_its_recordings(tmp_path: Path) -> None:
    run = record(tmp_path / "spatial.mcap", 3, SPATIAL)
    free = {"guide_clearance": "", "slider_mass": "0.2 kg..0.5 kg"}
    data, wides, campaign = read_for([run], [], free, Screen(Terminal()))
    assert data.paths == (run,)
    require_moves(wides, campaign, campaign.observe)  # told before any long work otherwise
    lighter = campaign.changed(0, ((VALUES, {"guide_clearance": 3e-4, "slider_mass": 0.3}),))
    drawn = [lighter.model.draw_healthy(lighter, np.random.default_rng(seed)) for seed in range(3)]
    assert [each.rig.guide_clearance for each in drawn] == [3e-4] * 3
    assert {each.rig.slider.mass for each in drawn} == {0.3}


def test_one_of_several_numbers_is_looked_for_and_written_as_a_scenario_has_it() -> None:
    kind, scenario = RIGS["spatial_slider_crank"], parse_scenario(SPATIAL)
    twin = twin_of(scenario)
    with pytest.raises(FieldError, match=r"slider_pin\[1\], slider_pin\[2\] or slider_pin\[3\]"):
        wide_of(kind, "slider_pin", scenario.model, twin)
    wide = wide_of(kind, "slider_pin[2]", scenario.model, twin, "-2 mm..2 mm")
    assert (wide.centre, wide.low, wide.high) == (0.0, -2e-3, 2e-3)
    assert wide_of(kind, "slider_inertia[1]", scenario.model, twin).centre == pytest.approx(5.3e-5)
    campaign = identifying([], [scenario], ["slider_pin[2]"])
    assert campaign.rig == kind.name
    moved = kind.changed(twin.rig, scenario.model, {"slider_pin[2]": 1e-3})
    assert moved.slider.pin == (0.0, 1e-3, 0.0)
    assert replace(moved, slider=twin.rig.slider) == twin.rig
    told = replace(nothing_known([wide]), covariance=0.01 * np.eye(1))
    found = Identification(told, {wide.name: 0.0}, 1.0, converged=True)
    text = model_text_of(found, kind.name, ["run.mcap"], ["reference"])
    given = text[text.index("[model]") : text.index("[[identified]]")]
    assert parse_scenario(f"{SPATIAL}\n{given}").model == {"slider_pin[2]": 0.0}
    whole = parse_scenario(f'{SPATIAL}\n[model]\nslider_pin = ["1 mm", 0, 0]\n"slider_pin[3]" = "2 mm"\n')
    assert kind.built(whole.model).slider.pin == (1e-3, 0.0, 2e-3)


def test_the_damping_of_one_mode_is_looked_for_by_itself() -> None:
    kind, scenario = RIGS["impact_beam"], parse_scenario(SCENARIO)
    setting = setting_of(twin_of(scenario), twin_of(scenario).channels, RATE, 10)
    wide = wide_of(kind, "mode_damping[3]", scenario.model, setting.twin)
    assert (wide.centre, wide.deviation) == pytest.approx((0.01, 0.9))
    campaign = identifying([setting], [scenario], ["mode_damping[3]"])
    twin = campaign.changed(0, ((VALUES, {"mode_damping[3]": 0.03}),))
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)).rig for seed in range(3)]
    assert {each.modal_damping[2] for each in drawn} == {0.03}
    assert len({each.modal_damping[3] for each in drawn}) == 3
    given = parse_scenario(f'{SCENARIO}\n[model]\nmode_damping = [0.02]\n"mode_damping[3]" = "3 %"\n').model
    assert kind.built(given).modal_damping[:4] == pytest.approx((0.02, 0.01, 0.03, 0.01))
    few = {"modes": 2, "mode_damping[3]": 0.03}
    with pytest.raises(UnphysicalParameter, match=r"mode_damping\[3\] = 0.03: one of the 2 that there are"):
        kind.built(few)
    two = twin_of(replace(scenario, model={"modes": 2}))
    with pytest.raises(FieldError, match="a part that the rig has"):
        wide_of(kind, "mode_damping[3]", {"modes": 2}, two, "0.01..0.05")
    assert kind.value("mode_damping[3]", {"modes": 2}) is None


def test_values_are_looked_for_ten_times_as_far_as_healthy_rigs_lie() -> None:
    kind, scenario = RIGS["planar_slider_crank"], parse_scenario(CRANK)
    twin = twin_of(scenario)
    friction = wide_of(kind, "friction", scenario.model, twin)
    assert (friction.centre, friction.deviation, friction.low, friction.by_ratio) == (0.01, 0.03, 0, False)
    assert wide_of(kind, "piston_mass", scenario.model, twin).deviation == pytest.approx(0.03)
    assert wide_of(kind, "crank_inertia", scenario.model, twin).deviation == 0.5
    assert tolerance_of(kind, "crank_inertia", twin) is None
    with pytest.raises(FieldError, match="it is 0"):
        wide_of(kind, "guide_friction", scenario.model, twin)
    asked = wide_of(kind, "guide_friction", scenario.model, twin, "0.1..0.2")
    assert (asked.centre, asked.low, asked.high) == pytest.approx((0.15, 0.1, 0.2))


MODEL = """
rig = "impact_beam"
runs = ["run.mcap"]
scenarios = ["reference"]

[model]
contact_stiffness = "2.4e7 N/m"
modal_damping = 0.02

[[identified]]
key = "contact_stiffness"
low = 2.3e7
high = 2.5e7
was = 1.5e7

[[identified]]
key = "modal_damping"
low = 0.01
high = 0.03
was = 0.01
told = false
"""


def test_a_model_file_gives_the_values(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(MODEL)
    scenario, told = parse_scenario(SCENARIO), list[str]()
    model = load_model(tmp_path / "model.toml", "impact_beam")
    twin = with_model(twin_of(scenario), model, scenario, told.append)
    assert twin.rig.contact_stiffness == 2.4e7
    assert set(twin.rig.modal_damping) == {0.02}
    other = parse_scenario(SCENARIO + "\n[model]\ncontact_stiffness = 1e7\n")
    twin = with_model(twin_of(other), model, other, told.append)
    assert twin.rig.contact_stiffness == 1e7
    assert told == ["not as the runs of the model had it, so the scenario's value holds: contact_stiffness"]


def before_the_runs(*keys: str) -> Known:
    kind, scenario = RIGS["impact_beam"], parse_scenario(SCENARIO)
    return nothing_known([wide_of(kind, key, scenario.model, twin_of(scenario)) for key in keys])


def test_what_is_told_together_only_is_said_once_and_by_the_first_round_that_shows_it() -> None:
    known = before_the_runs("contact_stiffness", "beam_modulus")
    first = replace(known, covariance=np.diag([0.2, 0.7]))
    alike = replace(known, covariance=np.array([[1.0, 0.95], [0.95, 1.0]]))
    said = io.StringIO()
    rounds = [
        Round(9, each, np.array([0.1, 0.2]), np.zeros(2), converged=False, last=False)
        for each in (first, alike, alike)
    ]
    assert last_of(rounds, ["run.mcap"], Screen(Terminal(file=said, width=200))) is rounds[-1]
    lines = [line for line in said.getvalue().splitlines() if line.strip()]
    assert [line.startswith("round") for line in lines] == [True, False, True, False, True]
    assert "not told so far: beam_modulus;" in lines[1]
    assert "contact_stiffness and beam_modulus are told together only" in lines[3]


def test_runs_that_tell_nothing_end_the_search_after_its_first_round() -> None:
    known, asked = before_the_runs("contact_stiffness", "beam_modulus"), list[int]()

    def rounds() -> Iterator[Round]:
        for number in range(3):
            asked.append(number)
            yield Round(9, known, np.zeros(2), np.zeros(2), converged=False, last=False)

    with pytest.raises(RattleError, match="tell none of contact_stiffness and beam_modulus: nothing was"):
        last_of(rounds(), ["run.mcap"], Screen(Terminal(file=io.StringIO(), width=200)))
    assert asked == [0]


def test_runs_that_ask_for_different_values_end_the_search_after_its_first_round() -> None:
    known, names = before_the_runs("contact_stiffness"), ["a.mcap", "b.mcap", "c.mcap"]
    told = replace(known, covariance=0.01 * np.eye(1))
    quiet = Screen(Terminal(file=io.StringIO(), width=200))

    def rounds(*apart: float) -> Iterator[Round]:
        yield Round(9, told, np.zeros(1), np.zeros(1), False, False, apart)

    assert last_of(rounds(1.4, 1.0, 0.9), names, quiet).known is told
    with pytest.raises(
        RattleError, match=r"b\.mcap asks for other values than a\.mcap and c\.mcap: 2\.0 times"
    ):
        last_of(rounds(1.6, 2.0, 0.9), names, quiet)


def test_values_that_still_moved_are_said_to_and_have_wider_intervals() -> None:
    kind, scenario = RIGS["impact_beam"], parse_scenario(SCENARIO)
    wides = [
        wide_of(kind, key, scenario.model, twin_of(scenario)) for key in ("contact_stiffness", "beam_modulus")
    ]
    known = replace(nothing_known(wides), covariance=0.01 * np.eye(2))
    was = {"contact_stiffness": 1.5e7, "beam_modulus": 2.1e11}
    still, moving = (
        model_text_of(
            Identification(known.widened(wider), was, 1.0, converged),
            "impact_beam", ["run.mcap"], ["reference"],
        )
        for wider, converged in ((1.0, True), (np.array([1.0, 5.0**0.5]), False))
    )  # fmt: skip
    assert "still moved" in moving
    assert "still moved" not in still
    widths = [
        [each.high - each.low for each in parse_model(text, "model", "impact_beam").identified.values()]
        for text in (still, moving)
    ]
    assert widths[1][0] == pytest.approx(widths[0][0])
    assert widths[1][1] == pytest.approx(np.sqrt(5.0) * widths[0][1], rel=0.1)


def test_what_is_not_told_is_no_value_of_model_and_goes_with_the_others() -> None:
    kind, scenario = RIGS["impact_beam"], parse_scenario(SCENARIO)
    keys = ("contact_stiffness", "modal_damping")
    wides = [wide_of(kind, key, scenario.model, twin_of(scenario)) for key in keys]
    known = replace(nothing_known(wides), mean=np.ones(2), covariance=np.diag([0.01, 0.8]))
    was = {key: kind.value(key, scenario.model) for key in keys}
    found = Identification(known, was, 1.0, converged=True)
    text = model_text_of(found, kind.name, ["run.mcap"], ["reference"])
    tables = tomllib.loads(text)
    assert (set(tables["model"]), set(tables["not_told"])) == ({"contact_stiffness"}, {"modal_damping"})
    assert [row[1].startswith("-") for row in rows(found, kind.name)] == [False, True]
    model = parse_model(text, "model", kind.name)
    twin = with_model(twin_of(scenario), model, scenario, pytest.fail)
    assert twin.rig.contact_stiffness == pytest.approx(known.estimates()[0].value, rel=1e-5)
    assert set(twin.rig.modal_damping) == {model.model["modal_damping"]} != {was["modal_damping"]}
    assert tomllib.loads("\n".join(as_identified(model)))["not_told"] == tables["not_told"]


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('contact_stiffness = "2.4e7 N/m"', 'contact_stiffness = "2 N"', "model.contact_stiffness"),
        ("modal_damping = 0.02\n", "", "identified[2].key"),
        ("modal_damping = 0.02", 'modal_damping = 0.02\nbeam = "aluminium"', "model.beam"),
        ("modal_damping = 0.02", '[not_told]\nbeam = "aluminium"', "not_told.beam"),
        ("modal_damping = 0.02", "[not_told]\nyoke_frequency = 700", "not_told.yoke_frequency"),
        ("low = 2.3e7\n", "", "identified[1].low"),
        ("told = false", 'told = "no"', "identified[2].told"),
    ],
)
def test_faults_of_a_model_file_are_told(tmp_path: Path, old: str, new: str, key: str) -> None:
    assert old in MODEL
    (tmp_path / "model.toml").write_text(MODEL.replace(old, new))
    with pytest.raises(ConfigurationError) as raised:
        load_model(tmp_path / "model.toml", "impact_beam")
    assert key in [each.key for each in raised.value.problems]


def test_what_was_simulated_is_not_simulated_again(tmp_path: Path) -> None:
    asked: list[int] = []

    def simulate(draws: Sequence[Draw]) -> list[Observed]:
        asked.append(len(draws))
        return [(None if each.seed == 3 else np.full((2, 3), each.seed, np.float32),) for each in draws]

    draws = [Draw((), seed) for seed in range(20)]
    first = Kept(tmp_path / "kept", "a", simulate, 1)(draws)
    assert asked == [8, 8, 4]
    again = Kept(tmp_path / "kept", "a", simulate, 2)  # on a machine with more cores
    assert [each[0] is None for each in again(draws)] == [seed == 3 for seed in range(20)]
    for one, other in zip(first, again(draws), strict=True):
        assert (one[0] is None) is (other[0] is None)
        assert np.array_equal(np.array(one[0]), np.array(other[0]))
    assert asked == [8, 8, 4]
    next((tmp_path / "kept").iterdir()).write_bytes(b"damaged")
    Kept(tmp_path / "kept", "a", simulate, 1)(draws)
    Kept(tmp_path / "kept", "of another rig", simulate, 2)(draws)
    assert asked[-2:] == [16, 4]
    assert sum(asked[3:]) in (24, 28)


def no_time(draws: Sequence[Draw]) -> list[Observed]:
    return [() for _ in draws]


def test_what_there_was_no_time_for_is_not_kept(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "kept", "a", no_time, 4)
    with pytest.raises(OutOfTime, match="time ran out: nothing was written"):
        kept([Draw((), 1)])
    assert not (tmp_path / "kept").exists()


def test_of_what_workers_had_time_for_whole_groups_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ensembles, "cores", lambda: 2)
    simulated = Simulated(Numbered(), Here(able=3), time.monotonic(), lambda _: None)
    draws = [Draw(((VALUES, {"a": float(seed)}),), seed) for seed in range(32)]
    with pytest.raises(OutOfTime):
        Kept(tmp_path / "kept", "a", simulated, 4)(draws)
    again = Kept(tmp_path / "kept", "a", no_time, 4)
    with pytest.raises(OutOfTime):
        again(draws)
    assert again.found == 24


def test_time_that_runs_out_once_the_values_are_found_is_told_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario, setting = crank()
    campaign = identifying([setting], [scenario], ["piston_mass"])
    wides = [wide_of(RIGS["planar_slider_crank"], "piston_mass", scenario.model, setting.twin)]
    known = replace(nothing_known(wides), covariance=0.01 * np.eye(1))
    found = Round(9, known, np.zeros(1), np.zeros(1), converged=True, last=True)
    monkeypatch.setattr(work, "worker_processes", lambda _: nullcontext(SimpleNamespace(executor=None)))
    monkeypatch.setattr(work, "require_moves", lambda *_: None)
    monkeypatch.setattr(work, "fitted_rounds", lambda *_: [found])
    monkeypatch.setattr(work, "Simulated", lambda *_: no_time)
    blocks = np.zeros((1, campaign.layout.size), np.float32)
    data = RecordedCampaign(campaign, blocks, (), (Path("run.mcap"),), (), (CRANK,), (), (), {}, None)
    with pytest.raises(RattleError, match="time ran out: nothing was written"):
        work.identify(data, wides, campaign, tmp_path / "kept", 0, 10.0, Screen(Terminal()))


def test_nothing_is_known_beforehand() -> None:
    kind, scenario = RIGS["planar_slider_crank"], parse_scenario(CRANK)
    wide = wide_of(kind, "piston_mass", scenario.model, twin_of(scenario))
    assert nothing_known([wide]).told() == (False,)


def test_a_value_is_told_by_the_interval_that_is_written() -> None:
    """A gap of 1.9 doubles it."""
    scenario = parse_scenario(SCENARIO)
    wide = wide_of(RIGS["impact_beam"], "yoke_frequency", scenario.model, twin_of(scenario))
    known = replace(nothing_known([wide]), covariance=0.4**2 * np.eye(1))
    assert (known.told(), known.widened(1.9).told()) == ((True,), (False,))


def test_a_value_at_the_end_of_where_it_was_looked_for_is_none() -> None:
    scenario, kind = parse_scenario(SCENARIO), RIGS["impact_beam"]
    wide = wide_of(kind, "yoke_frequency", scenario.model, twin_of(scenario), "400 Hz..500 Hz")
    known = replace(nothing_known([wide]), mean=np.array([4.5]), covariance=0.01 * np.eye(1))
    assert (known.told(), known.at_ends()) == ((False,), ["yoke_frequency"])
    text = model_text_of(Identification(known, {wide.name: 450.0}, 1.0, True), kind.name, ["run.mcap"], ["a"])
    assert (
        "# yoke_frequency lies at the end of where it was looked for: --free yoke_frequency=LOW..HIGH" in text
    )
    assert "yoke_frequency" not in tomllib.loads(text).get("model", {})


def test_a_single_value_at_the_end_of_its_range_is_refused_with_that() -> None:
    scenario = parse_scenario(SCENARIO)
    wide = wide_of(RIGS["impact_beam"], "yoke_frequency", scenario.model, twin_of(scenario), "400 Hz..500 Hz")
    known = replace(nothing_known([wide]), mean=np.array([4.5]), covariance=0.01 * np.eye(1))
    assert known.open() == (False,)
    assert "yoke_frequency=LOW..HIGH with a wider range" in str(work._nothing_told(known))
