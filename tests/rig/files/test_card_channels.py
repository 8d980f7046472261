"""Encoder, marker and tachometer, and the stages of a chain, in a bench file and on the emulated card."""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
import pickle
from pathlib import Path

import pytest

from drivers.ni_daq.channels import Amplifier, AntiAliasFilter, CardChannel, Pulses, problems
from drivers.ni_daq.emulator.wiring import ChargeStage, CounterWire, LowPassStage, Wire
from rig.emulation import wiring_of
from rig.files.bench import Bench, embedded_bench, parse_bench
from rig.files.pairing import check_pair
from rig.files.scenario import load_scenario
from rig.twin.chains import chain_record
from tests.rig.files.faulty import only_problem, problems_of

HEAD = """
[signal_generator]
emulated = true
[daq_card]
emulated = true
"""
ACCELERATION = """
[[daq_card.channels]]
name = "crank_frame.acceleration_y"
physical = "cDAQ1Mod1/ai0"
kind = "acceleration_iepe"
sensitivity = "10 mV/g"
range = "400 g"
"""
ENCODER = """
[[daq_card.channels]]
name = "crank.angle"
physical = "cDAQ1Mod3/ctr0"
kind = "encoder"
pulses_per_revolution = 1024
"""
MARKER = """
[[daq_card.channels]]
name = "crank.marker"
physical = "cDAQ1Mod2/ai0"
kind = "marker"
range = "10 V"
"""
TACHOMETER = """
[[daq_card.channels]]
name = "motor.tachometer"
physical = "cDAQ1Mod2/ai1"
kind = "tachometer"
sensitivity = "20 mV/rpm"
range = "400 rpm"
"""
CHARGE = """
[[daq_card.channels]]
name = "contact.force_upper"
physical = "cDAQ1Mod1/ai1"
kind = "charge_amplifier"
sensitivity = "4 pC/N"
gain = "6 mV/pC"
range = "200 N"
serial = "SN1002"
"""
AMPLIFIER = """
[daq_card.channels.amplifier]
serial = "CA-17"
corner = "0.16 Hz"
output = "10 V"
calibrated = 2026-01-01
valid_until = 2027-01-01
"""
FILTER = """
[daq_card.channels.filter]
serial = "AF-3"
corner = "10 kHz"
order = 4
"""


def parse(*tables: str) -> Bench:
    return parse_bench(HEAD + ACCELERATION + "".join(tables), "bench", Path())


def last(*tables: str) -> CardChannel:
    return parse(*tables).daq_card.channels[-1]


def test_encoder_of_the_planar_crank_gives_4096_counts_a_revolution() -> None:
    channel = last(ENCODER)
    assert (channel.unit, channel.counted, channel.range) == ("rad", True, math.inf)
    assert channel.pulses == Pulses(1024, 4, index=False, initial_angle=0.0)
    assert channel.pulses.counts_per_revolution == 4096


def test_encoder_with_everything_said() -> None:
    keys = 'decoding = "x2"\nindex = true\ninitial_angle = "90 deg"\nserial = "E1"\n'
    channel = last(ENCODER + keys)
    assert channel.pulses == Pulses(1024, 2, index=True, initial_angle=math.pi / 2)


def test_marker_and_tachometer_on_analog_inputs() -> None:
    marker, tachometer = parse(MARKER, TACHOMETER).daq_card.channels[1:]
    assert (marker.unit, marker.volts_per_unit, marker.full_scale_v) == ("V", 1.0, 10.0)
    assert tachometer.unit == "rad/s"
    # 20 mV/rpm x 400 rpm = 8 V, whatever the unit inside
    assert tachometer.full_scale_v == pytest.approx(8.0, rel=1e-12)
    assert tachometer.range == pytest.approx(400 * math.tau / 60, rel=1e-12)
    divided = last(MARKER + 'sensitivity = "50 %"\n')
    assert divided.full_scale_v == 5.0


@pytest.mark.parametrize(
    ("written", "bare"),
    [('range = "400 rpm"', "range = 400"), ('sensitivity = "20 mV/rpm"', "sensitivity = 0.19")],
)
def test_a_bare_number_is_no_speed_of_a_tachometer(written: str, bare: str) -> None:
    assert written in TACHOMETER
    key = f'daq_card.channels."motor.tachometer".{bare.split()[0]}'
    problem = only_problem(lambda: parse(TACHOMETER.replace(written, bare)), key)
    assert problem.allowed.endswith("(the unit is missing: rpm or rad/s)")


@pytest.mark.parametrize(
    ("table", "key", "units"),
    [
        (
            ACCELERATION + ENCODER + "index = true\ninitial_angle = 90\n",
            "crank.angle.initial_angle",
            "deg or rad",
        ),
        (MARKER + "angle = 37\n", "crank.marker.angle", "deg or rad"),
        (ACCELERATION.replace('"400 g"', "4000"), "crank_frame.acceleration_y.range", "m/s2 or g"),
        (ACCELERATION.replace('"10 mV/g"', "1e-3"), "crank_frame.acceleration_y.sensitivity", "m/s2 or g"),
    ],
)
def test_a_bare_number_is_neither_an_angle_nor_an_acceleration(table: str, key: str, units: str) -> None:
    channel, _, name = key.rpartition(".")
    problem = only_problem(
        lambda: parse_bench(HEAD + table, "bench", Path()), f'daq_card.channels."{channel}".{name}'
    )
    assert problem.allowed.endswith(f"(the unit is missing: {units})")


def test_marker_and_tachometer_on_counters() -> None:
    marker = last(MARKER.replace("ai0", "ctr1"))
    assert (marker.counted, marker.pulses, marker.range) == (True, None, 10.0)
    text = TACHOMETER.replace("ai1", "ctr2").replace(
        'sensitivity = "20 mV/rpm"', "pulses_per_revolution = 60"
    )
    assert last(text).pulses == Pulses(60, 1, index=False, initial_angle=0.0)


def test_every_channel_that_a_file_can_hold_is_one_of_the_card() -> None:
    bench = parse(
        ENCODER,
        MARKER,
        TACHOMETER,
        MARKER.replace("crank", "flywheel").replace("Mod2/ai0", "Mod3/ctr1"),
        CHARGE + AMPLIFIER + FILTER,
    )
    card = bench.daq_card
    assert problems(dataclasses.replace(card, sample_rate_hz=25600.0)) == []
    wiring_of(bench).devices()


def test_stages_of_a_chain_are_read_in_si() -> None:
    channel = last(CHARGE + AMPLIFIER + FILTER)
    first, end = datetime.date(2026, 1, 1), datetime.date(2027, 1, 1)
    assert channel.amplifier == Amplifier("CA-17", 0.16, 10.0, "operate", first, end)
    assert channel.anti_alias == AntiAliasFilter("AF-3", 10e3, 4)
    assert pickle.loads(pickle.dumps(channel)) == channel  # noqa: S301


def test_a_file_without_stages_is_what_it_was() -> None:
    upper = embedded_bench().daq_card.channels[1]
    assert (upper.amplifier, upper.anti_alias, upper.pulses) == (None, None, None)
    wiring = wiring_of(embedded_bench())
    assert wiring.wires["cDAQ1Mod1/ai1"] == Wire("contact.force_upper", upper.volts_per_unit)
    assert wiring.counters == {}
    assert chain_record(embedded_bench(), 25_600.0) == {}


def test_the_emulated_card_realises_the_chain() -> None:
    wiring = wiring_of(parse(ENCODER, MARKER, CHARGE + AMPLIFIER + FILTER))
    assert wiring.wires["cDAQ1Mod1/ai1"] == Wire(
        "contact.force_upper",
        4e-12 * 6e9,
        charge=ChargeStage(0.16, 10.0),
        low_pass=LowPassStage(10e3, 4),
    )
    assert wiring.wires["cDAQ1Mod2/ai0"].range_v == 10.0
    assert wiring.counters == {"cDAQ1Mod3/ctr0": CounterWire("crank.angle", 1024)}


def test_the_log_keeps_the_chain() -> None:
    record = chain_record(parse(ENCODER, MARKER, CHARGE + AMPLIFIER + FILTER), 25_600.0)
    assert set(record) == {"chain.crank.angle", "chain.contact.force_upper"}
    assert json.loads(record["chain.contact.force_upper"]) == {
        "physical": "cDAQ1Mod1/ai1",
        "kind": "charge_amplifier",
        "serial": "SN1002",
        "amplifier": {
            "serial": "CA-17",
            "gain_v_per_c": 6e9,
            "corner_hz": 0.16,
            "output_v": 10.0,
            "state": "operate",
        },
        "filter": {"serial": "AF-3", "corner_hz": 10e3, "order": 4},
    }
    assert json.loads(record["chain.crank.angle"])["pulses"]["per_revolution"] == 1024


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        (
            ENCODER.replace("pulses_per_revolution = 1024", ""),
            "pulses_per_revolution",
            "the pulses of one track",
        ),
        (ENCODER.replace("1024", "0"), "pulses_per_revolution", "a whole number from 1"),
        (ENCODER.replace("1024", "1024.5"), "pulses_per_revolution", "a whole number from 1"),
        (ENCODER + 'decoding = "x3"\n', "decoding", '"x1" or "x2" or "x4"'),
        (ENCODER + 'initial_angle = "360 deg"\n', "initial_angle", "0 deg to 359.999 deg"),
        (ENCODER + 'range = "1 rad"\n', "range", "none: only a voltage or charge_amplifier"),
        (ENCODER + 'sensitivity = "1 mV/N"\n', "sensitivity", "none: only a voltage"),
        (ENCODER.replace("ctr0", "ai3"), "kind", "on an analog input"),
        (ENCODER.replace("ctr0", "port0"), "physical", "a counter, such as"),
    ],
)
def test_faulty_encoder_is_told(text: str, key: str, allowed: str) -> None:
    assert allowed in only_problem(lambda: parse(text), f'daq_card.channels."crank.angle".{key}').allowed


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        (AMPLIFIER.replace("10 V", "4 V"), "amplifier.output", "200 N x 4 pC per N x 6 mV/pC = 4.8 V"),
        (AMPLIFIER.replace("0.16 Hz", "0 Hz"), "amplifier.corner", "above 0 Hz, up to 1000 Hz"),
        (AMPLIFIER + 'state = "reset"\n', "amplifier.state", "in reset its output is 0 V"),
        (AMPLIFIER.replace("2027", "2025"), "amplifier.valid_until", "a day after calibrated"),
        (
            AMPLIFIER.replace("serial", "serail"),
            "amplifier.serail",
            'did you mean daq_card.channels."contact.force_upper".amplifier.serial?',
        ),
        (FILTER.replace('corner = "10 kHz"', ""), "filter.corner", "0.1 Hz to 1e+06 Hz"),
        (FILTER.replace("order = 4", "order = 0"), "filter.order", "a whole number from 1 to 16"),
        ('amplifier = "CA-17"\n', "amplifier", "a table [daq_card.channels.amplifier]"),
    ],
)
def test_faulty_stage_is_told(text: str, key: str, allowed: str) -> None:
    assert (
        allowed
        in only_problem(
            lambda: parse(CHARGE + text), f'daq_card.channels."contact.force_upper".{key}'
        ).allowed
    )


def test_only_a_charge_amplifier_has_an_amplifier() -> None:
    problem = only_problem(lambda: parse(MARKER + AMPLIFIER), 'daq_card.channels."crank.marker".amplifier')
    assert problem.allowed == "none: only a charge_amplifier has one"


def test_counters_alone_have_no_clock() -> None:
    text = HEAD + ENCODER
    assert (
        "whose clock samples the counters"
        in only_problem(lambda: parse_bench(text, "bench", Path()), "daq_card.channels.physical").allowed
    )


def test_an_expired_stage_forbids_a_run_as_an_expired_sensor_does() -> None:
    text = HEAD.replace("[daq_card]\nemulated = true", "[daq_card]") + CHARGE + AMPLIFIER
    bench = parse_bench(text, "bench", Path())
    scenario = load_scenario(Path(__file__).parents[3] / "scenarios" / "impact_beam.toml")
    check_pair(scenario, bench, datetime.date(2027, 1, 1))
    found = problems_of(lambda: check_pair(scenario, bench, datetime.date(2027, 1, 2)))
    assert list(found) == ['daq_card.channels."contact.force_upper".amplifier.valid_until']
