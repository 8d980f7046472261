from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import pytest

from daq.errors import ConfigurationError
from rig.files.bench import Bench, embedded_bench, load_bench, parse_bench
from rig.files.pairing import check_pair, too_late, unmeasured
from rig.files.scenario import parse_scenario
from rig.rigs import RIGS
from rig.surrogates.recordings import Setting
from tests.rig.files.faulty import only_problem

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
