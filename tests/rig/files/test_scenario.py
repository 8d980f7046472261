from __future__ import annotations

import contextlib
import math
import pickle
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daq.errors import ConfigurationError
from rig.files.scenario import Limit, Scenario, load_scenario, parse_scenario
from rig.rigs import RIGS, unit_of
from rig.twin.scenario_twin import twin_of
from sim_twin.rigs.impact_beam.channels import stations_of
from tests.rig.files.faulty import only_problem, problems_of

SCENARIOS = Path(__file__).parents[3] / "scenarios"
SOUND = (SCENARIOS / "impact_beam.toml").read_text()


def changed(old: str, new: str) -> str:
    assert old in SOUND
    return SOUND.replace(old, new)


def with_model(line: str) -> str:
    return changed('clearance = "0.127 mm"', line)


def test_main_scenario_is_read_in_si() -> None:
    scenario = load_scenario(SCENARIOS / "impact_beam.toml")
    assert (scenario.name, scenario.rig) == ("steel beam, 20 Hz", "impact_beam")
    assert (scenario.model["beam"], scenario.model["clearance"]) == ("steel", 0.127e-3)
    assert (scenario.drive.frequency, scenario.drive.amplitude, scenario.drive.offset) == (20.0, 9.0, 0.0)
    acquisition = scenario.acquisition
    assert (acquisition.sample_rate, acquisition.settle, acquisition.duration) == (51200.0, 1.0, 5.0)
    assert scenario.limits == ()
    assert scenario.text == SOUND


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("impact_beam*.toml")), ids=lambda path: path.stem)
def test_every_scenario_of_the_project_is_sound(path: Path) -> None:
    assert load_scenario(path).rig == "impact_beam"


def test_key_that_is_not_given_is_none() -> None:
    model = parse_scenario(SOUND).model
    assert model.get("modes") is None
    assert model.get("rest_offset") is None
    assert model.get("flexure_translation") is None


def test_bare_number_is_si() -> None:
    assert parse_scenario(with_model("clearance = 0.000254")).model["clearance"] == 0.000254


def test_scenario_reaches_a_worker_process_unchanged() -> None:
    scenario = parse_scenario(SOUND)
    assert pickle.loads(pickle.dumps(scenario)) == scenario  # noqa: S301


def test_every_model_key_is_read() -> None:
    text = with_model(
        """clearance = "0.254 mm"
        base = "rigid"
        cover = "none"
        rest_offset = "-0.1 mm"
        modal_damping = "1 %"
        modes = 20
        elements = 40
        contact_stiffness = "15 MN/m"
        contact_damping = "20 N s/m"
        drive_position = 0.69
        shaker_mass = "20 g"
        shaker_stiffness = "3 kN/m"
        shaker_damping = "27 N s/m"
        flexure_translation = true"""
    )
    model = parse_scenario(text).model
    assert (model["rest_offset"], model["modal_damping"], model["modes"]) == (-0.1e-3, 0.01, 20)
    assert (model["contact_stiffness"], model["contact_damping"], model["drive_position"]) == (
        15e6,
        20.0,
        0.69,
    )
    assert (model["shaker_mass"], model["shaker_stiffness"], model["shaker_damping"]) == (0.02, 3000.0, 27.0)
    assert model["flexure_translation"] is True


@pytest.mark.parametrize(
    ("text", "key", "value", "allowed"),
    [
        (with_model('clearance = "-1 mm"'), "model.clearance", '"-1 mm"', "0 mm to 10 mm"),
        (with_model("clearance = nan"), "model.clearance", "nan", "0 mm to 10 mm"),
        (with_model("clearance = true"), "model.clearance", "true", "not a number"),
        (with_model('clearance = "1 V"'), "model.clearance", '"1 V"', "V is not a unit of this kind"),
        (with_model('clearance = "0.127"'), "model.clearance", '"0.127"', "the unit is missing"),
        (with_model('clearence = "1 mm"'), "model.clearence", '"1 mm"', "did you mean model.clearance?"),
        (with_model("modal_damping = 1.5"), "model.modal_damping", "1.5", "0 to 0.5"),
        (with_model('shaker_mass = "-20 g"'), "model.shaker_mass", '"-20 g"', "0 kg to 10 kg"),
        (with_model("modes = 7.5"), "model.modes", "7.5", "a whole number from 1 to 400"),
        (with_model("modes = true"), "model.modes", "true", "a whole number"),
        (with_model("flexure_translation = 1"), "model.flexure_translation", "1", "true or false"),
        (with_model('base = "soft"'), "model.base", '"soft"', '"rigid" or "flexible"'),
        (with_model('cover = "aluminium"'), "model.cover", '"aluminium"', 'with base = "flexible"'),
        (with_model('cover = "steel"'), "model.cover", '"steel"', '"none" or "aluminium" or "fibreglass"'),
        (
            with_model('rest_offset = "0.127 mm"'),
            "model.rest_offset",
            '"0.127 mm"',
            "the clearance, 0.127 mm",
        ),
        (with_model("modes = 76"), "model.modes", "76", "75 for 37 elements"),
        (with_model("elements = 5"), "model.elements", "5", "11 for 5 elements"),
        (changed('"steel"', '"brass"'), "model.beam", '"brass"', '"steel" or "aluminium"'),
        (changed('"20 Hz"', '"1200 rpm"'), "drive.frequency", '"1200 rpm"', "0.1 Hz to 2000 Hz"),
        (changed('frequency = "20 Hz"', ""), "drive.frequency", "(missing)", "0.1 Hz to 2000 Hz"),
        (changed('"9 N"', '"101 N"'), "drive.amplitude", '"101 N"', "0 N to 100 N"),
        (changed('"9 N"', '"60 N"\noffset = "-50 N"'), "drive.offset", '"-50 N"', "not 110 N"),
        (changed('"51.2 kHz"', '"500 Hz"'), "acquisition.sample_rate", '"500 Hz"', "1000 Hz to 204800 Hz"),
        (changed('"51.2 kHz"', "1e999"), "acquisition.sample_rate", "inf", "1000 Hz to 204800 Hz"),
        (changed('"5 s"', '"0 s"'), "acquisition.duration", '"0 s"', "0.001 s to 86400 s"),
        (changed('"1 s"', '"-1 s"'), "acquisition.settle", '"-1 s"', "0 s to 3600 s"),
        (changed('"impact_beam"', '"slider_crank"'), "rig", '"slider_crank"', '"planar_slider_crank"'),
        (changed('rig = "impact_beam"', ""), "rig", "(missing)", '"impact_beam"'),
        (changed("[drive]", "[drvie]"), "drvie", "{...}", "did you mean drive?"),
        (changed('"steel beam, 20 Hz"', "20"), "name", "20", "a text of one line"),
    ],
)
def test_fault_is_told_with_key_value_and_range(text: str, key: str, value: str, allowed: str) -> None:
    problem = problems_of(lambda: parse_scenario(text))[key]
    assert problem.value == value
    assert allowed in problem.allowed


def test_rate_is_2_56_times_the_drive_or_more() -> None:
    fast = changed('"20 Hz"', '"1 kHz"')
    assert parse_scenario(fast.replace("51.2 kHz", "2560 Hz")).acquisition.sample_rate == 2560.0
    slow = fast.replace("51.2 kHz", "2.5 kHz")
    problem = only_problem(lambda: parse_scenario(slow), "acquisition.sample_rate")
    assert str(problem) == (
        'acquisition.sample_rate = "2.5 kHz": at least 2560 Hz (2.56 times the drive\'s 1000 Hz)'
    )


def test_clamped_beam_has_one_mode_less_and_no_flexure() -> None:
    aluminium = changed('"steel"', '"aluminium"')
    assert parse_scenario(aluminium + "[limits]\n").model["beam"] == "aluminium"
    pinned = with_model("modes = 75")
    assert parse_scenario(pinned).model["modes"] == 75
    clamped = pinned.replace('"steel"', '"aluminium"').replace(
        "[drive]", "flexure_translation = true\n[drive]"
    )
    assert set(problems_of(lambda: parse_scenario(clamped))) == {"model.modes", "model.flexure_translation"}


@pytest.mark.parametrize(
    ("given", "key", "allowed"),
    [
        ("mode_damping = 0.02", "mode_damping", "a list, each 0 to 0.5"),
        ("mode_damping = [0.02, 0.6]", "mode_damping", "0 to 0.5"),
        ("modes = 1\nmode_damping = [0.02, 0.03]", "mode_damping", "as many at most as modes are kept, 1"),
        (
            'beam = "aluminium"\nflexure_length = "3 mm"',
            "flexure_length",
            "none (the aluminium beam is clamped)",
        ),
    ],
)
def test_damping_of_modes_and_a_flexure_have_to_be_there(given: str, key: str, allowed: str) -> None:
    text = SOUND.replace('beam = "steel"\n', "").replace('clearance = "0.127 mm"', given)
    assert allowed in only_problem(lambda: parse_scenario(text), f"model.{key}").allowed


def test_the_lowest_modes_have_their_own_damping() -> None:
    rig = twin_of(parse_scenario(with_model("modes = 4\nmode_damping = [0.02, '3 %']"))).rig
    assert rig.modal_damping == pytest.approx((0.02, 0.03, 0.01, 0.01), rel=1e-12)


def test_a_part_of_a_crank_is_there_before_its_keys_are() -> None:
    rest = '[drive]\nspeed = "200 rpm"\n[acquisition]\nsample_rate = "25.6 kHz"\nduration = "1 s"\n'
    for rig, word, key in (
        ("spatial_slider_crank", "base", 'base_mass = "2 kg"'),
        ("planar_slider_crank", "rod", 'rod_bending_frequency = "90 Hz"'),
    ):
        text = f'rig = "{rig}"\n[model]\n{key}\n{rest}'
        name = f"model.{key.partition(' ')[0]}"
        assert f"another {word} than rigid" in only_problem(partial(parse_scenario, text), name).allowed
        assert parse_scenario(text.replace(key, f'{key}\n{word} = "flexible"')).rig == rig


def test_a_contact_of_curved_surfaces_takes_the_place_of_a_linear_one() -> None:
    rig = twin_of(parse_scenario(with_model("contact_hertz = 1e10"))).rig
    assert rig.hertz == 1e10
    assert (
        "100000 to 1e+13"
        in only_problem(
            lambda: parse_scenario(with_model("contact_hertz = 0")), "model.contact_hertz"
        ).allowed
    )


def test_another_plate_gives_a_flexible_base_another_mode() -> None:
    rest = '[drive]\nspeed = "200 rpm"\n[acquisition]\nsample_rate = "25.6 kHz"\nduration = "1 s"\n'
    kind = RIGS["spatial_slider_crank"]
    text = f'rig = "spatial_slider_crank"\n[model]\nplate_thickness = "26 mm"\n{rest}'
    assert "with base = " in only_problem(partial(parse_scenario, text), "model.plate_thickness").allowed
    thick = parse_scenario(text.replace("plate", 'base = "flexible"\nplate', 1)).model
    plain = kind.built({"base": "flexible"}).base
    thicker = kind.built(thick).base
    assert (thicker.frequency, thicker.mass) == pytest.approx((2 * plain.frequency, 2 * plain.mass))
    # a plate half as long and half as wide bends at four times the frequency
    small = kind.built({"base": "flexible", "plate_length": 0.28, "plate_width": 0.23}).base
    assert (small.frequency, small.mass) == pytest.approx((4 * plain.frequency, plain.mass / 4))


def test_every_fault_is_told_at_once() -> None:
    text = """
        rig = "impact_beam"
        speed = 3
        [model]
        base = "soft"
        clearance = "-1 mm"
        modes = 80
        [drive]
        frequency = "1 kHz"
        amplitude = "9 V"
        [acquisition]
        sample_rate = "2 kHz"
        [limits."yoke.force"]
        abort = "5 m"
    """
    assert set(problems_of(lambda: parse_scenario(text))) == {
        "speed",
        "model.base",
        "model.clearance",
        "model.modes",
        "drive.amplitude",
        "acquisition.sample_rate",
        "acquisition.duration",
        'limits."yoke.force".abort',
    }


@pytest.mark.parametrize(
    ("text", "key", "units"),
    [
        (
            '[limits."crank_frame.acceleration_y"]\nabort = 50',
            'limits."crank_frame.acceleration_y".abort',
            "m/s2 or g",
        ),
        ("[model]\nincline = 30", "model.incline", "deg or rad"),
        ("[model]\ngravity = 1", "model.gravity", "m/s2 or g"),
    ],
)
def test_a_bare_number_is_neither_an_angle_nor_an_acceleration(text: str, key: str, units: str) -> None:
    scenario = (SCENARIOS / "planar_slider_crank.toml").read_text().replace("[model]", "[notes]")
    problem = only_problem(lambda: parse_scenario(f"{scenario}\n{text}"), key)
    assert problem.allowed.endswith(f"(the unit is missing: {units})")


@pytest.mark.parametrize("key", ["warning", "abort"])
def test_a_bare_number_is_no_limit_of_a_speed(key: str) -> None:
    text = (SCENARIOS / "spatial_slider_crank.toml").read_text()
    problem = only_problem(
        lambda: parse_scenario(f'{text}\n[limits."motor.tachometer"]\n{key} = 300'),
        f'limits."motor.tachometer".{key}',
    )
    assert problem.allowed.startswith("above 0 rad/s")
    assert problem.allowed.endswith("(the unit is missing: rpm or rad/s)")
    (limit,) = parse_scenario(f'{text}\n[limits."motor.tachometer"]\n{key} = "300 rpm"').limits
    assert getattr(limit, key) == pytest.approx(10 * math.pi)


@pytest.mark.parametrize("table", ['[limits."contact.force_upper"]', "[limits.contact.force_upper]"])
def test_limits_are_read_in_the_channels_unit(table: str) -> None:
    text = f'{SOUND}\n{table}\nwarning = "150 N"\nabort = "0.2 kN"\nhold = "10 ms"\n'
    assert parse_scenario(text).limits == (Limit("contact.force_upper", "N", 150.0, 200.0, 0.01),)


def test_limit_of_an_acceleration_takes_g() -> None:
    text = f'{SOUND}\n[limits."beam.acceleration_50"]\nabort = "20 g"\n'
    (limit,) = parse_scenario(text).limits
    assert (limit.channel, limit.unit, limit.warning) == ("beam.acceleration_50", "m/s2", None)
    assert limit.abort is not None
    # standard gravity is 9.80665 m/s2; the rest is rounding
    assert math.isclose(limit.abort, 196.133, rel_tol=1e-14)


@pytest.mark.parametrize(
    ("lines", "key", "allowed"),
    [
        ('[limits."yoke.forse"]\nabort = 1', 'limits."yoke.forse"', 'did you mean limits."yoke.force"?'),
        ('[limits."yoke.force"]\nabort = "5 m/s^2"', 'limits."yoke.force".abort', "not a unit of this kind"),
        ('[limits."yoke.force"]\nabort = "-5 N"', 'limits."yoke.force".abort', "above 0 N"),
        ('[limits."yoke.force"]\nabort = 5\nhold = "-1 s"', 'limits."yoke.force".hold', "0 s to 60 s"),
        (
            '[limits."yoke.force"]\nabort = 5\nwarning = 6',
            'limits."yoke.force".warning',
            "not above abort, 5",
        ),
        ('[limits."yoke.force"]', 'limits."yoke.force"', "warning or abort"),
        (
            '[limits."yoke.force"]\nabrot = 5',
            'limits."yoke.force".abrot',
            'did you mean limits."yoke.force".abort?',
        ),
        ('[limits]\n"yoke.force" = 5', 'limits."yoke.force"', "a table"),
    ],
)
def test_faulty_limit_is_told(lines: str, key: str, allowed: str) -> None:
    assert allowed in only_problem(lambda: parse_scenario(f"{SOUND}\n{lines}\n"), key).allowed


@pytest.mark.parametrize(
    ("channel", "station"),
    [
        ("beam.acceleration_01", (1,)),
        ("beam.acceleration_69", (69,)),
        ("beam.acceleration_100", (100,)),
        ("beam.acceleration_00", ()),
        ("beam.acceleration_101", ()),
        ("beam.acceleration_5", ()),
        ("yoke.force", ()),
    ],
)
def test_beam_accelerometer_is_named_by_its_place(channel: str, station: tuple[int, ...]) -> None:
    assert stations_of((channel,)) == station
    assert (unit_of(channel) is None) == (station == () and channel != "yoke.force")


def test_syntax_error_is_told_with_its_line() -> None:
    with pytest.raises(ConfigurationError, match=re.escape("at line 2")):
        parse_scenario('name = "x"\nrig = \n')


@pytest.mark.parametrize("text", ["a = " + "[" * 5000, "a = 1" + "0" * 5000, "rig = 1" + "0" * 4000])
def test_hostile_text_is_a_configuration_error(text: str) -> None:
    with pytest.raises(ConfigurationError, match="scenario:"):
        parse_scenario(text)


def test_missing_file_folder_and_binary_are_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file"):
        load_scenario(tmp_path / "absent.toml")
    with pytest.raises(ConfigurationError, match="Is a directory"):
        load_scenario(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="UTF-8 text"):
        load_scenario(binary)


VALUES = st.one_of(
    st.text(max_size=8),
    st.integers(),
    st.floats(),
    st.booleans(),
    st.sampled_from(["1 mm", "-1 N", "20 Hz", "steel", "rigid", "1e400 m"]),
)


def as_toml(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return '"' + "".join(f"\\U{ord(letter):08X}" for letter in value if letter.isprintable()) + '"'
        case _:
            return repr(value)


# the first example loads the unit registry, which takes longer than hypothesis's deadline
@settings(deadline=None)
@given(
    key=st.sampled_from(["beam", "clearance", "modes", "elements", "rest_offset", "modal_damping", "cover"]),
    value=VALUES,
)
@example(key="modes", value=10**400)
@example(key="clearance", value=10**400)
def test_any_value_gives_a_scenario_or_a_configuration_error(key: str, value: object) -> None:
    with contextlib.suppress(ConfigurationError):
        assert isinstance(parse_scenario(with_model(f"{key} = {as_toml(value)}")), Scenario)


@given(text=st.text(max_size=80))
def test_any_text_gives_a_configuration_error(text: str) -> None:
    with pytest.raises(ConfigurationError, match="scenario:"):
        parse_scenario(text)


@pytest.mark.parametrize("written", ['[limits."contact.force_upper"]', "[limits.contact.force_upper]"])
def test_other_values_stand_in_the_scenario_as_if_they_had_been_written(tmp_path: Path, written: str) -> None:
    """Also of a channel with limits, whichever way its table is written."""
    file = tmp_path / "s.toml"
    file.write_text(f'{SOUND}\n{written}\nwarning = "50 N"\nabort = "90 N"\n')
    settings = {"limits.contact.force_upper.abort": "80 N", "limits.yoke.force.warning": 7, "name": "other"}
    found = load_scenario(file, settings)
    assert found.name == "other"
    assert found.drive == load_scenario(file).drive
    assert sorted(found.limits, key=lambda limit: limit.channel) == [
        Limit("contact.force_upper", "N", 50.0, 80.0),
        Limit("yoke.force", "N", 7.0, None),
    ]
    again = parse_scenario(found.text)
    assert (again.name, again.drive, set(again.limits)) == (found.name, found.drive, set(found.limits))


def test_a_scenario_with_another_rig_or_drive_has_them_in_its_name(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(SOUND)
    was = parse_scenario(SOUND).name
    assert load_scenario(file, {"drive.frequency": "21 Hz", "acquisition.duration": "3 s"}).name == (
        f"{was}, frequency 21 Hz"
    )
    assert load_scenario(file, {"acquisition.duration": "3 s", "notes.operator": "Ada"}).name == was


def test_notes_are_free_keys_that_say_what_a_run_was() -> None:
    text = SOUND + '[notes]\noperator = "Ada"\nspecimen = 3\nmounted = 2026-11-23\n'
    assert parse_scenario(text).notes == {"operator": "Ada", "specimen": "3", "mounted": "2026-11-23"}
    assert parse_scenario(SOUND).notes == {}
    noted = load_scenario(SCENARIOS / "impact_beam.toml", {"notes.operator": "Ada"})
    assert noted.notes == {"operator": "Ada"}
    assert parse_scenario(noted.text).notes == {"operator": "Ada"}


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ('operator = "a\\nb"', "notes.operator"),
        ('"a b" = "c"', "notes.a b"),
        (f'operator = "{501 * "a"}"', "notes.operator"),
        ("operator = [1]", "notes.operator"),
        ('inner.key = "c"', "notes.inner"),
    ],
)
def test_a_note_is_one_line_under_a_plain_key(line: str, key: str) -> None:
    only_problem(lambda: parse_scenario(f"{SOUND}[notes]\n{line}\n"), key)


@pytest.mark.parametrize(
    ("line", "key", "allowed"),
    [
        ('contact_stifness = "8 %"', "contact_stifness", "did you mean tolerances.contact_stiffness"),
        ('contact_stiffness = "8 N/m"', "contact_stiffness", "a standard deviation, 0 to 2.5"),
        ("contact_stiffness = 3", "contact_stiffness", "a standard deviation, 0 to 2.5"),
        ('"yoke.force.time" = "8 %"', '"yoke.force.time"', "a standard deviation, 0 s to 0.0001 s"),
        ('pivot_rotation_stiffness = "40 %"', "pivot_rotation_stiffness", "a standard deviation, 0 to 0.3"),
        ('rest_offset = "4 %"', "rest_offset", "a standard deviation, 0 mm to 10 mm"),
        ('base_mass = "4 %"', "base_mass", "did you mean"),
        ('pivot_stiffness = "4 %"', "pivot_stiffness", "of a part that the rig has"),
        ('"beam.thickness" = "1 %"\nbeam_thickness = "2 %"', "beam_thickness", "once: it is beam.thickness"),
    ],
)
def test_a_labs_tolerances_are_checked(line: str, key: str, allowed: str) -> None:
    text = f"{with_model('')}\n[tolerances]\n{line}\n"
    problem = only_problem(lambda: parse_scenario(text), f"tolerances.{key}")
    assert allowed in problem.allowed


def test_a_lab_says_in_what_else_its_rigs_differ() -> None:
    lines = 'pivot_rotation_stiffness = "10 %"\nrest_offset = "0.02 mm"\nbeam_thickness = "1 %"'
    scenario = parse_scenario(f"{with_model('')}\n[tolerances]\n{lines}\n")
    assert scenario.widths == pytest.approx({"beam.thickness": 1 / 0.3})
    twin = twin_of(scenario)
    seeds = np.random.SeedSequence(5).spawn(400)
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)) for seed in seeds]
    # 400 draws know a deviation to 3.5 %; four of them
    turning = np.array([each.rig.rotation_stiffness for each in drawn])
    assert turning.std() / twin.rig.rotation_stiffness == pytest.approx(0.1, rel=0.15)
    resting = np.array([each.rig.rest_offset for each in drawn])
    assert resting.std() == pytest.approx(0.02e-3, rel=0.15)
    assert {each.name for each in scenario.besides if each.each_run} == {"rest_offset"}


def test_a_tolerance_makes_no_rig_that_cannot_be() -> None:
    lines = 'rest_offset = "5 mm"'
    twin = twin_of(parse_scenario(f"{with_model('')}\n[tolerances]\n{lines}\n"))
    seeds = np.random.SeedSequence(6).spawn(100)
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)) for seed in seeds]
    assert all(abs(each.rig.rest_offset) <= each.rig.clearance for each in drawn)


def test_a_labs_tolerances_are_those_of_its_healthy_rigs() -> None:
    lines = 'contact_stiffness = "10 %"\n"yoke.force.gain" = 0.0\n"yoke.force.time" = "4e-6 s"'
    scenario = parse_scenario(f"{with_model('')}\n[tolerances]\n{lines}\n")
    assert scenario.widths == pytest.approx(
        {"contact_stiffness": 2.0, "yoke.force.gain": 0.0, "yoke.force.time": 2.0}
    )
    twin = twin_of(scenario)
    drawn = [twin.model.draw_healthy(twin, np.random.default_rng(seed)) for seed in range(400)]
    # 400 draws know a deviation to 3.5 %; four of them
    stiffness = np.array([each.rig.contact_stiffness for each in drawn])
    assert stiffness.std() / 1.5e7 == pytest.approx(0.1, rel=0.15)
    assert {each.sensors["yoke.force"].gain for each in drawn} == {1.0}
    assert np.array([each.rig.beam.E for each in drawn]).std() / 207e9 == pytest.approx(0.01, rel=0.15)
