from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from rig.files.bench import Bench, embedded_bench, load_bench, parse_bench
from rig.files.pairing import check_bench, check_pair, too_late, undelayed, unmeasured
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.surrogates.recordings import Setting
from tests.rig.files.faulty import only_problem
from tests.rig.files.test_free_channels import MICROPHONE

SCENARIOS = Path(__file__).parents[3] / "scenarios"
SOUND = (SCENARIOS / "impact_beam.toml").read_text()
TODAY = datetime.date(2026, 11, 21)


def test_main_scenario_runs_on_the_embedded_bench() -> None:
    check_pair(parse_scenario(SOUND), embedded_bench(), TODAY)


@pytest.mark.parametrize(
    ("text", "key", "allowed"),
    [
        (
            SOUND.replace('"9 N"', '"13 N"'),
            "drive.amplitude",
            "up to 12 N (signal_generator.maximum_amplitude)",
        ),
        (SOUND.replace('"9 N"', '"9 N"\noffset = "-4 N"'), "drive.amplitude", "up to 12 N"),
        (
            SOUND + '[limits."contact.force_upper"]\nabort = "250 N"',
            "abort",
            "below 200 N, the channel's range",
        ),
        (
            SOUND + '[limits."beam.acceleration_50"]\nabort = "5 g"',
            "beam.acceleration_50",
            "a channel of the bench",
        ),
    ],
)
def test_scenario_beyond_the_bench_is_refused(text: str, key: str, allowed: str) -> None:
    with pytest.raises(ConfigurationError, match="on embedded bench") as caught:
        check_pair(parse_scenario(text), embedded_bench(), TODAY)
    (problem,) = caught.value.problems
    assert key in problem.key
    assert allowed in problem.allowed


def test_a_fault_that_comes_after_the_record_is_told() -> None:
    faults = '"daq_card.stuck@5.9", "disk.full", "daq_card.unplugged@6"'
    bench = parse_bench(f"[emulation]\nfaults = [{faults}]\n", "x", Path())
    (told,) = too_late(parse_scenario(SOUND), bench)
    assert told.startswith("daq_card.unplugged@6 is for when the record is over (6 s)")


def test_of_a_crank_that_has_to_come_up_first_it_may_be() -> None:
    """`inverter.trips@4` trips it at full speed, or near it: the motor has run for six seconds by then."""
    bench = parse_bench('[emulation]\nfaults = ["inverter.trips@4"]\n', "x", Path(), "planar_slider_crank")
    scenario = Setting(1, 1, 200).scenario(2.0)
    (told,) = too_late(parse_scenario(scenario), bench)
    assert told.startswith("inverter.trips@4 is for when the record may be over (3 s from full speed on)")


@pytest.mark.parametrize("fault", ["daq_card.open:channel=yoke.forse", "daq_card.marks_missing@2"])
def test_a_fault_of_a_channel_that_is_not_there_is_refused(fault: str) -> None:
    bench = parse_bench(f'[emulation]\nfaults = ["{fault}"]\n', "x", Path())
    with pytest.raises(ConfigurationError, match=r"a channel of the card \(drive\.force, .*yoke\.force"):
        check_pair(parse_scenario(SOUND), bench, TODAY)


@pytest.mark.parametrize("fault", ["open:channel=crank.angle", "stuck:channel=room.sound"])
def test_a_fault_that_an_emulated_card_cannot_have_is_refused(fault: str) -> None:
    """A counter has no sensor's cable, and what no rig has shows nothing that could stick."""
    faults = f'[emulation]\nfaults = ["daq_card.{fault}"]\n'
    text = f"{RIGS['planar_slider_crank'].bench}{MICROPHONE}valid_until = 2096-01-01\n{faults}"
    bench = parse_bench(text, "x", Path(), "planar_slider_crank")
    scenario = parse_scenario(Setting(1, 1, 200).scenario(2.0))
    problem = only_problem(lambda: check_pair(scenario, bench, TODAY), "emulation.faults")
    assert fault.partition("=")[2] not in problem.allowed
    assert "crank_frame.acceleration_y" in problem.allowed


@pytest.mark.parametrize(
    ("table", "line", "allowed"),
    [
        ("daq_card", "inverter/RH", "a line of the card"),
        ("inverter", "cDAQ1Mod4/port0/line0", "a terminal of the inverter"),
    ],
)
def test_an_emergency_stop_is_rehearsed_where_its_line_is(table: str, line: str, allowed: str) -> None:
    text = f'[emergency_stop]\nline = "{line}"\n[emulation]\nfaults = ["{table}.stop_pressed@5"]\n'
    bench = parse_bench(text, "x", Path(), "planar_slider_crank")
    scenario = parse_scenario(Setting(1, 1, 200).scenario(2.0))
    told = only_problem(lambda: check_pair(scenario, bench, TODAY), "emulation.faults").allowed
    assert told == f"a bench with [emergency_stop] on {allowed}"


def unseen_bench() -> Bench:
    """A real generator whose beam an emulated card cannot see."""
    text = RIGS["impact_beam"].bench
    real = text.replace("emulated = true", 'resource = "TCPIP::127.0.0.1::5025::SOCKET"', 1)
    return parse_bench(real, "bench", Path())


def test_a_limit_that_would_watch_an_emulated_card_beside_a_real_shaker_is_refused() -> None:
    check_pair(parse_scenario(SOUND), unseen_bench(), TODAY)
    guarded = parse_scenario(SOUND + '[limits."contact.force_upper"]\nabort = "150 N"')
    check_pair(guarded, embedded_bench(), TODAY)
    problem = only_problem(lambda: check_pair(guarded, unseen_bench(), TODAY), 'limits."contact.force_upper"')
    assert "a limit needs a real card" in problem.allowed


def test_a_log_that_does_not_fit_on_the_disk_is_refused() -> None:
    hour = SOUND.replace('duration = "5 s"', 'duration = "1 h"')
    assert hour != SOUND
    check_pair(parse_scenario(SOUND), embedded_bench(), TODAY, free_bytes=2e9)
    with pytest.raises(ConfigurationError, match="on embedded bench") as caught:
        check_pair(parse_scenario(hour), embedded_bench(), TODAY, free_bytes=2e9)
    (problem,) = caught.value.problems
    assert (problem.key, problem.value) == ("free disk space", "2.0 GB")
    samples = 51_200 * 3600 * len(embedded_bench().daq_card.channels)
    assert float(problem.allowed.split()[0]) == pytest.approx(samples * 8.6e-9 + 1.07, abs=0.1)


def test_outdated_calibration_of_a_real_sensor_is_refused() -> None:
    scenario, bench = parse_scenario(SOUND), load_bench(SCENARIOS / "bench.example.toml")
    last = datetime.date(2027, 5, 4)
    check_pair(scenario, bench, last)
    with pytest.raises(ConfigurationError, match="2027-05-04: not before today, 2027-05-05") as caught:
        check_pair(scenario, bench, last + datetime.timedelta(days=1))
    assert len(caught.value.problems) == 5


def test_emulated_sensor_does_not_age() -> None:
    check_pair(parse_scenario(SOUND), embedded_bench(), datetime.date(2099, 1, 1))


def test_pairing_names_the_scenario() -> None:
    scenario = parse_scenario(SOUND.replace('"9 N"', '"20 N"'))
    problem = only_problem(lambda: check_pair(scenario, embedded_bench(), TODAY), "drive.amplitude")
    assert problem.value == "20 N"


def test_a_real_shaker_that_nothing_measures_is_told() -> None:
    text = RIGS["impact_beam"].bench
    real = text.replace("emulated = true", 'resource = "TCPIP::127.0.0.1::5025::SOCKET"', 1)
    whole = parse_bench(real.replace("emulated = true", 'grpc = "127.0.0.1:31763"', 1), "bench", Path())
    others = tuple(each for each in whole.daq_card.channels if each.name != "drive.force")
    deaf = replace(
        whole, instruments={**whole.instruments, "daq_card": replace(whole.daq_card, channels=others)}
    )
    assert unmeasured(embedded_bench()) == ""
    assert unmeasured(whole) == ""
    assert unmeasured(deaf).startswith(
        "nothing measures what the real shaker does (no channel is drive.force): maximum_amplitude bounds"
    )
    assert "(the card is emulated)" in unmeasured(unseen_bench())
    assert unmeasured(embedded_bench("planar_slider_crank")) == ""


def test_a_real_card_with_counters_whose_iepe_inputs_have_no_delay_is_told() -> None:
    text = (SCENARIOS / "crank_bench.example.toml").read_text()
    real = parse_bench(text, "bench", Path(), "planar_slider_crank")
    assert undelayed(real).startswith(
        "no delay for crank_frame.acceleration_y, crank_frame.acceleration_x, piston_frame.acceleration_y, "
        "crank.marker: such inputs show what happens some 40 samples later than the counter crank.angle, "
    )
    said = text
    for kind in ("acceleration_iepe", "marker"):
        said = said.replace(f'kind = "{kind}"', f'kind = "{kind}"\ndelay = "0 ms"')
    assert undelayed(parse_bench(said, "bench", Path(), "planar_slider_crank")) == ""
    channels = tuple(each for each in real.daq_card.channels if not each.counted)
    card = replace(real.daq_card, channels=channels)
    assert undelayed(replace(real, instruments={**real.instruments, "daq_card": card})) == ""
    assert undelayed(embedded_bench("planar_slider_crank")) == ""


FILTERED = (
    'kind = "charge_amplifier"\nsensitivity = "4 pC/N"\ngain = "6 mV/pC"\nrange = "200 N"\n'
    '[daq_card.channels.amplifier]\ncorner = "{high}"\n[daq_card.channels.filter]\ncorner = "{low}"\n'
)


def bench_with(rig: str, name: str, chain: str, more: str = "") -> Bench:
    """The embedded bench but for one channel, of which this is said."""
    head, *tables = RIGS[rig].bench.split("[[daq_card.channels]]\n")
    (place,) = [at for at, table in enumerate(tables) if f'name = "{name}"' in table]
    physical = next(line for line in tables[place].splitlines() if line.startswith("physical"))
    tables[place] = f'name = "{name}"\n{physical}\n{chain}\n'
    return parse_bench("[[daq_card.channels]]\n".join([head, *tables]) + more, "bench", Path(), rig)


@pytest.mark.parametrize(
    ("rate", "high", "low", "allowed"),
    [
        ("51.2 kHz", "0.5 Hz", "20 kHz", None),
        ("25.6 kHz", "0.5 Hz", "20 kHz", "below 12800 Hz, half of acquisition.sample_rate"),
        ("25.6 kHz", "0.5 Hz", "12.8 kHz", "keeps no alias out"),
        ("51.2 kHz", "20 Hz", "10 Hz", "above 20 Hz (amplifier.corner): else the chain passes nothing"),
    ],
)
def test_a_filter_fits_the_rate_and_the_amplifier_before_it(
    rate: str, high: str, low: str, allowed: str | None
) -> None:
    bench = bench_with("impact_beam", "contact.force_upper", FILTERED.format(high=high, low=low))
    scenario = parse_scenario(SOUND.replace("51.2 kHz", rate))
    if allowed is None:
        check_pair(scenario, bench, TODAY)
        return
    problem = only_problem(
        lambda: check_pair(scenario, bench, TODAY), 'daq_card.channels."contact.force_upper".filter.corner'
    )
    assert allowed in problem.allowed


@pytest.mark.parametrize(
    ("name", "chain", "key", "allowed"),
    [
        (
            "crank.angle",
            'kind = "encoder"\npulses_per_revolution = 2000000',
            "pulses_per_revolution",
            "a counter follows 9 MHz, and these are 11.7 MHz",
        ),
        (
            "crank.marker",
            'kind = "marker"\nrange = "5 V"\nlevel = "12 V"',
            "level",
            "up to 5 V, its range",
        ),
    ],
)
def test_what_a_crank_shows_fits_the_card_at_the_highest_speed(
    name: str, chain: str, key: str, allowed: str
) -> None:
    rig = "planar_slider_crank"
    bench = bench_with(rig, name, chain)
    problem = only_problem(lambda: check_bench(bench, TODAY), f'daq_card.channels."{name}".{key}')
    assert allowed in problem.allowed
    scenario = parse_scenario((SCENARIOS / "planar_slider_crank.toml").read_text())
    assert only_problem(lambda: check_pair(scenario, bench, TODAY), problem.key) == problem
    sound = chain.replace("2000000", "5000").replace("12 V", "5 V")
    check_bench(bench_with(rig, name, sound), TODAY)


def test_an_encoder_on_the_bus_sends_more_than_twice_a_turn() -> None:
    def bench(period: str) -> Bench:
        text = f'{RIGS["planar_slider_crank"].bench}\n[encoder]\nemulated = true\nperiod = "{period}"\n'
        return parse_bench(text, "bench", Path(), "planar_slider_crank")

    check_bench(bench("80 ms"), TODAY)
    problem = only_problem(lambda: check_bench(bench("90 ms"), TODAY), "encoder.period")
    assert "below 85.71 ms: half a turn at inverter.maximum_speed" in problem.allowed


def test_a_rehearsal_that_finds_nothing_to_spoil_is_told_by_the_bench_alone() -> None:
    text = f'{RIGS["impact_beam"].bench}\n[emulation]\nfaults = ["daq_card.stop_pressed@4"]\n'
    bench = parse_bench(text, "bench", Path(), "impact_beam")
    problem = only_problem(lambda: check_bench(bench, TODAY), "emulation.faults")
    assert "[emergency_stop] on a line of the card" in problem.allowed
