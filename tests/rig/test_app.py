"""The devices of a run."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from daq.channel import Channel
from daq.errors import ConfigurationError
from drivers.protocols.instrument import by_number
from rig.app import check_names, sensing, shaken, supplied
from rig.emulation import NOTHING_EMULATED
from rig.files.bench import Bench, parse_bench
from rig.files.scenario import load_scenario
from rig.instruments import Instrument
from rig.rigs import RIGS
from rig.session.devices import Devices
from tests.end_to_end.files import SCENARIOS
from tests.rig.session.fakes import silent_screen


def test_two_instruments_do_not_record_one_name() -> None:
    sound, heat = Channel("room.sound", "V"), Channel("room.heat", "V")
    devices: Any = SimpleNamespace(card=SimpleNamespace(channels=(sound, heat)), logged=(sound,))
    with pytest.raises(ConfigurationError, match=r"room\.sound = \(twice\)"):
        check_names(devices, "bench.toml")
    devices.logged = (Channel("room.damp", "V"),)
    check_names(devices, "bench.toml")


REAL: dict[str, tuple[str, str]] = {
    "signal_generator": (
        "impact_beam",
        'resource = "TCPIP::127.0.0.1::1::SOCKET"\nforce_per_volt = "3 N/V"\nmaximum_amplitude = "9 N"\n',
    ),
    "inverter": (
        "planar_slider_crank",
        'port = "socket://127.0.0.1:1"\nrpm_per_hz = 5.0\nmaximum_speed = "300 rpm"\n',
    ),
    "dc_supply": (
        "spatial_slider_crank",
        'resource = "TCPIP::127.0.0.1::1::SOCKET"\nrpm_per_volt = 5.0\nmaximum_speed = "300 rpm"\n'
        'maximum_current = "3 A"\n',
    ),
    "manual_motor": ("planar_slider_crank", 'driver = "manual"\nmaximum_speed = "300 rpm"\n'),
    "manual_shaker": ("impact_beam", 'driver = "manual"\nmaximum_amplitude = "9 N"\n'),
}


def real_bench(table: str, settings: str, rig: str, folder: Path) -> Bench:
    card = RIGS[rig].bench[RIGS[rig].bench.index("[daq_card]") :]
    card = card.replace("emulated = true", 'grpc = "127.0.0.1:1"').replace("_until = 2036", "_until = 2096")
    bus = '[encoder]\ninterface = "socketcand"\nhost = "127.0.0.1"\nport = 1\nchannel = "can0"\nnode = 7\n'
    text = f"[{table}]\n{settings}{card}\n{bus if RIGS[rig].extras else ''}"
    return parse_bench(text, "bench", folder, rig)


@pytest.mark.parametrize("table", REAL)
def test_what_measures_is_made_and_what_moves_the_rig_is_not(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig, settings = REAL[table]
    bench = real_bench(table, settings, rig, tmp_path)
    made = list[str]()

    def noted(instrument: Instrument, settings: Any) -> Any:
        return lambda settings: made.append(instrument.word)

    monkeypatch.setattr(Instrument, "driver_of", noted)
    scenario = load_scenario(SCENARIOS / f"{rig}.toml")
    with ExitStack() as stack:
        sensing(scenario, bench, stack, silent_screen())
    assert made == ["card", "encoder"][: 1 + bool(RIGS[rig].extras)]


@pytest.mark.parametrize(("table", "devices_of"), [("signal_generator", shaken), ("dc_supply", supplied)])
def test_who_switches_off_asks_nobody_where_the_source_is(
    table: str, devices_of: Callable[..., Devices], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = list[str]()

    def number_of(host: str) -> str:
        asked.append(host)
        return "192.0.2.7"

    monkeypatch.setattr(socket, "gethostbyname", number_of)
    rig, settings = REAL[table]
    bench = real_bench(table, settings.replace("127.0.0.1::1::", "source.lab::5025::"), rig, tmp_path)
    devices = devices_of(load_scenario(SCENARIOS / f"{rig}.toml"), bench, NOTHING_EMULATED)
    assert devices.actuator.address == "TCPIP::source.lab::5025::SOCKET"
    assert devices.spare is not None
    assert devices.spare().address == "TCPIP::192.0.2.7::5025::SOCKET"
    assert asked == ["source.lab"]


def test_a_host_that_nobody_knows_now_stays_as_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostbyname", Mock(side_effect=OSError("no name server")))
    for address in ("TCPIP::source.lab,111::inst0::INSTR", "socket://inverter.lab:4001", "/dev/ttyUSB0"):
        assert by_number(address) == address
