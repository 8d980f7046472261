"""The bench file by which instruments that another process has started are reached."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from rig.emulation import bench_reaching
from rig.files.bench import embedded_bench, load_bench, parse_bench
from rig.rigs import RIGS

SCENARIOS = Path(__file__).parents[3] / "scenarios"
PLACES = {
    "signal_generator": "TCPIP::127.0.0.1::5025::SOCKET",
    "inverter": "socket://127.0.0.1:5020",
    "daq_card": "127.0.0.1:31763",
    "encoder": "127.0.0.1:29536",
}


@pytest.mark.parametrize("rig", RIGS)
def test_an_emulated_bench_becomes_a_real_one_that_differs_in_its_places_alone(rig: str) -> None:
    emulated = embedded_bench(rig)
    reached = parse_bench(bench_reaching(emulated, PLACES), "reached", Path(), rig)
    assert not reached.emulated
    actuator = dataclasses.asdict(emulated.actuator) | {"emulated": False}
    actuator["resource" if rig == "impact_beam" else "port"] = PLACES[RIGS[rig].actuator]
    assert dataclasses.asdict(reached.actuator) == actuator
    assert reached.daq_card == dataclasses.replace(emulated.daq_card, emulated=False, grpc=PLACES["daq_card"])


def test_what_a_bench_file_sets_and_what_it_leaves_open_are_both_there() -> None:
    text = """\
[inverter]
emulated = true
station = 9
rpm_per_hz = 6.0
maximum_speed = "240 rpm"
[encoder]
emulated = true
node = 11
identity = { serial = 1234 }
[emulation]
seed = 7
"""
    emulated = parse_bench(text, "bench", Path(), "planar_slider_crank")
    written = bench_reaching(emulated, PLACES)
    reached = parse_bench(written, "reached", Path())
    assert reached.rig == "planar_slider_crank"
    assert "emulat" not in written
    assert (reached.actuator.station, reached.actuator.rpm_per_hz) == (9, 6.0)
    assert reached.daq_card.channels == emulated.daq_card.channels
    assert emulated.encoder is not None
    options: dict[str, str | int] = {"channel": "can0", "host": "127.0.0.1", "port": 29536}
    assert reached.encoder == dataclasses.replace(emulated.encoder, emulated=False, options=options)


def test_what_is_real_already_stays_as_the_file_has_it() -> None:
    bench = load_bench(SCENARIOS / "bench.example.toml")
    again = parse_bench(bench_reaching(bench, {}), "again", Path())
    assert (again.actuator, again.daq_card) == (bench.actuator, bench.daq_card)


def test_stages_of_a_channel_come_along() -> None:
    text = RIGS["impact_beam"].bench.replace(
        'gain = "6 mV/pC"\n', 'gain = "6 mV/pC"\nfilter = { serial = "AF-3", corner = "20 kHz" }\n', 1
    )
    bench = parse_bench(text, "bench", Path())
    reached = parse_bench(bench_reaching(bench, PLACES), "reached", Path())
    assert [each.anti_alias for each in bench.daq_card.channels if each.anti_alias]
    assert reached.daq_card.channels == bench.daq_card.channels
