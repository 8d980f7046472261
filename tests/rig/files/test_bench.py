from __future__ import annotations

import contextlib
import datetime
import math
import pickle
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.errors import ConfigurationError
from drivers.protocols.emergency_stop import StopLine
from drivers.scpi.settings import GeneratorSettings
from rig.emulation import bench_reaching
from rig.files.bench import Bench, embedded_bench, load_bench, parse_bench
from tests.rig.files.faulty import only_problem, problems_of

EXAMPLE = Path(__file__).parents[3] / "scenarios" / "bench.example.toml"
REAL = """
[signal_generator]
resource = "TCPIP::192.168.0.20::5025::SOCKET"
force_per_volt = "3.6 N/V"
maximum_amplitude = "12 N"

[daq_card]
grpc = "127.0.0.1:31763"

[[daq_card.channels]]
name = "contact.force_upper"
physical = "cDAQ1Mod1/ai0"
kind = "voltage"
sensitivity = "100 mV/N"
range = "100 N"
serial = "SN1234"
calibrated = 2026-05-04
valid_until = 2027-05-04
"""
CHANNEL = 'daq_card.channels."contact.force_upper"'
SECOND = """
[[daq_card.channels]]
name = "yoke.force"
physical = "cDAQ1Mod1/ai1"
kind = "force_iepe"
sensitivity = "22.4 mV/N"
range = "200 N"
"""


def parse(text: str, folder: Path = Path()) -> Bench:
    return parse_bench(text, "bench", folder)


def changed(old: str, new: str) -> str:
    assert old in REAL
    return REAL.replace(old, new)


def test_real_bench_is_read_in_si() -> None:
    bench = parse(REAL)
    assert bench.the(GeneratorSettings).resource == "TCPIP::192.168.0.20::5025::SOCKET"
    assert (bench.the(GeneratorSettings).force_per_volt, bench.the(GeneratorSettings).maximum_amplitude) == (
        3.6,
        12.0,
    )
    assert (bench.the(GeneratorSettings).driver, bench.daq_card.driver) == ("scpi_33220a", "nidaqmx")
    assert (bench.daq_card.grpc, bench.daq_card.emulated, bench.daq_card.buffer_s) == (
        "127.0.0.1:31763",
        False,
        10.0,
    )
    (channel,) = bench.daq_card.channels
    assert (channel.unit, channel.sensitivity, channel.gain, channel.range) == ("N", 0.1, None, 100.0)
    assert channel.full_scale_v == 10.0
    assert channel.valid_until == datetime.date(2027, 5, 4)


def test_example_names_all_channels_of_the_impact_beam() -> None:
    bench = load_bench(EXAMPLE)
    assert not bench.the(GeneratorSettings).emulated
    assert not bench.daq_card.emulated
    embedded = embedded_bench().daq_card.channels
    assert [channel.name for channel in bench.daq_card.channels] == [channel.name for channel in embedded]


def test_embedded_bench_is_emulated_as_a_whole() -> None:
    bench = embedded_bench()
    assert bench.the(GeneratorSettings).emulated
    assert bench.daq_card.emulated
    ranges = {channel.name: (channel.unit, channel.range) for channel in bench.daq_card.channels}
    assert ranges == {
        "drive.force": ("N", 50.0),
        "contact.force_upper": ("N", 200.0),
        "contact.force_lower": ("N", 200.0),
        "yoke.force": ("N", 200.0),
        "base.acceleration": ("m/s2", 490.3325),
    }
    assert pickle.loads(pickle.dumps(bench)) == bench  # noqa: S301


def test_charge_amplifier_multiplies_sensor_and_gain() -> None:
    upper = embedded_bench().daq_card.channels[1]
    assert (upper.kind, upper.sensitivity, upper.gain) == ("charge_amplifier", 4e-12, 6e9)
    # 4 pC/N x 6 mV/pC = 24 mV/N
    assert math.isclose(upper.volts_per_unit, 0.024, rel_tol=1e-14)


def test_bench_without_an_instrument_is_emulated() -> None:
    bench = parse("[emulation]\nseed = 7\n")
    assert (bench.emulation.seed, bench.emulation.effects, bench.emulation.healthy) == (7, None, True)
    assert bench.daq_card == embedded_bench().daq_card


def test_emulated_instrument_beside_a_real_one() -> None:
    text = REAL.replace('resource = "TCPIP::192.168.0.20::5025::SOCKET"', "emulated = true")
    bench = parse(text)
    assert bench.the(GeneratorSettings).emulated
    assert bench.the(GeneratorSettings).resource == ""
    assert not bench.daq_card.emulated


def test_emulated_instrument_takes_what_is_left_open_from_the_embedded_bench() -> None:
    card = "[daq_card]" + REAL.partition("[daq_card]")[2]
    generator = parse(f"[signal_generator]\nemulated = true\nmaximum_amplitude = 5\n{card}").actuator
    assert (generator.maximum_amplitude, generator.force_per_volt) == (5.0, 3.6)


def test_effects_path_starts_from_the_bench_file(tmp_path: Path) -> None:
    (tmp_path / "hidden.json").write_text("[]")
    path = tmp_path / "bench.toml"
    path.write_text('[emulation]\neffects = "hidden.json"\nhealthy = false\n')
    emulation = load_bench(path).emulation
    assert emulation.effects is not None
    assert emulation.effects.samefile(tmp_path / "hidden.json")
    assert emulation.healthy is False
    path.write_text('[emulation]\neffects = "absent.json"\n')
    assert "an existing file" in only_problem(lambda: load_bench(path), "emulation.effects").allowed


@pytest.mark.parametrize(
    ("sensor", "volts_per_unit"),
    [
        ('kind = "acceleration_iepe"\nsensitivity = "98.0665 mV/g"\nrange = "50 g"', 0.01),
        ('kind = "acceleration_iepe"\nsensitivity = "10 mV/(m/s^2)"\nrange = "500 m/s^2"', 0.01),
        ('kind = "voltage"\nsensitivity = "10 mV/(m/s2)"\nrange = "500 m/s2"', 0.01),
        ('kind = "charge_amplifier"\nsensitivity = "98.0665 pC/g"\ngain = "1 mV/pC"\nrange = "50 g"', 0.01),
    ],
)
def test_sensitivity_is_in_the_unit_of_its_kind(sensor: str, volts_per_unit: float) -> None:
    text = f'{REAL}\n[[daq_card.channels]]\nname = "base.acceleration"\nphysical = "m/ai7"\n{sensor}\n'
    channel = parse(text).daq_card.channels[1]
    assert channel.unit == "m/s2"
    assert math.isclose(channel.volts_per_unit, volts_per_unit, rel_tol=1e-13)


@pytest.mark.parametrize(
    ("text", "key", "value", "allowed"),
    [
        (changed('"100 mV/N"', '"100 V/N"'), "sensitivity", '"100 V/N"', "100 N x 100 V per N = 10000 V"),
        (changed('"100 mV/N"', '"100 nV/N"'), "sensitivity", '"100 nV/N"', "= 1e-05 V"),
        (changed('"100 mV/N"', '"0 mV/N"'), "sensitivity", '"0 mV/N"', "above 0 mV/N"),
        (changed('"100 mV/N"', '"-100 mV/N"'), "sensitivity", '"-100 mV/N"', "above 0 mV/N"),
        (changed('"100 mV/N"', '"10 mV/g"'), "sensitivity", '"10 mV/g"', "not a unit of this kind"),
        (changed('"100 mV/N"', '"4 pC/N"'), "sensitivity", '"4 pC/N"', "not a unit of this kind"),
        (changed('"100 mV/N"', "false"), "sensitivity", "false", "a sensitivity"),
        (changed('range = "100 N"', ""), "range", "(missing)", "the full scale"),
        (changed('"100 N"', '"100 m"'), "range", '"100 m"', "not a unit of this kind"),
        (changed("cDAQ1Mod1/ai0", "cDAQ1Mod1/ao0"), "physical", '"cDAQ1Mod1/ao0"', "an input of the card"),
        (changed('"voltage"', '"strain"'), "kind", '"strain"', '"voltage" or "charge_amplifier"'),
        (changed('"voltage"', '"encoder"'), "kind", '"encoder"', '"tachometer" on an analog input'),
        (changed("Mod1/ai0", "Mod1/ctr0"), "kind", '"voltage"', '"encoder" or "marker" or "tachometer" on'),
        (changed('"voltage"', '"marker"'), "kind", '"marker"', "a kind that measures N"),
        (changed('"voltage"', '"tachometer"'), "kind", '"tachometer"', "a kind that measures N"),
        (
            changed('"voltage"', '"acceleration_iepe"'),
            "kind",
            '"acceleration_iepe"',
            "a kind that measures N",
        ),
        (changed('"voltage"', '"charge_amplifier"'), "gain", "(missing)", "the charge amplifier's gain"),
        (changed('"100 N"', '"100 N"\ngain = "1 mV/pC"'), "gain", '"1 mV/pC"', "only a charge_amplifier"),
        (changed("2027-05-04", "2026-05-04"), "valid_until", "2026-05-04", "a day after calibrated"),
        (changed("2027-05-04", '"2027-05-04"'), "valid_until", '"2027-05-04"', "a date without quotes"),
        (
            changed("2027-05-04", "2027-05-04T00:00:00"),
            "valid_until",
            "2027-05-04T00:00:00",
            "a date without",
        ),
        (changed("serial", "serail"), "serail", '"SN1234"', f"did you mean {CHANNEL}.serial?"),
    ],
)
def test_faulty_channel_is_told(text: str, key: str, value: str, allowed: str) -> None:
    problem = problems_of(lambda: parse(text))[f"{CHANNEL}.{key}"]
    assert problem.value == value
    assert allowed in problem.allowed


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        (
            changed('resource = "TCPIP::192.168.0.20::5025::SOCKET"', ""),
            "signal_generator.resource",
            "VISA address",
        ),
        (
            changed("TCPIP::192.168.0.20::5025::SOCKET", "192.168.0.20"),
            "signal_generator.resource",
            "VISA address",
        ),
        (changed('"3.6 N/V"', '"3.6 V/N"'), "signal_generator.force_per_volt", "0.001 N/V to 1000 N/V"),
        (changed('"12 N"', '"0 N"'), "signal_generator.maximum_amplitude", "above 0 N"),
        (changed("[daq_card]", '[daq_card]\ndriver = "nidaq"'), "daq_card.driver", '"nidaqmx"'),
        (changed("127.0.0.1:31763", "192.168.0.9:31763"), "daq_card.grpc", "SSH tunnel"),
        (changed("127.0.0.1:31763", "127.0.0.1:99999"), "daq_card.grpc", "a port from 1 to 65535"),
        (changed("127.0.0.1:31763", "127.0.0.1"), "daq_card.grpc", "host:port"),
        (changed("[daq_card]", "[daq_card]\nbuffer = -1"), "daq_card.buffer", "0.5 s to 120 s"),
        (changed("[daq_card]", "[daq_card]\nbuffer = nan"), "daq_card.buffer", "0.5 s to 120 s"),
        (REAL + "[emulation]\nseed = 7\n", "emulation", "no instrument of this bench is emulated"),
        (
            REAL + '[inverter]\ndriver = "mitsubishi_fr"\n',
            "inverter",
            "the impact_beam is driven by [signal_generator]",
        ),
        (REAL + '[encoder]\ndriver = "canopen_cia406"\n', "encoder", "none: the impact_beam has none"),
        (
            '[emulation]\nencoder_lag = "2 ms"\n',
            "emulation.encoder_lag",
            "none: this bench has no emulated [encoder]",
        ),
        (REAL + "[signal_generatr]\n", "signal_generatr", "did you mean signal_generator?"),
        (REAL.partition("[daq_card]")[0], "daq_card", "emulated = true if it is not there"),
        (REAL.partition("[[")[0], "daq_card.channels", "at least one table [[daq_card.channels]]"),
        (REAL + SECOND.replace("ai1", "AI0"), "daq_card.channels.physical", "each physical once"),
        (
            REAL + SECOND.replace("yoke.force", "contact.force_upper"),
            "daq_card.channels.name",
            "each name once",
        ),
        (
            REAL + SECOND.replace("yoke.force", "yoke.forec"),
            'daq_card.channels."yoke.forec".name',
            "did you mean yoke.force?",
        ),
        (
            "[signal_generator]\nemulated = true\nresource = 'TCPIP::192.168.0.3::5025::SOCKET'",
            "signal_generator.resource",
            "an emulated instrument listens on loopback only",
        ),
    ],
)
def test_faulty_bench_is_told(text: str, key: str, allowed: str) -> None:
    assert allowed in only_problem(lambda: parse(text), key).allowed


def test_channel_without_a_name_is_told_by_its_number() -> None:
    assert "daq_card.channels[2].name" in problems_of(lambda: parse(REAL + SECOND.replace("name", "nmae")))


def test_every_fault_is_told_at_once() -> None:
    text = REAL.replace("TCPIP", "TPCIP").replace('"100 mV/N"', '"100 V/N"') + SECOND.replace(
        "200 N", "200 g"
    )
    assert set(problems_of(lambda: parse(text + "[emulation]\nseed = -1\n"))) == {
        "signal_generator.resource",
        f"{CHANNEL}.sensitivity",
        'daq_card.channels."yoke.force".range',
        "emulation.seed",
    }


@pytest.mark.parametrize(
    "text", ["signal_generator = 3", "daq_card = []", "[daq_card]\nchannels = 3", "emulation = 1"]
)
def test_value_where_a_table_belongs_is_told(text: str) -> None:
    assert "a" in next(iter(problems_of(lambda: parse(text)).values())).allowed


# the first example loads the unit registry, which takes longer than hypothesis's deadline
@settings(deadline=None)
@given(text=st.text(max_size=80))
def test_any_text_gives_a_bench_or_a_configuration_error(text: str) -> None:
    with contextlib.suppress(ConfigurationError):
        assert parse(text).daq_card.emulated


CARD_LINE = '[emergency_stop]\nline = "cDAQ1Mod4/port0/line0"'
TERMINAL = '[emergency_stop]\nline = "inverter/RH"'
UNSEEN = REAL.replace('grpc = "127.0.0.1:31763"', "emulated = true")


def test_an_emergency_stop_is_read_by_the_instrument_that_its_line_is_on() -> None:
    bench = parse(f'{REAL}\n{CARD_LINE}\ncontact = "normally open"')
    assert bench.daq_card.stop_line == bench.stop_line == StopLine("cDAQ1Mod4/port0/line0", "normally open")
    crank = parse(f"{TERMINAL}\n[inverter]\nemulated = true\n[daq_card]\nemulated = true")
    assert crank.actuator.stop_line == crank.stop_line == StopLine("inverter/RH", "normally closed")
    assert crank.daq_card.stop_line is None
    assert parse(REAL).stop_line is None
    again = parse_bench(
        bench_reaching(crank, {"inverter": "socket://127.0.0.1:5020", "daq_card": "127.0.0.1:1"}), "", Path()
    )
    assert again.stop_line == crank.stop_line


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{REAL}\n{TERMINAL}", "one of the card: this bench has no [inverter]"),
        (f'{REAL}\n[emergency_stop]\nline = "ai0"', "a digital input of the card, such as"),
        (f"{UNSEEN}\n{CARD_LINE}", "a line of a real instrument: an emulated"),
    ],
)
def test_an_emergency_stop_that_nobody_could_read_is_refused(text: str, said: str) -> None:
    assert said in only_problem(lambda: parse(text), "emergency_stop.line").allowed


def test_faults_to_rehearse_are_of_what_is_emulated_and_are_known() -> None:
    bench = parse_bench('[emulation]\nfaults = ["daq_card.stuck@2:for=1", "disk.full"]\n', "x", Path())
    (stuck,) = bench.emulation.rehearsed("daq_card")
    assert (stuck.kind, stuck.at_s, stuck.number("for")) == ("stuck", 2.0, 1.0)
    with pytest.raises(ConfigurationError) as caught:
        parse_bench('[emulation]\nfaults = ["inverter.trips", "disk.ful"]\n', "x", Path())
    trips, unknown = caught.value.problems
    assert (trips.key, trips.allowed) == ("emulation.faults", "none: [inverter] is not emulated here")
    assert unknown.allowed.endswith("disk.full, disk.fails, disk.sync_fails, disk.close_fails")
