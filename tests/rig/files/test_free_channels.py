"""Channels that no rig has, a microphone or a thermometer: their units, and limits on them."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from drivers.ni_daq.channels import problems
from rig.emulation import wiring_of
from rig.files.bench import Bench, embedded_bench, parse_bench
from rig.files.pairing import check_bench, check_pair
from rig.files.scenario import Limit, Scenario, parse_scenario
from tests.rig.files.faulty import only_problem, problems_of

SCENARIOS = Path(__file__).parents[3] / "scenarios"
TEXT = (SCENARIOS / "crank_bench.example.toml").read_text()
PLANAR = (SCENARIOS / "planar_slider_crank.toml").read_text()
TODAY = datetime.date(2026, 11, 22)


def parse(text: str) -> Bench:
    return parse_bench(text, "bench", Path(), "planar_slider_crank")


MICROPHONE = """
[[daq_card.channels]]
name = "room.sound"
physical = "cDAQ1Mod4/ai0"
kind = "voltage"
modelled = false
sensitivity = 1.0
range = "5 V"
"""


def test_a_channel_that_no_rig_has_is_of_its_sensor() -> None:
    bench = parse(TEXT + MICROPHONE)
    check_bench(bench, TODAY)
    channel = bench.daq_card.channels[-1]
    assert (channel.unit, channel.location, channel.quantity) == ("V", "room", "sound")
    assert wiring_of(bench).wires["cDAQ1Mod4/ai0"].plant_channel == ""


@pytest.mark.parametrize(
    ("kind", "sensitivity", "full", "unit", "volts_each", "largest"),
    [
        ("voltage", '"50 mV/Pa"', '"20 Pa"', "Pa", 0.05, 20.0),
        ("voltage", '"1 V/bar"', '"500 kPa"', "Pa", 1e-5, 5e5),
        ("voltage", '"10 mV/degC"', '"150 °C"', "degC", 0.01, 150.0),
        ("voltage", '"10 mV/°C"', '"400 K"', "K", 0.01, 400.0),
        ("voltage", '"100 mV/g"', '"50 g"', "m/s2", 0.1 / 9.80665, 490.3325),
        ("voltage", '"0.1 V/(N m)"', '"20 N m"', "N m", 0.1, 20.0),
        ("voltage", "0.5", "8", "V", 0.5, 8.0),
        ("microphone_iepe", '"50 mV/Pa"', '"100 Pa"', "Pa", 0.05, 100.0),
        ("charge_amplifier", '"20 pC/bar"\ngain = "1 mV/pC"', '"250 bar"', "Pa", 2e-7, 2.5e7),
        ("charge_amplifier", '"10 pC/g"\ngain = "1 mV/pC"', '"50 g"', "m/s2", 0.01 / 9.80665, 490.3325),
    ],
)
def test_a_channel_that_no_rig_has_is_in_the_unit_of_its_range(
    kind: str, sensitivity: str, full: str, unit: str, volts_each: float, largest: float
) -> None:
    text = MICROPHONE.replace('"voltage"', f'"{kind}"').replace("= 1.0", f"= {sensitivity}")
    bench = parse(TEXT + text.replace('"5 V"', full))
    channel = bench.daq_card.channels[-1]
    assert channel.unit == unit
    assert (channel.volts_per_unit, channel.range) == (pytest.approx(volts_each), pytest.approx(largest))
    assert problems(replace(bench.daq_card, sample_rate_hz=25_600.0)) == []


@pytest.mark.parametrize(
    ("old", "new", "key", "allowed"),
    [
        ('"5 V"', '"94 dB"', "range", "above 0 V, up to 1000 V (dB is no multiple of a unit)"),
        ('"5 V"', '"100 %"', "range", "above 0 V"),
        ('"5 V"', '"20 Pa"\nsensitivity = "50 mV/N"', "sensitivity", "mV/N is not a unit of this kind"),
        ('"voltage"', '"force_iepe"', "range", "above 0 N"),
    ],
)
def test_a_unit_that_no_channel_can_have_is_refused(old: str, new: str, key: str, allowed: str) -> None:
    text = MICROPHONE.replace("sensitivity = 1.0\n", "" if "sensitivity" in new else "sensitivity = 1.0\n")
    told = problems_of(lambda: parse(TEXT + text.replace(old, new)))
    assert allowed in told[f'daq_card.channels."room.sound".{key}'].allowed


HEARD = MICROPHONE.replace("= 1.0", '= "50 mV/Pa"').replace('"5 V"', '"20 Pa"')


def limited(levels: str) -> Scenario:
    return parse_scenario(f'{PLANAR}[limits."room.sound"]\n{levels}\n')


def test_a_limit_of_a_channel_that_no_rig_has_is_in_its_own_unit() -> None:
    scenario = limited('warning = "5 Pa"\nabort = "0.01 kPa"')
    assert scenario.limits == (Limit("room.sound", "Pa", 5.0, 10.0),)
    check_pair(scenario, parse(TEXT + HEARD), TODAY)
    warm = MICROPHONE.replace("= 1.0", '= "10 mV/degC"').replace('"5 V"', '"150 degC"')
    felt = limited('abort = "5 g"')
    assert felt.limits == (Limit("room.sound", "m/s2", None, pytest.approx(49.03325)),)
    check_pair(
        felt, parse(TEXT + MICROPHONE.replace("= 1.0", '= "100 mV/g"').replace('"5 V"', '"50 g"')), TODAY
    )
    assert limited('abort = "200 bar"').limits == (Limit("room.sound", "Pa", None, 2e7),)
    hot = limited('abort = "80 °C"')
    assert hot.limits == (Limit("room.sound", "degC", None, 80.0),)
    check_pair(hot, parse(TEXT + warm), TODAY)


@pytest.mark.parametrize(
    ("levels", "value", "allowed"),
    [
        ('abort = "2 V"', "2 V", "in Pa, the channel's unit"),
        ('abort = "80 degC"', "80 degC", "in Pa, the channel's unit"),
        ('abort = "25 Pa"', "25 Pa", "below 20 Pa, the channel's range"),
    ],
)
def test_a_limit_of_another_kind_than_its_channel_is_refused(levels: str, value: str, allowed: str) -> None:
    bench = parse(TEXT + HEARD)
    problem = only_problem(lambda: check_pair(limited(levels), bench, TODAY), 'limits."room.sound".abort')
    assert (problem.value, problem.allowed) == (value, allowed)


def test_kelvin_are_no_degrees_celsius() -> None:
    warm = MICROPHONE.replace("= 1.0", '= "10 mV/degC"').replace('"5 V"', '"150 degC"')
    bench = parse(TEXT + warm)
    with pytest.raises(ConfigurationError, match=r"abort = 353 K: in degC, the channel's unit"):
        check_pair(limited('abort = "353 K"'), bench, TODAY)


def test_a_limit_of_a_channel_that_the_bench_has_not_is_refused() -> None:
    """It may be mistyped: a scenario alone does not know what hangs on the bench."""
    scenario = parse_scenario(f'{PLANAR}[limits."crank_frme.acceleration_x"]\nabort = "20 g"\n')
    problem = only_problem(
        lambda: check_pair(scenario, embedded_bench("planar_slider_crank"), TODAY),
        'limits."crank_frme.acceleration_x"',
    )
    assert problem.allowed.startswith("a channel of the bench: crank_frame.acceleration_y, ")
    assert problem.allowed.endswith("(did you mean crank_frame.acceleration_x?)")


@pytest.mark.parametrize(
    ("levels", "why"),
    [
        ("abort = 2", "the unit is missing"),
        ('abort = "94 dB"', "dB is no multiple of a unit"),
        ('abort = "180 degF"', "degF is no multiple of a unit"),
        ('abort = "2 furlongz"', "furlongz is not a known unit"),
        ('abort = "loud"', "not a number with a unit"),
        ("hold = 1", "not a number with a unit"),
    ],
)
def test_a_limit_of_a_name_that_no_rig_has_wants_a_unit(levels: str, why: str) -> None:
    problem = only_problem(lambda: limited(levels), 'limits."room.sound"')
    assert problem.allowed.endswith(f'that no rig has, a level with its unit, such as "94 Pa" ({why})')


def test_a_name_that_no_rig_has_is_taken_for_a_mistake_unless_it_is_said_not_to_be_modelled() -> None:
    key = 'daq_card.channels."crank_frme.acceleration_x"'
    mistyped = MICROPHONE.replace("room.sound", "crank_frme.acceleration_x").replace("modelled = false\n", "")
    problem = only_problem(lambda: parse(TEXT + mistyped), f"{key}.name")
    assert "did you mean crank_frame.acceleration_x" in problem.allowed


def test_a_name_that_has_a_meaning_is_no_name_for_what_is_not_modelled() -> None:
    text = TEXT.replace(
        'name = "crank_frame.acceleration_y"', 'name = "crank_frame.acceleration_y"\nmodelled = false'
    )
    text += MICROPHONE.replace("room.sound", "encoder.angle")
    assert set(problems_of(lambda: parse(text))) == {
        'daq_card.channels."crank_frame.acceleration_y".modelled',
        'daq_card.channels."encoder.angle".name',
    }
