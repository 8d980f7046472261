"""Benches of the slider-cranks: inverter, encoder, and whose bench a file is."""

from __future__ import annotations

import datetime
import math
import pickle
from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from drivers.mitsubishi_fr.settings import InverterSettings
from rig.files.bench import Bench, embedded_bench, load_bench, parse_bench
from rig.files.pairing import check_pair
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from tests.rig.files.faulty import only_problem, problems_of

SCENARIOS = Path(__file__).parents[3] / "scenarios"
EXAMPLE = SCENARIOS / "crank_bench.example.toml"
TEXT = EXAMPLE.read_text()
PLANAR = (SCENARIOS / "planar_slider_crank.toml").read_text()
TODAY = datetime.date(2026, 11, 22)
INVERTER = TEXT[TEXT.index("[inverter]") : TEXT.index("[encoder]")]


def parse(text: str, rig: str | None = "planar_slider_crank") -> Bench:
    return parse_bench(text, "bench", Path(), rig)


def changed(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new, 1)


def rpm(speed: float) -> float:
    return speed * 60 / math.tau


def test_inverter_is_read_in_si() -> None:
    inverter = parse(TEXT).actuator
    assert (inverter.driver, inverter.port, inverter.station) == ("mitsubishi_fr", "/dev/ttyUSB1", 1)
    assert (inverter.baudrate, inverter.parity, inverter.rpm_per_hz) == (19200, "E", 5.0)
    assert rpm(inverter.maximum_speed) == pytest.approx(300.0, rel=1e-12)
    assert (inverter.answer_s, inverter.poll_s, inverter.silent_s, inverter.unattended_s) == (
        0.2,
        0.1,
        0.7,
        5.0,
    )


def test_encoder_keeps_the_interfaces_own_keys_apart() -> None:
    encoder = parse(TEXT).encoder
    assert encoder is not None
    assert (encoder.driver, encoder.interface, encoder.node) == ("canopen_cia406", "socketcand", 7)
    assert encoder.options == {"host": "127.0.0.1", "port": 29536, "channel": "can0"}
    assert (encoder.period_s, encoder.emulated) == (1e-3, False)
    usb = changed('interface = "socketcand"                ', 'interface = "slcan"\nbitrate = 500000 ')
    other = parse(usb.replace('period = "1 ms"', 'period = "2 ms"').replace("# period", "period")).encoder
    assert other is not None
    assert other.options == {**encoder.options, "bitrate": 500000}
    assert other.period_s == 2e-3


def test_encoder_says_what_it_must_be() -> None:
    text = TEXT.replace("# [encoder.identity]  ", "[encoder.identity] ").replace(
        "# serial = 1234", "serial = 1234"
    )
    encoder = parse(text).encoder
    assert encoder is not None
    assert (encoder.identity.serial, encoder.identity.counts_per_revolution) == (1234, None)


def test_a_bench_need_not_have_an_encoder() -> None:
    assert parse(TEXT.replace(TEXT[TEXT.index("[encoder]") : TEXT.index("[daq_card]")], "")).encoder is None


@pytest.mark.parametrize("rig", ["planar_slider_crank", "spatial_slider_crank"])
def test_embedded_bench_of_a_crank_has_all_its_channels(rig: str) -> None:
    bench = embedded_bench(rig)
    assert bench.emulated == ("inverter", "daq_card")
    units = {channel.name: channel.unit for channel in bench.daq_card.channels}
    assert units == {name: RIGS[rig].channels.unit(name) for name in RIGS[rig].channels}
    check_pair(parse_scenario((SCENARIOS / f"{rig}.toml").read_text()), bench, TODAY)
    assert pickle.loads(pickle.dumps(bench)) == bench  # noqa: S301


@pytest.mark.parametrize("rig", RIGS)
def test_the_rig_of_a_bench_is_told_by_its_instruments(rig: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(RIGS[rig].bench)
    assert load_bench(path).rig == rig


def test_without_any_instrument_every_one_of_the_rig_is_emulated() -> None:
    bench = parse("[emulation]\nseed = 7\n", "spatial_slider_crank")
    assert bench.daq_card == embedded_bench("spatial_slider_crank").daq_card
    assert bench.actuator == embedded_bench("spatial_slider_crank").actuator


def test_an_emulated_encoder_needs_nothing_else() -> None:
    bench = parse("[encoder]\nemulated = true\n")
    assert bench.emulated == ("inverter", "daq_card", "encoder")
    assert bench.encoder is not None
    assert (bench.encoder.node, bench.encoder.options) == (7, {"channel": "can0"})


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        (TEXT.replace(INVERTER, ""), "inverter", "a table [inverter] (emulated = true if it is not there)"),
        (
            TEXT + "[signal_generator]\n",
            "signal_generator",
            "the planar_slider_crank is driven by [inverter]",
        ),
        (TEXT + "[inverer]\n", "inverer", "did you mean inverter?"),
        (changed('"/dev/ttyUSB1"', '"ttyUSB1"'), "inverter.port", "a serial port or a socket"),
        (changed('"/dev/ttyUSB1"', '"socket://10.0.0.8:5020"'), "inverter.port", "an SSH tunnel"),
        (changed('"/dev/ttyUSB1"', '"socket://127.0.0.1:0"'), "inverter.port", "a port from 1 to 65535"),
        (changed('port = "/dev/ttyUSB1"', ""), "inverter.port", "or emulated = true"),
        (changed("rpm_per_hz = 5.0", ""), "inverter.rpm_per_hz", "above 0, up to 10000"),
        (changed("rpm_per_hz = 5.0", "rpm_per_hz = 0"), "inverter.rpm_per_hz", "above 0, up to 10000"),
        (changed('"300 rpm"', '"300 Hz"'), "inverter.maximum_speed", "not a unit of this kind"),
        (changed("= 5.0", "= 0.5"), "inverter.maximum_speed", "at most 400 Hz of output, not 600 Hz"),
        (changed("station = 1", "station = 0"), "inverter.station", "a whole number from 1 to 247"),
        (changed("= 19200", "= 19201"), "inverter.baudrate", "4800 or 9600 or 19200 or 38400"),
        (changed('"E"', '"even"'), "inverter.parity", '"E" or "O" or "N"'),
        (changed('# silent = "0.7 s"', 'silent = "0.2 s"'), "inverter.silent", "longer than answer, 0.2 s"),
        (changed("node = 7", "node = 128"), "encoder.node", "a whole number from 1 to 127"),
        (changed("node = 7", "nod = 7\nnode = 7"), "encoder.nod", "did you mean encoder.node?"),
        (changed('host = "127.0.0.1"', 'host = "10.0.0.8"'), "encoder.host", "an SSH tunnel"),
        (changed("port = 29536", 'port = "29536"'), "encoder.port", "a whole number from 1 to 65535"),
        (changed("port = 29536", "port = 70000"), "encoder.port", "a port from 1 to 65535"),
        (changed('channel = "can0"', ""), "encoder.channel", "the bus's name"),
        (changed('channel = "can0"', "channel = [1]"), "encoder.channel", "as python-can wants it"),
        (changed('# period = "1 ms"', 'period = "0 ms"'), "encoder.period", "1 ms to 65535 ms"),
        (
            changed("node = 7", 'node = 7\nemulated = true\ninterface = "slcan"').replace(
                'interface = "socketcand" ', "#"
            ),
            "encoder.interface",
            "how an emulated encoder is reached",
        ),
        (
            changed("[daq_card]", "[daq_card]\nemulated = true"),
            "daq_card.emulated",
            "a motor that turns needs a real card",
        ),
        (
            changed("[encoder] ", "[encoder]\nemulated = true\n#").replace(
                'host = "127.0.0.1"\nport = 29536\n', ""
            ),
            "encoder.emulated",
            "false beside a real inverter: the speed guard would watch an emulated encoder",
        ),
        (
            changed("[inverter] ", "[inverter]\nemulated = true\n#").replace('port = "/dev/ttyUSB1"', ""),
            "encoder.emulated",
            "true beside an emulated inverter: a real encoder stands while",
        ),
        (
            '[emulation]\nencoder_lag = "2 ms"\n',
            "emulation.encoder_lag",
            "none: this bench has no emulated [encoder]",
        ),
        ("encoder = 3\n" + RIGS["planar_slider_crank"].bench, "encoder", "a table [encoder]"),
    ],
)
def test_faulty_bench_is_told(text: str, key: str, allowed: str) -> None:
    assert allowed in only_problem(lambda: parse(text), key).allowed


def test_a_real_motor_beside_an_emulated_card_and_an_emulated_encoder_is_told_of_both() -> None:
    text = changed("[daq_card]", "[daq_card]\nemulated = true")
    text = text.replace("[encoder] ", "[encoder]\nemulated = true\n#").replace('host = "127.0.0.1"\n', "")
    problems = problems_of(lambda: parse(text.replace("port = 29536\n", "")))
    assert {key: problem.value for key, problem in problems.items()} == {
        "daq_card.emulated": "true",
        "encoder.emulated": "true",
    }


def test_a_real_encoder_lags_as_it_does() -> None:
    problems = problems_of(lambda: parse(f'{TEXT}[emulation]\nencoder_lag = "2 ms"\n'))
    assert problems["emulation.encoder_lag"].value == '"2 ms"'


def test_where_an_encoder_is_mounted_is_told_with_its_unit() -> None:
    told = "-360 deg to 360 deg (the unit is missing: deg or rad)"
    text = "[encoder]\nemulated = true\nmounting = 5\n"
    assert only_problem(lambda: parse(text), "encoder.mounting").allowed == told


def test_every_fault_is_told_at_once() -> None:
    text = changed("station = 1", "station = 999").replace("node = 7", "node = 0")
    text = text.replace('"50 mV/g"', '"50 V/g"', 1).replace(
        "[daq_card]", '[daq_card]\ngrpc = "10.0.0.8:31763"'
    )
    assert set(problems_of(lambda: parse(text))) == {
        "inverter.station",
        "encoder.node",
        "daq_card.grpc",
        'daq_card.channels."crank_frame.acceleration_y".sensitivity',
    }


def test_the_benches_of_two_rigs_are_not_mixed_up() -> None:
    problem = only_problem(lambda: parse(RIGS["impact_beam"].bench), "signal_generator")
    assert problem.allowed == "none: the planar_slider_crank is driven by [inverter]"
    with pytest.raises(LookupError, match="this bench has no Inverter"):
        _ = embedded_bench("impact_beam").the(InverterSettings)


def test_a_crank_of_the_other_kind_has_other_channels() -> None:
    scenario = parse_scenario(PLANAR)
    bench = parse(RIGS["spatial_slider_crank"].bench)
    with pytest.raises(ConfigurationError, match=r"slider\.force_1.*a channel of the planar_slider_crank"):
        check_pair(scenario, bench, TODAY)


@pytest.mark.parametrize(
    ("old", "new", "key", "value", "allowed"),
    [
        ('"200 rpm"', '"351 rpm"', "drive.speed", "351 rpm", "up to 350 rpm (inverter.maximum_speed)"),
        ('"1 s"', '"0.9 s"', "acquisition.settle", "0.9 s", "at least 1 s: a motor comes up on its ramp"),
    ],
)
def test_a_drive_beyond_the_motor_is_refused(old: str, new: str, key: str, value: str, allowed: str) -> None:
    scenario, bench = parse_scenario(PLANAR.replace(old, new)), embedded_bench("planar_slider_crank")
    problem = only_problem(lambda: check_pair(scenario, bench, TODAY), key)
    assert problem.value == value
    assert allowed in problem.allowed


def test_the_highest_speed_itself_is_allowed() -> None:
    scenario = parse_scenario(PLANAR.replace('"200 rpm"', '"350 rpm"'))
    check_pair(scenario, embedded_bench("planar_slider_crank"), TODAY)


def test_a_limit_on_the_bench_of_a_crank_lies_within_its_channels_range() -> None:
    limit = '[limits."crank_frame.acceleration_x"]\nabort = "200 g"\n'
    with pytest.raises(ConfigurationError, match=r"below 980\.665 m/s2, the channel's range"):
        check_pair(parse_scenario(PLANAR + limit), embedded_bench("planar_slider_crank"), TODAY)


def test_an_outdated_sensor_of_a_real_card_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"not before today, 2028-01-01") as caught:
        check_pair(parse_scenario(PLANAR), load_bench(EXAMPLE), datetime.date(2028, 1, 1))
    assert len(caught.value.problems) == 3


SUPPLY = """\
[dc_supply]
driver = "scpi_n6900"
resource = "TCPIP::192.168.0.6::5025::SOCKET"
rpm_per_volt = 5.0
maximum_speed = "300 rpm"
maximum_current = "3 A"
"""
MANUAL = '[manual_motor]\ndriver = "manual"\nmaximum_speed = "300 rpm"\n'


def test_whatever_gives_the_drive_of_a_rig_may_drive_it() -> None:
    bench = parse(TEXT.replace(INVERTER, SUPPLY))
    assert (bench.actuator_table, bench.actuator.driver) == ("dc_supply", "scpi_n6900")
    assert (bench.actuator.maximum_v, bench.actuator.slew_v_per_s) == (60.0, 20.0)
    scenario = parse_scenario(PLANAR.replace('speed = "200 rpm"', 'speed = "301 rpm"'))
    assert scenario.drive.speed > bench.actuator.maximum_speed
    with pytest.raises(ConfigurationError, match=r"up to 300 rpm \(dc_supply.maximum_speed\)"):
        check_pair(scenario, bench, TODAY)
    assert parse(TEXT.replace(INVERTER, SUPPLY), rig=None).rig == "planar_slider_crank"


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        (SUPPLY + INVERTER, "dc_supply", "is driven by [inverter]"),
        (SUPPLY.replace("5.0", "1.5"), "dc_supply.maximum_speed", "at most 160 V, not 200 V"),
        (
            SUPPLY.replace('resource = "TCPIP::192.168.0.6::5025::SOCKET"\n', ""),
            "dc_supply.resource",
            "supply's",
        ),
        (SUPPLY.replace('"3 A"', '"3 V"'), "dc_supply.maximum_current", "A"),
    ],
)
def test_a_supply_that_cannot_be_is_told(text: str, key: str, allowed: str) -> None:
    encoder = TEXT[TEXT.index("[encoder]") : TEXT.index("[daq_card]")]
    problem = only_problem(lambda: parse(TEXT.replace(INVERTER, text).replace(encoder, "")), key)
    assert allowed in problem.allowed


@pytest.mark.parametrize(
    ("table", "text"), [("inverter", INVERTER), ("dc_supply", SUPPLY), ("manual_motor", MANUAL)]
)
def test_a_bare_number_is_no_highest_speed_of_a_motor(table: str, text: str) -> None:
    """In rad/s, whoever means 300 rpm would allow 2865."""
    bare = TEXT.replace(INVERTER, text.replace('"300 rpm"', "300", 1))
    problem = only_problem(lambda: parse(bare), f"{table}.maximum_speed")
    assert problem.value == "300"
    assert problem.allowed == "above 0 rpm, up to 100000 rpm (the unit is missing: rpm or rad/s)"


def test_an_emulated_supply_needs_no_more_than_to_be_named() -> None:
    bench = parse("[dc_supply]\nemulated = true\n", "spatial_slider_crank")
    assert bench.emulated == ("dc_supply", "daq_card")
    assert bench.actuator.maximum_v == 70.0


def test_a_person_may_turn_it() -> None:
    manual = '[manual_motor]\ndriver = "manual"\nmaximum_speed = "250 rpm"\npatience = "2 min"\n'
    bench = parse(TEXT.replace(INVERTER, manual))
    settings = bench.actuator
    assert (settings.driver, settings.person, settings.patience_s) == ("manual", "", 120.0)
    scenario = parse_scenario(PLANAR.replace('speed = "200 rpm"', 'speed = "251 rpm"'))
    with pytest.raises(ConfigurationError, match=r"up to 250 rpm \(manual_motor.maximum_speed\)"):
        check_pair(scenario, bench, TODAY)
    # its shaft has to show on a real card, as with any other real motor
    card = TEXT[TEXT.index("[daq_card]") :].replace('driver = "nidaqmx"', "emulated = true", 1)
    problem = only_problem(lambda: parse(manual + card), "daq_card.emulated")
    assert "a real manual_motor" in problem.allowed
