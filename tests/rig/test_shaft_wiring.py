"""From a bench file to the inverter and the encoder, real or emulated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.canopen_cia406.settings import EncoderSettings
from drivers.mitsubishi_fr.emulator.drive import PARAMETERS
from drivers.mitsubishi_fr.emulator.process import matching_setup
from drivers.mitsubishi_fr.settings import CHECKED, Parameters, problems, warnings
from rig.emulated_rig import RAMP_S
from rig.emulation import encoder_setup
from rig.files.bench import Bench, Emulation, load_bench, parse_bench

EXAMPLE = Path(__file__).parents[2] / "scenarios" / "crank_bench.example.toml"
BENCH = load_bench(EXAMPLE)


def emulated(text: str) -> Bench:
    return parse_bench(text, "bench", Path(), "planar_slider_crank")


def encoder_of(bench: Bench) -> EncoderSettings:
    assert bench.encoder is not None
    return bench.encoder


def test_the_driver_gets_what_the_bench_says() -> None:
    settings = BENCH.actuator.at("/dev/ttyUSB1")
    assert (settings.port, settings.station, settings.baudrate, settings.parity) == (
        "/dev/ttyUSB1",
        1,
        19200,
        "E",
    )
    # exactly, and not with what a way through rad/s adds: the drive's Pr.1 is held against it
    assert (settings.rpm_per_hz, settings.maximum_speed_rpm, settings.maximum_hz) == (5.0, 300.0, 60.0)
    assert (settings.answer_s, settings.poll_s, settings.silent_s, settings.unattended_s) == (
        0.2,
        0.1,
        0.7,
        5,
    )


@pytest.mark.parametrize(
    "keys",
    [
        "",
        "station = 7\nbaudrate = 38400\n",
        'parity = "N"\n',
        "rpm_per_hz = 7.3\n",
        'maximum_speed = "97 rpm"\n',
    ],
)
def test_an_emulated_inverter_is_set_as_its_driver_wants_it(keys: str) -> None:
    inverter = emulated(f"[inverter]\nemulated = true\n{keys}").actuator
    settings = inverter.at("socket://127.0.0.1:1")
    raw = PARAMETERS | dict(matching_setup(inverter, RAMP_S).parameters)
    found = Parameters({each: raw[each.number - 41000] for block in CHECKED for each in block.registers})
    assert problems(found, settings) == ()
    # Pr.1 is the bench's maximum, so that the drive keeps it too; in steps of 0.01 Hz
    assert found.raw[CHECKED[0].registers[0]] * 0.01 == pytest.approx(settings.maximum_hz, abs=0.01)
    assert len(warnings(found, settings)) <= 1


def test_a_real_encoder_keeps_its_address_and_an_emulated_one_gets_it() -> None:
    real = encoder_of(BENCH)
    assert (real.interface, real.node, real.period_s) == ("socketcand", 7, 1e-3)
    assert real.options == {"host": "127.0.0.1", "port": 29536, "channel": "can0"}
    bench = emulated('[encoder]\nemulated = true\nnode = 9\nperiod = "2 ms"\n')
    settings = encoder_of(bench).at("127.0.0.1:4711")
    assert settings.options == {"host": "127.0.0.1", "port": 4711, "channel": "can0"}
    assert (settings.node, settings.period_s) == (9, 2e-3)


def test_an_emulated_encoder_is_the_one_that_the_bench_expects() -> None:
    identity = "counts_per_revolution = 1000\ntotal_range = 8000\nserial = 5\noperating_parameters = 0\n"
    bench = emulated(f"[encoder]\nemulated = true\n[encoder.identity]\n{identity}")
    setup = encoder_setup(encoder_of(bench), seed=1, emulation=Emulation())
    assert (setup.counts_per_revolution, setup.revolutions, setup.total_range, setup.serial) == (
        1000,
        8,
        8000,
        5,
    )
    assert not setup.scaling
    settings = encoder_of(bench).at("127.0.0.1:1")
    found = settings.identity
    assert (found.counts_per_revolution, found.total_range, found.serial) == (1000, 8000, 5)


def test_the_zero_and_the_clocks_of_an_emulated_encoder_are_drawn() -> None:
    encoder = encoder_of(emulated("[encoder]\nemulated = true\n"))
    setups = [encoder_setup(encoder, seed, Emulation()) for seed in range(100)]
    assert setups == [encoder_setup(encoder, seed, Emulation()) for seed in range(100)]
    spread = math.sqrt(sum(setup.clock_ppm**2 for setup in setups) / len(setups))
    assert spread == pytest.approx(20.0, rel=0.3)  # four times 1 / sqrt(2 x 100)
    assert len({setup.offset_counts for setup in setups}) > 90
    nominal = encoder_setup(encoder, 1, Emulation(healthy=False, encoder_lag=2e-3))
    assert (nominal.offset_counts, nominal.clock_ppm, nominal.period_ppm) == (0, 0.0, 0.0)
    assert nominal == replace(setups[1], offset_counts=0, clock_ppm=0.0, period_ppm=0.0, lag_s=2e-3)
